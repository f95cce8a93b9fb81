"""Output of the command line: tables on stdout, progress and errors on stderr."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator

from rich.console import Console
from rich.markup import escape
from rich.text import Text

from spacerobot.common.progress import hearing
from spacerobot.common.tables import Content
from spacerobot.common.tabular import Tabular
from spacerobot.common.text_tables import print_content, width_of_output


class _Console(Console):
    """Console that raises ``BrokenPipeError`` for a closed pipe (``| head``), instead of exiting with 1."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


def console() -> Console:
    """Console for results with the width of ``COLUMNS``, of the terminal, or else :data:`PLAIN_WIDTH`."""
    return _Console(highlight=False, width=width_of_output())


NARROW = 96
"""Columns below which tables omit intervals and lesser columns."""


QUIET_S = 30.0
"""Minimum time between two lines of progress where stderr is no terminal [s]."""


def is_narrow() -> bool:
    """Whether the terminal is narrower than :data:`NARROW`."""
    return console().width < NARROW


def print_error(message: str) -> None:
    """Print an error on stderr in one line, without wrapping."""
    line = " ".join(message.split())
    Console(stderr=True, highlight=False, soft_wrap=True).print(
        Text("error: ", style="bold red") + Text(line)
    )


def warn(message: str) -> None:
    """Print a warning on stderr in one line, without wrapping."""
    line = " ".join(message.split())
    Console(stderr=True, highlight=False, soft_wrap=True).print(
        Text("warning: ", style="yellow") + Text(line)
    )


@contextlib.contextmanager
def progress(first: str) -> Iterator[Callable[[str], None]]:
    """Show a spinner with the present step and compilations on stderr.

    If stderr is no terminal, as in a batch job, a line states the step at most every
    :data:`QUIET_S` seconds.

    Args:
        first: Text of the first step.

    Yields:
        Function that shows another text.
    """
    text, printed = first, time.monotonic()
    console_of_errors = Console(stderr=True)

    def say(words: str) -> None:
        nonlocal text, printed
        text = words
        status.update(escape(words))
        if not console_of_errors.is_terminal and time.monotonic() - printed >= QUIET_S:
            printed = time.monotonic()
            console_of_errors.print(words, markup=False, soft_wrap=True)

    def compiles(done: int, total: int) -> None:
        more = f" (compiling: {done} of {total} pieces done)" if done < total else ""
        status.update(escape(f"{text}{more}"))

    with console_of_errors.status(escape(first)) as status, hearing(compiles):
        yield say


def print_next(text: str) -> None:
    """Print the files that a command wrote and the next commands, so that lines can be copied.

    In a terminal that is narrower than the text, each command begins a line.
    """
    if len(text) > console().width:
        text = text.replace("; `", "\n`")
    console().print(text, markup=False, soft_wrap=True)


def show(content: Tabular | Iterable[Content]) -> None:
    """Print tables and sentences, after the warnings of a result."""
    if isinstance(content, Tabular):
        for text in content.notices():
            warn(text)
        content = content.content()
    print_content(content, console())
