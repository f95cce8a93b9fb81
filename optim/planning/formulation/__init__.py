"""What a plan is asked for: unknowns of an instant, goals, costs, limits, and where motions begin."""
