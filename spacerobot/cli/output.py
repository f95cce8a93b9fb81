"""Output of the command line: tables on stdout, progress and errors on stderr."""

from __future__ import annotations

import contextlib
import os
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.markup import escape
from rich.table import Table as RichTable
from rich.text import Text
from rich.tree import Tree as RichTree

from spacerobot.common.progress import hearing
from spacerobot.common.tables import Content, Tabular, Tree

PLAIN_WIDTH = 140
LEAST_WIDTH = 20
"""Columns that every text is given, however narrow the terminal says it is."""


class _Console(Console):
    """Console that leaves a closed pipe (``| head``) to the command line, instead of exiting with 1."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


def console() -> Console:
    """Console for results, as wide as ``COLUMNS`` says, else as the terminal, else long enough for tables."""
    columns = os.environ.get("COLUMNS", "")
    width = max(int(columns), LEAST_WIDTH) if columns.isdecimal() and int(columns) else None
    return _Console(highlight=False, width=width or (None if sys.stdout.isatty() else PLAIN_WIDTH))


def print_error(message: str) -> None:
    """One line on stderr, never wrapped, whatever it holds."""
    line = " ".join(message.split())
    Console(stderr=True, highlight=False, soft_wrap=True).print(
        Text("error: ", style="bold red") + Text(line)
    )


def warn(message: str) -> None:
    """One line on stderr for a warning."""
    line = " ".join(message.split())
    Console(stderr=True, highlight=False, soft_wrap=True).print(
        Text("warning: ", style="yellow") + Text(line)
    )


@contextlib.contextmanager
def progress(first: str) -> Iterator[Callable[[str], None]]:
    """Spinner on stderr that says what is being done and compiled; silent where stderr is no terminal."""
    text = first

    def say(words: str) -> None:
        nonlocal text
        text = words
        status.update(escape(words))

    def compiles(done: int, total: int) -> None:
        more = f" (compiling: {done} of {total} pieces done)" if done < total else ""
        status.update(escape(f"{text}{more}"))

    with Console(stderr=True).status(escape(first)) as status, hearing(compiles):
        yield say


def prose(text: str, indent: int = 0) -> None:
    """Text taken literally and broken between words, further lines indented by two more columns."""
    lines = textwrap.wrap(
        text, console().width - indent, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    console().print(textwrap.indent("\n".join(lines), " " * indent), markup=False, soft_wrap=True)


LEAST_PROSE = (16, 12, 9)
"""Columns that a long text keeps in a narrow table: the most with which all columns fit, else the first."""
GAP = 3
"""Columns that a table needs beside each of its columns: padding on both sides and a separator."""


def show(content: Tabular | Iterable[Content]) -> None:
    """Print tables and sentences, and the warnings about what is presented."""
    if isinstance(content, Tabular):
        for text in content.notices():
            warn(text)
        content = content.content()
    for part in content:
        if isinstance(part, str):
            prose(part)
        elif isinstance(part, Tree):
            console().print(tree(part))
        elif part.has_headings:
            console().print(table(part.title, part.headings, part.rows, keys=part.keys))
        elif any(len(row) > 1 for row in part.rows):
            console().print(pairs(part.title, part.rows))
        else:
            console().print(f"\n{escape(part.title or '')}", style="bold")
            for (text,) in part.rows:
                prose(text, indent=2)


def tree(content: Tree) -> RichTree:
    """Tree whose names are bold."""
    rich_tree = RichTree(f"[bold]{escape(content.name)}[/] {escape(content.text)}".strip())
    for branch in content.branches:
        rich_tree.add(escape(branch) if isinstance(branch, str) else tree(branch))
    return rich_tree


def table(
    title: str | None, headings: Sequence[str], rows: Sequence[Sequence[str]], *, keys: int = 1
) -> TextTable:
    """Table of literal texts; the first ``keys`` columns name a row, and are repeated where it is cut."""
    return TextTable(title, headings, rows, keys)


@dataclass(frozen=True)
class TextTable:
    """Table of literal texts that shows every column at every width.

    Texts wrap between words. Where the columns do not fit side by side even so, the table is printed in
    blocks below one another, each of which begins with the first columns.

    Attributes:
        title: Printed above it, if any.
        headings: One for each column.
        rows: As many cells each.
        keys: How many of the first columns name a row; every block begins with them.
    """

    title: str | None
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    keys: int = 1

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield its blocks."""
        columns = list(zip(self.headings, *self.rows, strict=True))
        layouts = []
        for prose in LEAST_PROSE:
            bounds = [_bounds(column, prose) for column in columns]
            # places of the columns of each block, from the least width of each column
            blocks = [list(range(self.keys))]
            for place in range(self.keys, len(bounds)):
                least = sum(bounds[other][0] + GAP for other in (*blocks[-1], place))
                if least > options.max_width - 1 and len(blocks[-1]) > self.keys:
                    blocks.append(list(range(self.keys)))
                blocks[-1].append(place)
            layouts.append((bounds, blocks))
        bounds, blocks = next((layout for layout in layouts if len(layout[1]) == 1), layouts[0])
        for k, places in enumerate(blocks):
            room = options.max_width - 1 - GAP * len(places)
            block = [columns[place] for place in places]
            rich_table = RichTable(
                title=escape(self.title) if self.title and k == 0 else None,
                title_justify="left",
                header_style="bold",
                box=SIMPLE_HEAD,
            )
            for column, width in zip(block, _shared([bounds[place] for place in places], room), strict=True):
                rich_table.add_column(escape(column[0]), overflow="fold", width=width)
            for cells in zip(*(column[1:] for column in block), strict=True):
                rich_table.add_row(*map(escape, cells))
            yield rich_table


def pairs(title: str | None, rows: Sequence[Sequence[str]]) -> RichTable:
    """Two columns without a heading: names and values."""
    rich_table = RichTable(
        title=escape(title) if title else None,
        title_justify="left",
        show_header=False,
        box=None,
        pad_edge=False,
    )
    columns = [("", *(row[k] for row in rows)) for k in (0, 1)]
    names, values = _shared([_bounds(column) for column in columns], console().width - 1)
    rich_table.add_column(style="bold", overflow="fold", width=names)
    rich_table.add_column(overflow="fold", width=values)
    for name, value in rows:
        rich_table.add_row(escape(name), escape(value))
    return rich_table


def _bounds(column: Sequence[str], prose: int = LEAST_PROSE[0]) -> tuple[int, int, int]:
    """Widths of a heading and its cells: the least, that of the cells' longest line, that of all.

    The least breaks no word, and leaves the cells' longer texts some columns to wrap in.
    """
    word = max(cell_len(word) for text in column for word in (text.split() or [""]))
    lines = [max(map(cell_len, text.splitlines() or [""])) for text in column]
    cells = max(lines[1:], default=0)
    return max(word, min(cells, prose), 1), cells, max(lines)


def _shared(bounds: Sequence[tuple[int, int, int]], room: int) -> list[int]:
    """Width of each column: what its cells need, then its heading, up to one limit for all that fits.

    A word that is wider than all the room is folded.
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
