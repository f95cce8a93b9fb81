"""The tuning problem of a scene: its variables, objective, constraints and derivatives."""
