"""C++ source from CasADi functions, to be compiled over any number of lanes.

CasADi's own C code carries tests for absent arguments at every read and write, and helper functions in the
idiom of C before 1999 that lose accuracy (``log1p`` as ``log(1 + x)``). Only the bodies are taken from it;
the arguments become plain pointers that do not alias, and the helpers come from ``lanes.hpp``.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping

import casadi as ca

from spacerobot.compiled import pieces
from spacerobot.compiled.schedule import LANES_WINDOW, WINDOW, order_statements
from spacerobot.errors import CompileError

UNARY = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    *("exp", "log", "expm1", "log1p", "erf", "erfinv", "floor", "ceil"),
)
BINARY = ("pow", "atan2", "hypot", "fmod", "remainder")

_BODY = re.compile(r"^static int casadi_f0\(.*?\) \{\n(.*?)^  return 0;\n\}", re.MULTILINE | re.DOTALL)
_READ = re.compile(r"arg\[(\d+)\]\? arg\[\d+\]\[(\d+)\] : 0;")
_WRITE = re.compile(r"if \(res\[(\d+)\]!=0\) res\[\d+\]\[(\d+)\]=")
_TURN = re.compile(r"\b(sin|cos)\(")
_CONDITIONAL = re.compile(r"\((a\d+)\?(a\d+):0\)")


def source_of(
    functions: Mapping[str, ca.Function],
    *,
    cold: Collection[str] = (),
    lanes: int = 1,
    struct: str = "Generated",
) -> str:
    """Source of a struct with one static function, and the sizes of its arguments, for every function.

    A function ``f: (a[3], b) -> (y[2])`` becomes ``static void f(const real* a, const real* b, real* y)``
    beside the constants ``f_a = 3``, ``f_b = 1``, ``f_y = 2``. It is also exported with C linkage as
    ``call_f(arg, res)``.

    Parameters
    ----------
    functions
        SX functions by name, with dense inputs and outputs and no free variables.
    cold
        Names of those that run seldom, and shall rather compile fast.
    lanes
        How many evaluations one call will carry, which decides the order of operations.
    struct
        Name of the C++ struct.

    Raises
    ------
    CompileError
        A function is not SX, has sparse arguments or free variables.
    """
    members = [_member(name, function, name in cold, lanes) for name, function in functions.items()]
    exports = [_export(name, function, struct) for name, function in functions.items()]
    return "\n".join([f"struct {struct} {{", *members, "};", *exports, ""])


def maths_of(vector_symbols: Mapping[str, str]) -> str:
    """Lines that bind every elementary function to a vector routine, or to the plain one lane by lane.

    Parameters
    ----------
    vector_symbols
        Routine of the vector maths library by function name; functions without one are absent.
    """

    def line(name: str, arity: int) -> str:
        symbol = vector_symbols.get(name)
        return f"VECTOR{arity}({name}, {symbol})" if symbol else f"PLAIN{arity}({name})"

    lines = [line(name, 1) for name in UNARY] + [line(name, 2) for name in BINARY]
    return "\n".join(["#if LANES > 1", *lines, "#endif", ""])


def _member(name: str, function: ca.Function, cold: bool, lanes: int) -> str:
    _check(name, function)
    generator = ca.CodeGenerator("generated.c", {"with_header": False})
    generator.add(function)
    match = _BODY.search(generator.dump())
    if match is None:
        raise CompileError(f"the code that this CasADi generates for '{name}' has an unknown form")
    body = match.group(1).replace("casadi_real", "real")
    body = _READ.sub(r"arg\1[\2];", body)
    body = _WRITE.sub(r"res\1[\2]=", body)
    body = _TURN.sub(r"casadi_\1(", body)
    body = _CONDITIONAL.sub(r"casadi_if_else_zero(\1,\2)", body)
    reads = [f"const real* __restrict arg{i}" for i in range(function.n_in())]
    writes = [f"real* __restrict res{i}" for i in range(function.n_out())]
    sizes = [f"{name}_{function.name_in(i)} = {function.numel_in(i)}" for i in range(function.n_in())]
    sizes += [f"{name}_{function.name_out(i)} = {function.numel_out(i)}" for i in range(function.n_out())]
    if not cold and body.count("\n") <= pieces.LONGEST:  # in pieces, a new order gains nothing
        body = order_statements(body, WINDOW if lanes == 1 else LANES_WINDOW)
    parts, body = pieces.split_body(body, name, reads + writes, cold=cold)
    return (
        f"enum {{ {', '.join(sizes)} }};\n{parts}"
        f"static __attribute__((noinline)) void {name}({', '.join(reads + writes)}) {{\n{body}}}"
    )


def _export(name: str, function: ca.Function, struct: str) -> str:
    arguments = [f"arg[{i}]" for i in range(function.n_in())] + [f"res[{i}]" for i in range(function.n_out())]
    return (
        f'extern "C" void call_{name}(const real* const* arg, real* const* res) '
        f"{{ {struct}::{name}({', '.join(arguments)}); }}"
    )


def _check(name: str, function: ca.Function) -> None:
    if not function.is_a("SXFunction"):
        raise CompileError(f"function '{name}' is a {function.class_name()}, only SXFunction can be compiled")
    if function.has_free():
        raise CompileError(f"function '{name}' has free variables: {', '.join(function.get_free())}")
    dense_in = all(function.sparsity_in(i).is_dense() for i in range(function.n_in()))
    dense_out = all(function.sparsity_out(i).is_dense() for i in range(function.n_out()))
    if not (dense_in and dense_out):
        raise CompileError(f"function '{name}' has sparse inputs or outputs, only dense ones can be compiled")
