"""Problem formulation: unknowns of an instant, goals, costs, limits, initial conditions."""
