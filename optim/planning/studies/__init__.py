"""Studies of many plans: Pareto fronts of two cost terms, cost sensitivities, design optimisation."""
