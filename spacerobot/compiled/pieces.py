"""Division of a long straight-line function into pieces that are compiled separately.

A compiler's time grows faster than the length of a function, and pieces compile in parallel. The generated
body is a list of assignments to registers. The registers of a piece are local variables; those that a later
piece reads are passed in an array.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

LONGEST = 12_000
"""Statements up to which a function is not divided. The paper's adjoint (9000) is 25 % slower in pieces."""

PIECE = 350
"""Statements in each piece. Compared with pieces of 1500, the servicer's 25 000 statements compile in two
thirds of the time and run a sixth faster."""

COLD_PIECE = 500
"""Statements in each piece of a cold function, one that runs seldom."""

_REGISTER = re.compile(r"\ba\d+\b")


@dataclass(frozen=True)
class CodeSection:
    """Consecutive statements of a function body that are divided into pieces of equal size.

    Attributes:
        name: Prefix of the pieces' names.
        parameters: Declarations of the arrays that are read and written, ``const real* __restrict arg0``.
        statements: Assignments ``a0=...;`` in their order.
        size: Statements in each piece.
        cold: Whether the section runs seldom.
    """

    name: str
    parameters: tuple[str, ...]
    statements: tuple[str, ...]
    size: int
    cold: bool = False


@dataclass(frozen=True)
class CodePiece:
    """A C function that evaluates a part of a longer one.

    Attributes:
        name: Name of the function.
        head: Declaration, without a semicolon.
        lines: Lines of the body.
        cold: Whether the function runs seldom.
    """

    name: str
    head: str
    lines: tuple[str, ...]
    cold: bool

    @property
    def text(self) -> str:
        """Definition of the function in C."""
        return "\n".join([f"{self.head} {{", *self.lines, "}"])


def cut(sections: Sequence[CodeSection]) -> tuple[list[list[CodePiece]], int]:
    """Divide the sections of a function body into pieces.

    Args:
        sections: Sections in the order of execution; a later one may read registers of an earlier one.

    Returns:
        tuple: Pieces of each section, and the number of registers passed between pieces: the length of the
            array ``between``, the first parameter of every piece.
    """
    parts = [
        (section, k, section.statements[k : k + section.size])
        for section in sections
        for k in range(0, len(section.statements), section.size)
    ]
    # registers that each piece reads before writing them, and registers that it writes
    uses = list[tuple[set[str], set[str]]]()
    for _, _, statements in parts:
        read, written = set[str](), set[str]()
        for statement in statements:
            target, _, value = statement.partition("=")
            read |= set(_REGISTER.findall(value)) - written
            if _REGISTER.fullmatch(target.strip()):
                written.add(target.strip())
        uses.append((read, written))
    # registers written by each piece and read by a later one: backward liveness analysis
    needed, passed = set[str](), list[set[str]]()
    for read, written in reversed(uses):
        passed.insert(0, written & needed)
        needed = (needed - written) | read
    slots = {register: i for i, register in enumerate(sorted(set().union(*passed)))}
    pieces: dict[str, list[CodePiece]] = {section.name: [] for section in sections}
    for (section, k, statements), (read, written), live in zip(parts, uses, passed, strict=True):
        loads = [f"{register}=between[{slots[register]}];" for register in sorted(read)]
        stores = [f"between[{slots[register]}]={register};" for register in sorted(live)]
        registers = [f"real {', '.join(sorted(read | written))};"] if read | written else []
        name = f"{section.name}_{k // section.size}"
        head = f"void {name}({', '.join(['real* __restrict between', *section.parameters])})"
        lines = (*registers, *loads, *statements, *stores)
        pieces[section.name].append(CodePiece(name, head, lines, section.cold))
    return [pieces[section.name] for section in sections], len(slots)
