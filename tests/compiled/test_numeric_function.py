"""CasADi functions through buffers give what CasADi's own calls give, to the bit."""

import casadi as ca
import numpy as np
import pytest

from spacerobot.compiled.numeric_function import NumericFunction

T, X, M = ca.SX.sym("t"), ca.SX.sym("x", 4), ca.SX.sym("m", 2, 3)
SX_FUNCTION = ca.Function(
    "f", [T, X, M, ca.SX.sym("none", 0)], [ca.sin(X) * T, ca.mtimes(M.T, M), ca.sumsqr(X), ca.SX(0, 1), T * M]
)


def given(rng):
    return rng.normal(), rng.normal(size=4), rng.normal(size=6), np.empty(0)


def own_call(function, arguments):
    t, x, m, none = arguments
    return [value.full() for value in function(t, x, m.reshape(3, 2).T, none)]


@pytest.mark.parametrize("function", [SX_FUNCTION, SX_FUNCTION.wrap()], ids=["SX", "MX"])
def test_every_output_is_that_of_casadis_own_call(function):
    numeric, rng = NumericFunction(function), np.random.default_rng(3)
    calls = [given(rng) for _ in range(3)]
    found = [(numeric(*arguments), numeric.matrices(*arguments)) for arguments in calls]
    # later calls change no earlier result
    for (short, matrices), arguments in zip(found, calls, strict=True):
        expected = own_call(function, arguments)
        assert [value.shape for value in matrices] == [(4, 1), (3, 3), (1, 1), (0, 1), (2, 3)]
        assert [value.shape for value in short] == [(4,), (3, 3), (1,), (0,), (2, 3)]
        for value, other, own in zip(short, matrices, expected, strict=True):
            np.testing.assert_array_equal(other, own)
            np.testing.assert_array_equal(value, own.reshape(value.shape))


def test_a_number_fills_an_input_and_wrong_arguments_are_refused():
    numeric = NumericFunction(SX_FUNCTION)
    filled = SX_FUNCTION(2.0, np.full(4, 0.5), np.zeros((2, 3)), [])[0]  # NumPy's sine may round otherwise
    np.testing.assert_array_equal(numeric(2.0, 0.5, np.zeros(6), [])[0], filled.full().ravel())
    with pytest.raises(ValueError, match="shorter"):
        numeric(1.0, np.zeros(4))
    with pytest.raises(ValueError, match="broadcast"):
        numeric(1.0, np.zeros(3), np.zeros(6), [])


def test_sparse_functions_are_refused():
    for arguments, result in (([T], ca.SX(2, 1)), ([ca.SX.sym("d", ca.Sparsity.diag(2))], ca.SX(1))):
        with pytest.raises(ValueError, match="function 'g' has sparse inputs or outputs"):
            NumericFunction(ca.Function("g", arguments, [result]))
