"""Sizes and tables of a kernel that the loops read: constants of compiled loops, data of interpreted ones."""

from __future__ import annotations

import hashlib
import math
import platform
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # the package's build reads this file where nothing else is installed
    from spacerobot.rollout.kernel import Kernel

FUNCTIONS = (
    *(
        "setup",
        "dynamics",
        "normalise",
        "outputs",
        "final",
        "objective",
        "rows",
        "guards",
        "values",
        "update",
    ),
    *("objective_reverse", "setup_reverse", "dynamics_reverse", "peaks_reverse", "final_reverse"),
    *("normalise_reverse", "guards_reverse", "update_reverse"),
)
"""Functions that the loops call."""

LENGTHS = {
    "NP": ("setup", "p"),
    "NX": ("dynamics", "x"),
    "NC": ("dynamics", "c"),
    "NM": ("dynamics", "m"),
    "NY": ("outputs", "y"),
    "NE": ("final", "e"),
    "NJ": ("objective", "J"),
    "NR": ("objective", "r"),
    "CURSORS": ("rows", "row"),
    "GAPS": ("values", "speed"),
    "NW": ("dynamics_reverse", "cbar"),
    "NB": ("setup_reverse", "cbar"),
    "NG": ("setup_reverse", "pbar"),
    "MOVING": ("dynamics_reverse", "tbar"),
}
"""Lengths of arguments, by function and argument; a compiled kernel's functions report their own."""

SIZES: Mapping[str, Callable[[Kernel], int]] = {
    "INTEGRALS": lambda kernel: kernel.integrals,
    "PEAKS": lambda kernel: kernel.peaks,
    "JUMPS": lambda kernel: len(kernel.jumps),
    "EVENTS": lambda kernel: len(kernel.events),
    "CLOCKS": lambda kernel: sum(event.clock for event in kernel.events),
    "KINKS": lambda kernel: sum(event.kink and not event.clock for event in kernel.events),
    "SWITCHES": lambda kernel: len(kernel.switches),
    "FINES": lambda kernel: len(kernel.fine),
    "SEEING": lambda kernel: len(kernel.guard_states),
    "TABLES": lambda kernel: len(kernel.tables),
    "RATE": lambda kernel: -1 if kernel.rate is None else kernel.rate,
    "C_SLOPES": lambda kernel: len(kernel.c_slopes),
}
"""Sizes of a kernel by name."""

INTEGERS: Mapping[str, Callable[[Kernel], Iterable[int]]] = {
    "JUMP": lambda kernel: kernel.jumps,
    "JUMP_BAR": lambda kernel: kernel.jump_bars,
    "JUMP_SLOPE": lambda kernel: kernel.jump_slopes,
    "SWITCH": lambda kernel: kernel.switches,
    "ENDS": lambda kernel: [event.ends for event in kernel.events],
    "KINK": lambda kernel: [event.kink for event in kernel.events],
    "MOVES": lambda kernel: kernel.moving or [False] * len(kernel.events),
    "GAP": lambda kernel: kernel.gaps,
    "CLOCK": lambda kernel: [event.clock for event in kernel.events],
    "SILENT": lambda kernel: [event.silent for event in kernel.events],
    "ROUTINE": lambda kernel: [event.routine for event in kernel.events],
    "FIXED": lambda kernel: [not moves for moves in kernel.moving] or [False] * len(kernel.events),
    "SEEN": lambda kernel: kernel.guard_states,
    "FINE": lambda kernel: [place for place, _, _ in kernel.fine],
    "TABLE_CURSOR": lambda kernel: [table.cursor for table in kernel.tables],
    "TABLE_FIRST": lambda kernel: [table.first for table in kernel.tables],
    "TABLE_WINDOW": lambda kernel: [table.window for table in kernel.tables],
    "TABLE_WIDTH": lambda kernel: [table.width for table in kernel.tables],
    "TABLE_NOISE": lambda kernel: [table.noise for table in kernel.tables],
    "C_BAR": lambda kernel: kernel.c_bars,
    "C_SLOPE": lambda kernel: kernel.c_slopes,
    # one row for each event, with one number more than there are switches
    "SETS": lambda kernel: [
        int(dict(event.sets).get(place, -1))
        for event in kernel.events
        for place in range(len(kernel.switches) + 1)
    ],
}
"""Tables of integers of a kernel."""

REALS: Mapping[str, Callable[[Kernel], Iterable[float]]] = {
    "FINE_STEP": lambda kernel: [step_s for _, step_s, _ in kernel.fine],
    "FINE_GROW": lambda kernel: [grow for _, _, grow in kernel.fine],
}
"""Tables of real numbers of a kernel."""


def constants_of(kernel: Kernel) -> str:
    """Sizes and tables of a kernel as constants in C++."""
    sizes = {name: size(kernel) for name, size in SIZES.items()}
    lines = [f"#define {name} {size}" for name, size in sizes.items()]
    present = {"EVENTS": kernel.events, "TABLES": kernel.tables, "RATE": kernel.rate is not None}
    lines += [f"#define WITH_{name}" for name, needed in present.items() if needed]
    for kind, tables in (("int", INTEGERS), ("double", REALS)):
        for name, table in tables.items():
            # one more, since an array has at least one
            row = ", ".join("INFINITY" if n == math.inf else repr(n + 0) for n in [*table(kernel), -1])
            lines.append(f"static const {kind} {name}[] = {{{row}}};")
    return "\n".join(lines)


LOOPS = ("machine", "generic", "steps", "tables", "events", "forward", "adjoint", "entries")
"""Headers of the loops that all scenes share, in the order of inclusion."""

PROCESSORS = {"x86_64": ("x86-64-v3", "x86-64")}
"""Processor types of each machine for which the loops are built, the faster first; others have one."""


def generic_source(package: Path) -> str:
    """Source of the loops that are the same for every scene: its numbers and tables are data.

    Args:
        package: Folder of the package ``spacerobot``.
    """
    names = [f"#define {name} int(scene->size[{k}])" for k, name in enumerate([*SIZES, *LENGTHS])]
    names += [f"#define {name} (scene->integers[{k}])" for k, name in enumerate(INTEGERS)]
    names += [f"#define {name} (scene->reals[{k}])" for k, name in enumerate(REALS)]
    names += [f"#define WITH_{name}" for name in ("EVENTS", "TABLES", "RATE")]
    names.append(f"#define FUNCTIONS(DO) {' '.join(f'DO({name})' for name in FUNCTIONS)}")
    headers = [package / "compiled/lanes.hpp", *(package / f"rollout/loops/{name}.hpp" for name in LOOPS)]
    texts = [header.read_text(encoding="utf-8") for header in headers]
    return "\n".join(["#define GENERIC", "#define LANES 1", texts[0], *names, *texts[1:]])


def built_file(package: Path, processor: str, source: str) -> Path:
    """Place of the loops that were built with the package, for a kind of processor and from a source."""
    digest = hashlib.sha256(source.encode()).hexdigest()[:16]
    return package / "rollout" / "built" / f"{processor}-{digest}.so"


def processors() -> tuple[str, ...]:
    """Kinds of processors that the loops are built for on this machine."""
    machine = platform.machine().lower()
    return PROCESSORS.get(machine, (machine,))
