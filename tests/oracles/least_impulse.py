"""Least impulse of forces that move a body by linear programming."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog, minimize_scalar


def least_impulse(mass: float, way: float, limit: float, duration: float, steps: int = 400) -> float:
    """Least integral of |f| [N s] that moves a mass [kg] over a way [m] along one axis from rest to rest.

    The force f, at most `limit` [N], is constant in each of many steps of the duration [s]. With f = a - b,
    a >= 0 and b >= 0, rates and places at the end are sums of these, and the impulse is linear:

        min h sum(a + b),   h sum(a - b) = 0,   h sum((T - t_k - h/2) (a_k - b_k)) = m d.
    """
    h = duration / steps
    left = duration - h * (np.arange(steps) + 0.5)
    rows = np.array([np.full(steps, h), h * left])
    found = linprog(
        np.full(2 * steps, h),
        A_eq=np.hstack([rows, -rows]),
        b_eq=[0.0, mass * way],
        bounds=(0, limit),
        method="highs",
    )
    return float(found.fun) if found.success else np.inf


def least_impulse_and_time(
    mass: float, way: float, limit: float, weight: float, longest: float
) -> tuple[float, float]:
    """Least of the impulse plus a weight [N] times the duration, and that duration [s]."""
    shortest = 2 * np.sqrt(mass * way / limit)
    found = minimize_scalar(
        lambda duration: least_impulse(mass, way, limit, duration) + weight * duration,
        bounds=(1.001 * shortest, longest),
        method="bounded",
    )
    return float(found.fun), float(found.x)
