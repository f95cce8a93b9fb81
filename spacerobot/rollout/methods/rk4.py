"""Classical Runge-Kutta method of order 4; the slope at the step's end gives an error estimate of order 3."""

from spacerobot.rollout.methods.tableau import Tableau

RK4 = Tableau(
    "rk4",
    "Kutta (1901)",
    order=4,
    rows=((1 / 2,), (0.0, 1 / 2), (0.0, 0.0, 1.0), (1 / 6, 1 / 3, 1 / 3, 1 / 6)),
    b=(1 / 6, 1 / 3, 1 / 3, 1 / 6),
    nodes=(0.0, 1 / 2, 1 / 2, 1.0, 1.0),
    error=(0.0, 0.0, 0.0, 1 / 6, -1 / 6),
    error_order=3,
)
