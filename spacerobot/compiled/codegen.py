"""C++ source of CasADi functions, for one evaluation or several in SIMD lanes.

CasADi's own C code tests for absent arguments at every read and write, and its C89 helper functions lose
accuracy (``log1p`` as ``log(1 + x)``). Only the function bodies are taken from it. Arguments become pointers
that do not alias, and ``lanes.hpp`` defines the helpers.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from spacerobot.common.errors import CompileError
from spacerobot.compiled import pieces
from spacerobot.compiled.pieces import CodePiece, CodeSection
from spacerobot.compiled.schedule import LANES_WINDOW, WINDOW, order_statements

UNARY = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    *("exp", "log", "expm1", "log1p", "erf", "erfinv", "floor", "ceil"),
)
SHORT = 1000
"""Statements up to which a function is defined in the struct; longer ones become pieces."""

HIDDEN = '__attribute__((visibility("hidden")))'
BINARY = ("pow", "atan2", "hypot", "fmod", "remainder")

_BODY = re.compile(r"^static int casadi_f0\(.*?\) \{\n(.*?)^  return 0;\n\}", re.MULTILINE | re.DOTALL)
_RESULT = re.compile(r"res(\d+)\[")
_READ = re.compile(r"arg\[(\d+)\]\? arg\[\d+\]\[(\d+)\] : 0;")
_WRITE = re.compile(r"if \(res\[(\d+)\]!=0\) res\[\d+\]\[(\d+)\]=")
_TURN = re.compile(r"\b(sin|cos)\(")
_CONDITIONAL = re.compile(r"\((a\d+)\?(a\d+):0\)")


@dataclass(frozen=True)
class GeneratedSource:
    """C++ source of CasADi functions.

    Attributes:
        struct: Declarations of the pieces, and the struct ``Generated`` with a static member and argument
            sizes for every function.
        pieces: Functions that the struct's members call.
    """

    struct: str
    pieces: tuple[CodePiece, ...]


def source_of(
    functions: Mapping[str, ca.Function],
    *,
    cold: Collection[str] = (),
    lanes: int = 1,
) -> GeneratedSource:
    """C++ source of SX functions.

    A function ``f: (a[3], b) -> (y[2])`` becomes ``static void f(const real* a, const real* b, real* y)``
    with the constants ``f_a = 3``, ``f_b = 1``, ``f_y = 2``. It is exported with C linkage as
    ``call_f(arg, res)``. A long cold function whose inputs are those of a long hot one calls the pieces of
    the hot one first, so that their common subexpressions are compiled once.

    Args:
        functions: SX functions by name, with dense inputs and outputs and no free variables.
        cold: Names of functions that run seldom and are compiled with less optimisation.
        lanes: Evaluations in one call; they decide the order of operations.

    Raises:
        CompileError: A function is not SX, has sparse arguments or free variables.
    """
    for name, function in functions.items():
        if not function.is_a("SXFunction"):
            raise CompileError(
                f"function '{name}' is a {function.class_name()}, only SXFunction can be compiled"
            )
        if function.has_free():
            raise CompileError(f"function '{name}' has free variables: {', '.join(function.get_free())}")
        dense_in = all(function.sparsity_in(i).is_dense() for i in range(function.n_in()))
        dense_out = all(function.sparsity_out(i).is_dense() for i in range(function.n_out()))
        if not (dense_in and dense_out):
            raise CompileError(
                f"function '{name}' has sparse inputs or outputs, only dense ones can be compiled"
            )
    members, parts = [], []
    # names of functions that share their inputs, and therefore probably many subexpressions
    chains: dict[str, list[str]] = {}
    head: dict[object, str] = {}  # long hot function, by its inputs
    for name in sorted(functions, key=lambda name: name in cold):  # hot functions first
        function = functions[name]
        inputs = tuple((function.name_in(i), function.numel_in(i)) for i in range(function.n_in()))
        long = function.n_instructions() > pieces.LONGEST
        if long and name in cold and inputs in head:
            chains[head[inputs]].append(name)
            continue
        chains[name] = [name]
        if long and name not in cold:
            head.setdefault(inputs, name)
    for names in chains.values():
        chain = {name: functions[name] for name in names}
        merged = _together(chain) if len(names) > 1 else None
        if merged is None:
            one = [_alone(name, function, name in cold, lanes) for name, function in chain.items()]
            merged = [member for member, _ in one], [piece for _, blocks in one for piece in blocks]
        members += merged[0]
        parts += merged[1]
    declared = [f"{HIDDEN} {piece.head};" for piece in parts]
    exports = []
    for name, function in functions.items():
        sources = [f"arg[{i}]" for i in range(function.n_in())]
        arguments = ", ".join([*sources, *(f"res[{i}]" for i in range(function.n_out()))])
        exports.append(
            f'extern "C" void call_{name}(const real* const* arg, real* const* res) '
            f"{{ Generated::{name}({arguments}); }}"
        )
    text = "\n".join([*declared, "struct Generated {", *members, "};", *exports, ""])
    return GeneratedSource(text, tuple(parts))


def maths_of(vector_symbols: Mapping[str, str]) -> str:
    """C++ lines that bind every elementary function to a vector routine, or to the scalar one for each lane.

    Args:
        vector_symbols: Routine of the vector maths library by function name; functions without one are
            absent.
    """

    def line(name: str, arity: int) -> str:
        symbol = vector_symbols.get(name)
        return f"VECTOR{arity}({name}, {symbol})" if symbol else f"PLAIN{arity}({name})"

    lines = [line(name, 1) for name in UNARY] + [line(name, 2) for name in BINARY]
    return "\n".join(["#if LANES > 1", *lines, "#endif", ""])


def _together(chain: Mapping[str, ca.Function]) -> tuple[list[str], list[CodePiece]] | None:
    """Struct members and pieces of functions with the same inputs.

    The functions are merged into one, with common subexpressions eliminated. The pieces of each function
    continue those of the function before it. None if the statements of the functions are interleaved.
    """
    first = next(iter(chain.values()))
    symbols = [ca.SX.sym(first.name_in(i), first.size1_in(i), first.size2_in(i)) for i in range(first.n_in())]
    values = [value for function in chain.values() for value in function.call(symbols)]
    statements = statements_of("together", ca.Function("together", symbols, values, {"cse": True}))
    writes = [int(match.group(1)) if (match := _RESULT.match(line)) else -1 for line in statements]
    sections: list[CodeSection] = []
    begin, first_index = 0, 0
    for name, function in chain.items():
        reads, _ = _parameters(function)
        indices = range(first_index, first_index + function.n_out())
        parameters = (*reads, *(f"real* __restrict res{i}" for i in indices))
        end = max((k + 1 for k, i in enumerate(writes) if i in indices), default=begin)
        if any(i not in indices for i in writes[begin:end] if i >= 0):
            return None
        hot = not sections
        size = pieces.PIECE if hot else pieces.COLD_PIECE
        sections.append(CodeSection(name, parameters, tuple(statements[begin:end]), size, not hot))
        begin, first_index = end, indices.stop
    cut, slots = pieces.cut(sections)
    members, calls, scratch = [], [], [f"  real between[{slots + 1}];"]
    for (name, function), section, parts in zip(chain.items(), sections, cut, strict=True):
        arguments = ", ".join(["between", *(p.split()[-1] for p in section.parameters)])
        calls += [f"  {part.name}({arguments});" for part in parts]
        members.append(_member(name, function, section.parameters, [*scratch, *calls]))
        results = section.parameters[function.n_in() :]
        scratch += [
            f"  real {result.split()[-1]}[{function.numel_out(i) + 1}];" for i, result in enumerate(results)
        ]
    return members, [part for parts in cut for part in parts]


def _alone(name: str, function: ca.Function, cold: bool, lanes: int) -> tuple[str, list[CodePiece]]:
    """Struct member and pieces of one function."""
    statements = statements_of(name, function)
    reads, writes = _parameters(function)
    parameters = (*reads, *writes)
    longest, size = (pieces.COLD_PIECE, pieces.COLD_PIECE) if cold else (pieces.LONGEST, pieces.PIECE)
    if len(statements) <= longest:
        if not cold:  # in pieces, a new order gains nothing
            statements = order_statements(statements, WINDOW if lanes == 1 else LANES_WINDOW)
        size = max(1, len(statements))
    (parts,), slots = pieces.cut([CodeSection(name, parameters, tuple(statements), size, cold)])
    if len(parts) == 1 and len(statements) <= SHORT:
        return _member(name, function, parameters, parts[0].lines), []
    arguments = ", ".join(["between", *(parameter.split()[-1] for parameter in parameters)])
    calls = [f"  {part.name}({arguments});" for part in parts]
    return _member(name, function, parameters, [f"  real between[{slots + 1}];", *calls]), parts


def statements_of(name: str, function: ca.Function) -> list[str]:
    """Assignments of the C code that CasADi generates for an SX function, with the helpers of ``lanes.hpp``.

    Raises:
        CompileError: CasADi's code has an unknown form.
    """
    generator = ca.CodeGenerator("generated.c", {"with_header": False})
    generator.add(function)
    match = _BODY.search(generator.dump())
    if match is None:
        raise CompileError(f"the code that this CasADi generates for '{name}' has an unknown form")
    body = _READ.sub(r"arg\1[\2];", match.group(1))
    body = _WRITE.sub(r"res\1[\2]=", body)
    body = _TURN.sub(r"casadi_\1(", body)
    body = _CONDITIONAL.sub(r"casadi_if_else_zero(\1,\2)", body)
    lines = [line.strip() for line in body.splitlines()]
    return [line for line in lines if line and not line.startswith("casadi_real ")]


def _parameters(function: ca.Function) -> tuple[list[str], list[str]]:
    reads = [f"const real* __restrict arg{i}" for i in range(function.n_in())]
    return reads, [f"real* __restrict res{i}" for i in range(function.n_out())]


def _member(name: str, function: ca.Function, parameters: Sequence[str], lines: Sequence[str]) -> str:
    sizes = [f"{name}_{function.name_in(i)} = {function.numel_in(i)}" for i in range(function.n_in())]
    sizes += [f"{name}_{function.name_out(i)} = {function.numel_out(i)}" for i in range(function.n_out())]
    head = f"static __attribute__((noinline)) void {name}({', '.join(parameters)})"
    return "\n".join([f"enum {{ {', '.join(sizes)} }};", f"{head} {{", *lines, "}"])
