"""Whether a solution is a plan: its residual, its limits between the points, its replay by the simulator."""
