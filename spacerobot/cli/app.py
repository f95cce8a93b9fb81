"""Entry point of the command line.

Each command is in a separate module and imports its packages when it runs, so that help is shown at once.
"""

from __future__ import annotations

import functools
import os
import sys
import textwrap
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, TextIO

import typer
from rich.console import Console
from rich.markup import escape

from spacerobot.cli.command import GROUPS
from spacerobot.cli.output import print_error, warn
from spacerobot.cli.usage_errors import UsageError, report_usage
from spacerobot.common.errors import SpaceRobotError, SpaceRobotWarning
from spacerobot.common.interrupts import INTERRUPTED, minded, reason
from spacerobot.common.registry import COMMANDS
from spacerobot.common.text_tables import LEAST_WIDTH

EXAMPLE_INDENT = 4


def _show_version(requested: bool) -> None:
    if requested:
        from spacerobot.common.version import __version__

        typer.echo(__version__)
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
    plugin: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            help="Python file that registers kinds of elements; it is run. Repeatable; any position.",
        ),
    ] = None,
) -> None:
    del version
    if plugin:
        from spacerobot.elements import load_plugin

        for file in plugin:
            load_plugin(file)


def application() -> typer.Typer:
    """Typer application with all commands."""
    app = typer.Typer(
        name="spacerobot",
        help="Robot arms on floating bases that capture and carry an object: simulate, tune, plan, show.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
        rich_markup_mode="rich",
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(_options)
    for command in sorted(COMMANDS.entries().values(), key=lambda command: GROUPS.index(command.group)):
        command.join(app)
    return app


app = application()


@functools.cache
def command_line() -> Any:
    """Click group of all commands, built at the first call."""
    return escaped(typer.main.get_command(app))


def escaped(command: Any) -> Any:
    """Escape the help texts of a command and its subcommands, so that ``[m]`` is not markup.

    Switches get no type, which Typer would show as ``<bool>``.
    """
    if command.help:
        command.help = help_markup(command.help)
    help_option = command.get_help_option

    def help_option_without_type(context: Any) -> Any:
        option = help_option(context)
        if option is not None:
            option.metavar = ""
        return option

    command.get_help_option = help_option_without_type
    for option in command.params:
        if getattr(option, "is_flag", False):
            option.metavar = ""
        help_text = getattr(option, "help", None)
        if help_text:
            option.help = escape(help_text)
    for below in getattr(command, "commands", {}).values():
        escaped(below)
    return command


def help_markup(text: str) -> str:
    """Markup of a command's help: paragraphs in single lines, which wrap, and examples to be copied.

    An example wider than the terminal is continued after a backslash. Its indentation follows a tag, since
    Typer removes common indentation.
    """
    width = max(Console().width, LEAST_WIDTH) - 2 * EXAMPLE_INDENT
    paragraphs = []
    for paragraph in textwrap.dedent(text).strip().split("\n\n"):
        if not paragraph.startswith(" "):
            paragraphs.append(escape(" ".join(paragraph.split())))
            continue
        lines = textwrap.wrap(
            " ".join(paragraph.split()),
            width,
            subsequent_indent=" " * EXAMPLE_INDENT,
            break_long_words=False,
            break_on_hyphens=False,
        )
        indent = f"[not bold]{' ' * EXAMPLE_INDENT}[/]"
        paragraphs.append(" \\\n".join(indent + escape(line) for line in lines))
    return "\n\n".join(paragraphs)


def plugins_first(arguments: Sequence[str]) -> list[str]:
    """Arguments with all options ``--plugin FILE`` moved before the command, where they are global.

    Options after a command with an own ``--plugin``, such as ``new``, are not moved.
    """
    front: list[str] = []
    rest: list[str] = []
    waiting = iter(arguments)
    for argument in waiting:
        command = command_line().commands.get(rest[0]) if rest else None
        has_option = command is not None and any("--plugin" in option.opts for option in command.params)
        if argument == "--" or has_option:
            return [*front, *rest, argument, *waiting]
        if argument == "--plugin":
            front += [argument, *(file for file in [next(waiting, None)] if file is not None)]
        elif argument.startswith("--plugin="):
            front.append(argument)
        else:
            rest.append(argument)
    return front + rest


_show_any = warnings.showwarning


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Print a ``SpaceRobotWarning`` in one line, and other warnings in Python's form."""
    if issubclass(category, SpaceRobotWarning):
        warn(str(message))
    else:
        _show_any(message, category, filename, lineno, file, line)


def main() -> None:
    """Run the command line; an error that the user can correct ends it with one line and an exit code."""
    warnings.showwarning = _show_warning
    try:
        with minded():
            arguments = plugins_first(sys.argv[1:])
            sys.exit(command_line()(arguments, prog_name="spacerobot", standalone_mode=False) or 0)
    except UsageError as fault:
        report_usage(fault, arguments)
        sys.exit(2)
    except SpaceRobotError as fault:
        print_error(str(fault))
        sys.exit(fault.exit_code)
    except (KeyboardInterrupt, typer.Abort):
        print_error(reason())
        sys.exit(INTERRUPTED)
    except BrokenPipeError:
        # the pipe's reader (head, less) has ended
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except ImportError as fault:
        # Pinocchio's wheel needs OpenMP from the system, which a minimal container lacks
        if "cannot open shared object file" not in str(fault):
            raise
        library = str(fault).split(":")[0]
        print_error(
            f"{library} is missing on this system, and {fault.name or 'a compiled package'} needs it. "
            "Install it with the system's package manager (libgomp.so.1: `apt install libgomp1`), or, if it "
            "belongs to a Python package, install that again (`pip install --upgrade --force-reinstall pin`)."
        )
        sys.exit(2)
    except OSError as fault:
        print_error(f"{fault.filename or 'file system'}: {fault.strerror or fault}")
        sys.exit(2)
