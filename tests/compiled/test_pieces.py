"""Long functions are cut into pieces that compute the same."""

import casadi as ca
import numpy as np
import pytest

from spacerobot.compiled import compile_functions, pieces
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
    body = "  real a0;\n  a0=1.;\n  res0[0]=a0;\n"
    assert pieces.split_body(body, "f", ["real* __restrict res0"]) == ("", body)
