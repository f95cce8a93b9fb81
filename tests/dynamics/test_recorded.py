"""Recorded functions: the expressions that the function itself builds, structural zeros included."""

import casadi as ca
import pytest

from spacerobot.dynamics.algebra import inertia_torque, skew
from spacerobot.dynamics.recorded import recorded
from spacerobot.dynamics.rotations import rotation_from_quaternion

M, V = ca.SX.sym("m", 3, 3), ca.SX.sym("v", 3)
TURN = ca.diagcat(ca.SX.sym("a", 2, 2), 1)
ABOUT = ca.vertcat(ca.SX(2, 1), V[2])
Q = ca.SX.sym("q", 4)


@pytest.mark.parametrize(
    ("function", "arguments"),
    [
        (skew, (V,)),
        (skew, (ABOUT,)),
        (inertia_torque, (M, M, M, V)),
        (inertia_torque, (ca.SX(3, 3), M, M, V)),
        (inertia_torque, (ca.diag(V), TURN, TURN, ABOUT)),
        (rotation_from_quaternion, (Q,)),
        (rotation_from_quaternion, (ca.vertcat(ca.SX(2, 1), Q[2:]),)),
    ],
)
def test_a_replay_is_what_the_function_builds(function, arguments):
    replayed, built = function(*arguments), function.__wrapped__(*arguments)
    assert str(replayed) == str(ca.sparsify(built))
    symbols = ca.symvar(ca.vertcat(*map(ca.vec, arguments)))
    counts = [ca.Function("f", symbols, [each]).n_instructions() for each in (replayed, ca.sparsify(built))]
    assert counts[0] == counts[1]


@recorded((2, 1), (1, 1))
def scaled(vector, factor, *, times=1):
    """A vector, and that vector scaled so many times."""
    result = vector
    for _ in range(times):
        result = factor * result
    return vector, result


def test_several_results_and_arguments_by_keyword():
    vector = ca.vertcat(V[0], ca.SX(1, 1))
    for times, expected in ((1, "[(m*v), 00]"), (2, "[(m*(m*v)), 00]")):
        same, found = scaled(vector, M[0, 0], times=times)
        assert str(same) == str(vector)
        assert str(found).replace("v_0", "v").replace("m_0", "m") == expected


def test_shapes_are_those_declared():
    with pytest.raises(RuntimeError, match="dimension"):
        skew(ca.SX.sym("x", 2, 2))
