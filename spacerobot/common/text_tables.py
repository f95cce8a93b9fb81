"""Tables and sentences as plain text, wrapped to the width of the terminal."""

from __future__ import annotations

import io
import itertools
import os
import sys
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.markup import escape
from rich.table import Table as RichTable
from rich.text import Text
from rich.tree import Tree as RichTree

from spacerobot.common.tables import Content, Tree

PLAIN_WIDTH = 140
"""Width of texts that are not printed in a terminal, in columns."""
LEAST_WIDTH = 20
"""Minimum width of texts, in columns, even if the terminal reports less."""
LEAST_PROSE = (16, 12, 9)
"""Minimum widths of long texts in a narrow table. The first one is used with which all columns fit, or else
the first of all."""
GAPS = (3, 2)
"""Width of padding and separator for each column of a table: as a rule, and where the table fits only so."""


def width_of_output() -> int | None:
    """Width of ``COLUMNS``, None in a terminal (its own width), or else :data:`PLAIN_WIDTH`."""
    columns = os.environ.get("COLUMNS", "")
    width = max(int(columns), LEAST_WIDTH) if columns.isdecimal() and int(columns) else None
    return width or (None if sys.stdout.isatty() else PLAIN_WIDTH)


def text_of(content: Iterable[Content]) -> str:
    """Text of tables and sentences, without colours."""
    output = io.StringIO()
    width = width_of_output() or Console().width
    print_content(content, Console(file=output, width=width, highlight=False, color_system=None))
    return "\n".join(line.rstrip() for line in output.getvalue().splitlines())


def print_content(content: Iterable[Content], console: Console) -> None:
    """Print tables and sentences on a console."""
    for part in content:
        if isinstance(part, str):
            prose(part, console)
        elif isinstance(part, Tree):
            console.print(tree(part))
        elif part.has_headings:
            console.print(TextTable(part.title, part.headings, part.rows, part.keys))
        elif any(len(row) > 1 for row in part.rows):
            if part.title:  # Rich would wrap it to the width of the rows
                console.print(escape(part.title), style="table.title")
            console.print(pairs(part.rows, console.width))
        else:
            console.print(f"\n{escape(part.title or '')}", style="bold")
            for (text,) in part.rows:
                prose(text, console, indent=2)


def prose(text: str, console: Console, indent: int = 0) -> None:
    """Print a text without markup, wrapped between words, with a hanging indent of two columns."""
    lines = textwrap.wrap(
        text, console.width - indent, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    console.print(textwrap.indent("\n".join(lines), " " * indent), markup=False, soft_wrap=True)


def tree(content: Tree) -> RichTree:
    """Rich tree with bold names."""
    rich_tree = RichTree(f"[bold]{escape(content.name)}[/] {escape(content.text)}".strip())
    for branch in content.branches:
        rich_tree.add(escape(branch) if isinstance(branch, str) else tree(branch))
    return rich_tree


@dataclass(frozen=True)
class TextTable:
    """Table of texts without markup, which shows every column at any width.

    Texts wrap between words. If the columns still do not fit, the table is printed in several blocks, each of
    which begins with the first columns.

    Attributes:
        title: Title above the table, or None.
        headings: Heading of each column.
        rows: Cells of each row.
        keys: Number of the first columns that identify a row and begin every block.
    """

    title: str | None
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    keys: int = 1

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the blocks of the table as Rich tables."""
        columns = list(zip(self.headings, *self.rows, strict=True))
        layouts = []
        for gap, prose in itertools.product(GAPS, LEAST_PROSE):
            bounds = [_bounds(column, prose) for column in columns]
            # indices of the columns in each block, by their minimum widths
            blocks = [list(range(self.keys))]
            for place in range(self.keys, len(bounds)):
                least = sum(bounds[other][0] + gap for other in (*blocks[-1], place))
                if least > options.max_width - 1 and len(blocks[-1]) > self.keys:
                    blocks.append(list(range(self.keys)))
                blocks[-1].append(place)
            layouts.append((gap, bounds, blocks))
        one_block = [layout for layout in layouts if len(layout[2]) == 1]
        # rather narrow gaps than cells that wrap
        unwrapped = [
            (gap, bounds, blocks)
            for gap, bounds, blocks in one_block
            if sum(max(bound[:2]) + gap for bound in bounds) < options.max_width
        ]
        gap, bounds, blocks = [*unwrapped, *one_block, layouts[0]][0]
        if self.title:  # as a title of Rich's table, it would wrap to the width of the columns
            yield Text(self.title, style="table.title")
        for places in blocks:
            room = options.max_width - 1 - gap * len(places)
            block = [columns[place] for place in places]
            rich_table = RichTable(
                header_style="bold",
                box=SIMPLE_HEAD,
                padding=(0, 1, 0, gap - 2),
            )
            for column, width in zip(block, _shared([bounds[place] for place in places], room), strict=True):
                rich_table.add_column(escape(column[0]), overflow="fold", width=width)
            for cells in zip(*(column[1:] for column in block), strict=True):
                rich_table.add_row(*map(escape, cells))
            yield rich_table


def pairs(rows: Sequence[Sequence[str]], width: int) -> RichTable:
    """Rich table of two columns without headings, names and values, in a width."""
    rich_table = RichTable(
        show_header=False,
        box=None,
        pad_edge=False,
    )
    columns = [("", *(row[k] for row in rows)) for k in (0, 1)]
    names, values = _shared([_bounds(column) for column in columns], width - 1)
    rich_table.add_column(style="bold", overflow="fold", width=names)
    rich_table.add_column(overflow="fold", width=values)
    for name, value in rows:
        rich_table.add_row(escape(name), escape(value))
    return rich_table


def _bounds(column: Sequence[str], prose: int = LEAST_PROSE[0]) -> tuple[int, int, int]:
    """Widths of a column: the minimum, that of the longest line in cells, and that of the longest line.

    The minimum breaks no word, and leaves long texts in cells a width of ``prose`` to wrap in.
    """
    word = max(cell_len(word) for text in column for word in (text.split() or [""]))
    lines = [max(map(cell_len, text.splitlines() or [""])) for text in column]
    cells = max(lines[1:], default=0)
    return max(word, min(cells, prose), 1), cells, max(lines)


def _shared(bounds: Sequence[tuple[int, int, int]], room: int) -> list[int]:
    """Widths of columns in a limited room.

    From their minimum widths, columns grow up to a common limit: first to the width of their cells, then to
    that of their headings, as long as the sum fits. If the minimum widths do not fit, the widest columns
    shrink.
    """
    widths = [least for least, _, _ in bounds]
    for kind in (1, 2):
        for limit in range(1, max(bound[kind] for bound in bounds) + 1):
            wider = [max(width, min(limit, b[kind])) for width, b in zip(widths, bounds, strict=True)]
            if sum(wider) > room:
                break
            widths = wider
    while sum(widths) > max(room, len(widths)):
        widths[widths.index(max(widths))] -= 1
    return widths
