"""Many plans: Pareto fronts of two terms of the cost, cost sensitivities, design optimisation."""
