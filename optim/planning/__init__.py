"""Trajectory optimisation: from a scenario's `plan` section to a trajectory that the simulator has flown."""
