"""Verification of a solution: first-order residual, limits between the points, replay by the simulator."""
