"""Files of plans, Pareto fronts and design studies, and the scenario that follows a plan."""
