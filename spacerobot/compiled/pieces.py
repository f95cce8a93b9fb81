"""Cut a long straight-line function into pieces, since a compiler's time grows faster than its length.

The generated body is a list of assignments to registers. A piece keeps its registers as local variables;
only those that a later piece reads pass through memory between them. Pieces are functions of their own, so
that they can be compiled side by side.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

LONGEST = 12_000
"""Statements of the longest function left whole. The paper's adjoint (9000) would be a quarter slower cut."""

PIECE = 350
"""Statements in each piece: the servicer's 25 000 compile in two thirds of the time that pieces of 1500 take,
and run a sixth faster."""

COLD_PIECE = 500
"""Statements in each piece of a function that runs seldom."""

_REGISTER = re.compile(r"\ba\d+\b")


@dataclass(frozen=True)
class CodeSection:
    """Consecutive statements of a body that are cut together.

    Attributes:
        name: Name from which those of the pieces are made.
        parameters: Declarations of what the statements read and write, ``const real* __restrict arg0``.
        statements: Assignments ``a0=...;`` in their order.
        size: Statements in each piece.
        cold: Whether they run seldom.
    """

    name: str
    parameters: tuple[str, ...]
    statements: tuple[str, ...]
    size: int
    cold: bool = False


@dataclass(frozen=True)
class CodePiece:
    """A function that does a part of the work.

    Attributes:
        name: Its name.
        head: Its declaration, without a semicolon.
        lines: What its body holds.
        cold: Whether it runs seldom.
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
    """Pieces of each section, which run one after the other, and how many registers pass between them.

    The first parameter of every piece is ``real* __restrict between``, the place of these registers.

    Args:
        sections: Parts of one body: a later one may read the registers of an earlier one.
    """
    parts = [
        (section, k, section.statements[k : k + section.size])
        for section in sections
        for k in range(0, len(section.statements), section.size)
    ]
    # registers that each piece reads before it writes them, and those it writes
    uses = list[tuple[set[str], set[str]]]()
    for _, _, statements in parts:
        read, written = set[str](), set[str]()
        for statement in statements:
            target, _, value = statement.partition("=")
            read |= set(_REGISTER.findall(value)) - written
            if _REGISTER.fullmatch(target.strip()):
                written.add(target.strip())
        uses.append((read, written))
    # registers of each piece that a later one reads
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
