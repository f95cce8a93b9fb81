"""Cut a long straight-line function into pieces, since a compiler's time grows faster than its length.

The generated body is a list of assignments to registers. A piece keeps its registers as local variables;
only those that a later piece reads pass through memory between them.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

LONGEST = 12_000
"""Statements of the longest function left whole. The paper's adjoint (9000) would be a quarter slower cut."""

PIECE = 1500
"""Statements in each piece: compiling 43 000 of them then takes 7 s instead of 55 s, and they run as fast."""

COLD_PIECE = 500
"""Statements in each piece of a function that runs seldom."""

_REGISTER = re.compile(r"\ba\d+\b")


def split_body(body: str, name: str, parameters: Sequence[str], *, cold: bool = False) -> tuple[str, str]:
    """Pieces of a function's body, as functions, and the body that calls them.

    Parameters
    ----------
    body
        Declarations ``real a0, a1;`` and statements ``a0=...;``, one a line.
    name
        Name of the function, from which those of the pieces are made.
    parameters
        Declarations of the function's parameters, ``const real* __restrict arg0``.
    cold
        Whether the function runs seldom, so that it is cut to what compiles fastest.

    Returns
    -------
    tuple of str
        Empty and the body itself where it is short enough.
    """
    lines = [line.strip() for line in body.splitlines()]
    statements = [line for line in lines if line and not line.startswith("real ")]
    longest, size = (COLD_PIECE, COLD_PIECE) if cold else (LONGEST, PIECE)
    if len(statements) <= longest:
        return "", body
    pieces = [statements[k : k + size] for k in range(0, len(statements), size)]
    uses = [_uses(piece) for piece in pieces]
    passed = _passed_on(uses)
    slots = {register: i for i, register in enumerate(sorted(set().union(*passed)))}
    declared = ", ".join(["real* __restrict between", *parameters])
    functions, calls = [], [f"  real between[{len(slots) + 1}];"]
    arguments = ", ".join(parameter.split()[-1] for parameter in parameters)
    for k, (piece, (read, written)) in enumerate(zip(pieces, uses, strict=True)):
        loads = [f"{register}=between[{slots[register]}];" for register in sorted(read)]
        stores = [f"between[{slots[register]}]={register};" for register in sorted(passed[k])]
        registers = f"  real {', '.join(sorted(read | written))};" if read | written else ""
        head = f"static __attribute__((noinline)) void {name}_{k}({declared}) {{"
        functions.append("\n".join([head, registers, *loads, *piece, *stores, "}"]))
        calls.append(f"  {name}_{k}(between, {arguments});")
    return "\n".join(functions) + "\n", "\n".join(calls) + "\n"


def _uses(piece: Sequence[str]) -> tuple[set[str], set[str]]:
    """Registers that a piece reads before it writes them, and those it writes."""
    read: set[str] = set()
    written: set[str] = set()
    for statement in piece:
        target, _, value = statement.partition("=")
        read |= set(_REGISTER.findall(value)) - written
        if _REGISTER.fullmatch(target.strip()):
            written.add(target.strip())
    return read, written


def _passed_on(uses: Sequence[tuple[set[str], set[str]]]) -> list[set[str]]:
    """Registers of each piece that a later one reads."""
    wanted: set[str] = set()
    passed = []
    for read, written in reversed(uses):
        passed.append(written & wanted)
        wanted = (wanted - written) | read
    return passed[::-1]
