"""Every operation of CasADi's SX, compiled and by the virtual machine, against CasADi's own interpreter."""

from __future__ import annotations

import math
import platform

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spacerobot.common.errors import CompileError
from spacerobot.compiled import compile_functions, find_toolchain
from spacerobot.rollout.virtual_machine import Program

X, Y = ca.SX.sym("x"), ca.SX.sym("y")
ARITHMETIC = {
    "add": X + Y,
    "sub": X - Y,
    "mul": X * Y,
    "div": X / Y,
    "inv": 1 / X,
    "neg": -X,
    "twice": 2 * X,
    "half": 0.5 * X,
    "sq": X**2,
    "cube": X**3,
    "sqrt": ca.sqrt(X),
    "constant": X + 3,
    "infinite": X - ca.inf,
    "not a number": X + ca.SX(math.nan),
}
CONDITIONS = {
    "lt": X < Y,
    "le": X <= Y,
    "eq": X == Y,
    "ne": X != Y,
    "not": ca.logic_not(X),
    "and": ca.logic_and(X, Y),
    "or": ca.logic_or(X, Y),
    "if zero": ca.if_else(X < Y, 3 * X, 0),
    "if else": ca.if_else(ca.logic_and(X < Y, Y > 0), X, Y),
    "fabs": ca.fabs(X),
    "sign": ca.sign(X),
    "copysign": ca.copysign(X, Y),
    "fmin": ca.fmin(X, Y),
    "fmax": ca.fmax(X, Y),
    "floor": ca.floor(X),
    "ceil": ca.ceil(X),
    "fmod": ca.fmod(X, Y),
    "remainder": ca.remainder(X, Y),
}
UNARY = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    *("exp", "log", "expm1", "log1p", "erf"),
)
ELEMENTARY = {name: getattr(ca, name)(X) for name in UNARY} | {
    "pow": X**Y,
    "constant pow": X**2.5,
    "atan2": ca.atan2(X, Y),
    "hypot": ca.hypot(X, Y),
}
NAMES = [*ARITHMETIC, *CONDITIONS, *ELEMENTARY]
EXPRESSIONS = ca.vertcat(*ARITHMETIC.values(), *CONDITIONS.values(), *ELEMENTARY.values())
FUNCTION = ca.Function("all", [X, Y], [EXPRESSIONS], ["x", "y"], ["out"])
LANES = (1, 2, 4, 8)

number = st.one_of(
    st.floats(-1, 1),
    st.floats(-40, 40),
    st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.5, 2.0, 1e5, -1e5, 1e-9, math.inf, -math.inf, math.nan]),
)


@pytest.fixture(scope="module")
def libraries():
    return {lanes: compile_functions({"all": FUNCTION}, lanes=lanes) for lanes in LANES}


@pytest.fixture(scope="module")
def program():
    return Program("all", FUNCTION)


@settings(deadline=None, max_examples=150, derandomize=True)
@given(x=st.lists(number, min_size=8, max_size=8), y=st.lists(number, min_size=8, max_size=8))
def test_every_operation_in_every_lane(libraries, x, y):
    expected = np.array([FUNCTION(a, b).full().ravel() for a, b in zip(x, y, strict=True)]).T
    for lanes, library in libraries.items():
        found = library("all", np.array([x[:lanes]]), np.array([y[:lanes]]))[0]
        for name, row, wanted in zip(NAMES, found, expected[:, :lanes], strict=True):
            np.testing.assert_allclose(row, wanted, rtol=4e-15, atol=5e-324, equal_nan=True, err_msg=name)


@settings(deadline=None, max_examples=150, derandomize=True)
@given(x=number, y=number)
def test_every_operation_of_the_virtual_machine(program, x, y):
    for name, one, wanted in zip(NAMES, program(x, y)[0], FUNCTION(x, y).full().ravel(), strict=True):
        np.testing.assert_allclose(one, wanted, rtol=4e-15, atol=5e-324, equal_nan=True, err_msg=name)


@pytest.mark.parametrize("lanes", [1, 8])
def test_sine_and_cosine_to_one_unit_in_the_last_place(lanes):
    angle = ca.SX.sym("a", 64)
    function = ca.Function("turn", [angle], [ca.sin(angle), ca.cos(angle)], ["a"], ["s", "c"])
    library = compile_functions({"turn": function}, lanes=lanes)
    random = np.random.default_rng(0)
    for size in (1e-8, 1.0, 1e3, 1e6, 1e12):
        angles = random.uniform(-size, size, (64, lanes))
        angles[:32] = np.round(angles[:32] / (np.pi / 2)) * (np.pi / 2)  # where the reduction cancels most
        # the C library's, to 0.55 units: NumPy's own vectors are less exact on some processors
        exact = (np.vectorize(turn)(angles) for turn in (math.sin, math.cos))
        for found, wanted in zip(library("turn", angles), exact, strict=True):
            assert (np.abs(found - wanted) <= 1.01 * np.spacing(np.abs(wanted))).all()


def test_a_lane_does_not_depend_on_its_neighbours(libraries):
    random = np.random.default_rng(1)
    x, y = random.uniform(-2, 2, (1, 8)), random.uniform(-2, 2, (1, 8))
    alone = libraries[8]("all", x, y)[0]
    for lane in range(8):
        neighbours = np.full((1, 8), np.nan)
        neighbours[0, 7 - lane] = x[0, lane]
        found = libraries[8]("all", neighbours, np.full((1, 8), y[0, lane]))[0]
        np.testing.assert_array_equal(found[:, 7 - lane], alone[:, lane])


def test_inverse_error_function():
    function = ca.Function("f", [X], [ca.erfinv(X)], ["x"], ["y"])
    for lanes in (1, 4):
        library = compile_functions({"f": function}, lanes=lanes)
        for value in (-0.999999, -0.5, -1e-9, 0.0, 0.4, 0.99, 1 - 1e-12):
            assert math.erf(library("f", [value])[0][0]) == pytest.approx(value, rel=1e-14, abs=1e-300)
        assert library("f", [1.0])[0][0] == math.inf
        assert math.isnan(library("f", [1.5])[0][0])


def test_many_inputs_outputs_and_functions():
    a, b = ca.SX.sym("a", 3), ca.SX.sym("b", 2)
    functions = {
        "first": ca.Function("x", [a, b], [a[0] * b, ca.dot(a, a)], ["a", "b"], ["u", "v"]),
        "second": ca.Function("x", [a], [ca.vertcat(a, 1.5)], ["a"], ["w"]),
    }
    library = compile_functions(functions, lanes=4)
    u, v = library("first", [2.0, 3.0, 4.0], [5.0, 6.0])
    np.testing.assert_array_equal(u, [10.0, 12.0])
    np.testing.assert_array_equal(v, [29.0])
    np.testing.assert_array_equal(library("second", [1.0, 2.0, 3.0])[0], [1.0, 2.0, 3.0, 1.5])
    with pytest.raises(KeyError, match="no function 'secnd', did you mean second"):
        library("secnd", [1.0])


def test_what_cannot_be_compiled_is_told():
    m, sparse = ca.MX.sym("m"), ca.SX(ca.Sparsity.lower(2))
    free = ca.SX.sym("free")
    cases = {
        "only SXFunction": ca.Function("f", [m], [m], ["m"], ["n"]),
        "free variables: free": ca.Function("f", [X], [X * free], ["x"], ["y"], {"allow_free": True}),
        "sparse": ca.Function("f", [X], [sparse * X], ["x"], ["y"]),
    }
    for message, function in cases.items():
        with pytest.raises(CompileError, match=message):
            compile_functions({"f": function})


def test_vector_maths_is_optional():
    from dataclasses import replace

    toolchain = find_toolchain()
    plain = replace(toolchain, vector_symbols={})
    found = compile_functions({"all": FUNCTION}, lanes=toolchain.lanes, toolchain=plain)("all", [0.3], [0.7])[
        0
    ]
    wanted = FUNCTION(0.3, 0.7).full().ravel()
    np.testing.assert_allclose(found, wanted, rtol=4e-15, equal_nan=True)


@pytest.mark.parametrize(("flags", "lanes"), [("-march=x86-64-v3", 4), ("-march=x86-64", 2)])
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="instruction sets of x86-64")
def test_lanes_fit_the_registers_that_the_compiler_may_use(monkeypatch, flags, lanes):
    """Vector maths for eight lanes expects its arguments in registers that four lanes' code does not use."""
    monkeypatch.setenv("SPACEROBOT_COMPILER_FLAGS", flags)
    toolchain = find_toolchain()
    assert toolchain.lanes <= lanes
    random = np.random.default_rng(2)
    x, y = random.uniform(0.1, 0.9, (2, 1, toolchain.lanes))
    found = compile_functions({"all": FUNCTION}, lanes=toolchain.lanes)("all", x, y)[0]
    wanted = np.array([FUNCTION(a, b).full().ravel() for a, b in zip(x[0], y[0], strict=True)]).T
    np.testing.assert_allclose(found, wanted, rtol=4e-15, equal_nan=True)
