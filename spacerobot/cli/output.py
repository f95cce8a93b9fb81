"""How the command line prints: tables on stdout, progress and errors on stderr."""

from __future__ import annotations

import contextlib
import sys
import textwrap
from collections.abc import Callable, Iterator, Sequence

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from spacerobot.progress import hearing

PLAIN_WIDTH = 140


class _Console(Console):
    """Console that leaves a closed pipe (``| head``) to the command line, instead of exiting with 1."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


def console() -> Console:
    """Console for results; where it is no terminal, lines are long enough not to break tables."""
    return _Console(highlight=False, width=None if sys.stdout.isatty() else PLAIN_WIDTH)


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
    said = first

    def say(words: str) -> None:
        nonlocal said
        said = words
        status.update(escape(words))

    def compiles(done: int, total: int) -> None:
        more = f" (compiling: {done} of {total} pieces done)" if done < total else ""
        status.update(escape(f"{said}{more}"))

    with Console(stderr=True).status(escape(first)) as status, hearing(compiles):
        yield say


def prose(text: str, indent: int = 0) -> None:
    """Text taken literally and broken between words, further lines indented by two more columns."""
    lines = textwrap.wrap(
        text, console().width - indent, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
    )
    console().print(textwrap.indent("\n".join(lines), " " * indent), markup=False, soft_wrap=True)


def table(
    title: str | None, headings: Sequence[str], rows: Sequence[Sequence[str]], *, whole: bool = False
) -> Table:
    """Plain table of literal texts; the first column keeps its lines whole, or else all the others do."""
    made = Table(
        title=escape(title) if title else None, title_justify="left", header_style="bold", box=SIMPLE_HEAD
    )
    for i, heading in enumerate(headings):
        made.add_column(escape(heading), overflow="fold", no_wrap=(i > 0) == whole)
    for row in rows:
        made.add_row(*(escape(cell) for cell in row))
    return made


def pairs(title: str, rows: Sequence[tuple[str, str]]) -> Table:
    """Two columns without a heading: names and values."""
    made = Table(title=escape(title), title_justify="left", show_header=False, box=None, pad_edge=False)
    made.add_column(style="bold", no_wrap=True)
    made.add_column(overflow="fold")
    for name, value in rows:
        made.add_row(escape(name), escape(value))
    return made
