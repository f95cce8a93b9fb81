"""Derivatives of distances whose normal is found by an iteration and held constant."""

import casadi as ca
import numpy as np
import pytest

from spacerobot import elements
from spacerobot.dynamics import rotation_exp
from spacerobot.shapes import Shape, held_gap, proximity

APART = [0.1, 0.2, -0.1, 0.3, -0.2, 0.5, 0.9, -0.4, 0.3, 0.4, 0.8, -0.3]
INSIDE = [0.1, 0.2, -0.1, 0.3, -0.2, 0.5, 0.3, 0.1, 0.0, 0.4, 0.8, -0.3]


@pytest.mark.parametrize(
    "kinds", [("capsule", "capsule"), ("cylinder", "box"), ("cylinder", "cylinder"), ("box", "sphere")]
)
@pytest.mark.parametrize("at", [APART, INSIDE])
def test_they_are_those_of_the_distance(kinds, at):
    x = ca.SX.sym("x", 12)
    measures = {"box": ca.SX([0.4, 0.6, 0.8]), "sphere": ca.SX(0.1)}
    shapes = [
        Shape(
            elements.kinds("shape")[kind],
            rotation_exp(x[k + 3 : k + 6]),
            x[k : k + 3],
            measures.get(kind, ca.SX([0.1, 0.6])),
        )
        for k, kind in zip((0, 6), kinds, strict=True)
    ]
    near, (about, (symbol, function, given, _)) = proximity(*shapes), held_gap(*shapes)
    slope = ca.Function("slope", [x], [ca.gradient(near.gap, x)])
    cheap = [about, ca.gradient(about, x), ca.hessian(about, x)[0]]
    held = ca.DM(0, 1) if function is None else function(ca.Function("given", [x], [given])(at))
    gap, first, second = ca.Function("cheap", [x, symbol], cheap)(at, held)
    assert float(gap) == pytest.approx(float(ca.Function("gap", [x], [near.gap])(at)), abs=1e-12)
    np.testing.assert_allclose(first, slope(at), atol=1e-9)
    steps = 2e-6 * np.eye(12)
    differences = [np.array(slope(at + step) - slope(at - step)).ravel() / 4e-6 for step in steps]
    np.testing.assert_allclose(second, differences, atol=1e-5 * np.abs(differences).max())
