"""Compiled functions called with NumPy arrays."""

import casadi as ca
import numpy as np
import pytest

from spacerobot.compiled import numpy_function

X, Y = ca.SX.sym("x", 3), ca.SX.sym("y")


def test_one_result_is_an_array_and_several_are_a_tuple():
    one = numpy_function(ca.Function("f", [X, Y], [X * Y], ["x", "y"], ["z"]))
    first = one(np.array([1.0, 2.0, 3.0]), 2.0)
    second = one([0, 0, 1], 5)
    np.testing.assert_array_equal(first, [2.0, 4.0, 6.0])  # its own, not the place of the next result
    np.testing.assert_array_equal(second, [0.0, 0.0, 5.0])
    two = numpy_function(ca.Function("f", [X], [X + 1, ca.sumsqr(X)], ["x"], ["u", "v"]))
    u, v = two([1.0, 2.0, 3.0])
    np.testing.assert_array_equal(u, [2.0, 3.0, 4.0])
    np.testing.assert_array_equal(v, [14.0])


def test_wrong_arguments_are_refused():
    function = numpy_function(ca.Function("f", [X, Y], [X * Y], ["x", "y"], ["z"]))
    with pytest.raises(ValueError, match="shorter"):
        function([1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match="broadcast"):
        function([1.0, 2.0], 1.0)
