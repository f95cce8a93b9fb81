"""Peak contact force: two balls that meet head-on, against the energy balance in closed form."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from optim.evaluation import batch
from tests.oracles.balls import meeting

SPEED, REDUCED_MASS = 0.4, 2.0 * 3.0 / (2.0 + 3.0)
STIFFNESS = 2e4


def greatest_force(k, n, a):
    """Largest F = k d^n (1 + a v) of two free bodies that meet at v0, by quadrature alone.

    With the reduced mass m, ``m v dv = -F dd`` gives ``m v dv / (1 + a v) = -k d^n dd`` and so the
    indentation at each speed, ``k d^(n+1) / (n+1) = m (g(v0) - g(v))``, where
    ``g = v / a - ln(1 + a v) / a^2``; without dissipation g = v^2 / 2, the kinetic energy.
    """

    def energy(v):
        return v**2 / 2 if a == 0 else v / a - np.log1p(a * v) / a**2

    def force(v):
        depth = ((n + 1) * REDUCED_MASS * (energy(SPEED) - energy(v)) / k) ** (1 / (n + 1))
        return k * depth**n * (1 + a * v)

    if a == 0:
        return force(0.0)
    return force(minimize_scalar(lambda v: -force(v), bounds=(0, SPEED), options={"xatol": 1e-9}).x)


@pytest.mark.parametrize(("n", "a"), [(1.0, 0.0), (1.5, 0.0), (1.5, 0.8), (1.0, 4.0)])
def test_the_greatest_force_is_that_of_the_energy_balance(n, a):
    law = {"stiffness": 1e4, "exponent": n, "dissipation": a}
    scene = meeting(law, SPEED, simulation={"duration": 0.06, "step": 2e-4})
    changes = {"contacts.bump.stiffness": [STIFFNESS]}
    found = batch(scene, "contact_force_peak", changes, backend="interpreted").data
    exact = greatest_force(STIFFNESS, n, a)
    # The largest at the steps' ends: at most (omega h)^2 / 8 = 8e-5 too small, omega^2 = k / m.
    assert exact * (1 - 1e-4) < found.contact_force_peak.item() < exact * (1 + 1e-7)
