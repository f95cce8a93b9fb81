"""Long functions are cut into pieces that compute the same."""

import casadi as ca
import numpy as np
import pytest

from spacerobot.compiled import compile_functions, pieces
from spacerobot.compiled.codegen import source_of
from spacerobot.compiled.toolchain import find_toolchain


@pytest.mark.skipif(find_toolchain() is None, reason="no C++ compiler")
@pytest.mark.parametrize("piece", [1, 7, 100])
def test_pieces_compute_what_the_whole_does(monkeypatch, piece):
    rng = np.random.default_rng(piece)
    x, y = ca.SX.sym("x", 4), ca.SX.sym("y", 3)
    values = [*ca.vertsplit(x), *ca.vertsplit(y)]
    for _ in range(300):
        a, b = (values[i] for i in rng.integers(0, len(values), 2))
        values.append(rng.choice([a + b, a * b, ca.sin(a), a - 0.5 * b]))
    function = ca.Function(
        "f", [x, y], [ca.vertcat(*values[-9:]), values[40] + values[5]], ["x", "y"], ["u", "w"]
    )
    monkeypatch.setattr(pieces, "LONGEST", 50)
    monkeypatch.setattr(pieces, "PIECE", piece)
    library = compile_functions({"f": function})
    given = rng.normal(size=4), rng.normal(size=3)
    for found, expected in zip(library("f", *given), function(*given), strict=True):
        np.testing.assert_allclose(found, np.array(expected).ravel(), rtol=1e-12, atol=1e-12)


def test_a_short_function_stays_whole():
    x = ca.SX.sym("x")
    source = source_of({"f": ca.Function("f", [x], [x**2], ["x"], ["y"])})
    assert source.pieces == ()


def related(rng):
    """A long function, and another of the same inputs that begins with the same work."""
    x = ca.SX.sym("x", 5)
    values = ca.vertsplit(x)
    for _ in range(400):
        a, b = (values[i] for i in rng.integers(0, len(values), 2))
        values.append(rng.choice([a + b, a * b, ca.sin(a), a - 0.5 * b]))
    often, seldom = ca.vertcat(*values[-30:]), ca.vertcat(ca.cos(values[-3]), values[7] * values[-9])
    return {
        "often": ca.Function("f", [x], [often], ["x"], ["y"], {"cse": True}),
        "seldom": ca.Function("f", [x], [ca.vertcat(seldom, often**2)], ["x"], ["z"], {"cse": True}),
        "last": ca.Function("f", [x], [ca.sumsqr(ca.vertcat(seldom, often))], ["x"], ["s"], {"cse": True}),
    }


@pytest.mark.skipif(find_toolchain() is None, reason="no C++ compiler")
@pytest.mark.parametrize("lanes", [1, 4])
def test_functions_of_the_same_inputs_share_their_pieces(monkeypatch, lanes):
    rng = np.random.default_rng(3)
    functions = related(rng)
    monkeypatch.setattr(pieces, "LONGEST", 50)
    monkeypatch.setattr(pieces, "PIECE", 40)
    apart = sum(len(piece.lines) for piece in source_of(functions).pieces)
    together = sum(len(piece.lines) for piece in source_of(functions, cold=("seldom", "last")).pieces)
    assert together < 0.6 * apart
    library = compile_functions(functions, cold=("seldom", "last"), lanes=lanes)
    given = rng.normal(size=5)
    for name, function in functions.items():
        expected = np.array(function(given)).ravel()
        np.testing.assert_allclose(library(name, given)[0], expected, rtol=1e-12, atol=1e-12)


def test_a_function_that_runs_often_is_never_made_to_wait_for_another():
    x = ca.SX.sym("x")
    functions = {name: ca.Function("f", [x], [x + k], ["x"], ["y"]) for k, name in enumerate("abc")}
    assert all("between" not in line for line in source_of(functions).struct.splitlines())
