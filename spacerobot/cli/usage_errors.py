"""Errors of the command line's arguments and options, in one line each.

Typer raises them as exceptions of Click. Their messages depend on its version: in recent ones Pydantic
converts the values and writes the message.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import typer

from spacerobot.cli.output import print_error
from spacerobot.common.errors import near_names

UsageError: type[Exception] = typer.BadParameter.__mro__[1]
"""Base class of errors of arguments and options in the installed version of Typer."""

ALLOWED = (
    (r"greater than or equal to (\S+)", "at least {}"),
    (r"less than or equal to (\S+)", "at most {}"),
    (r"in the range (.+?)\.?$", "{}"),
    (r"valid integer", "an integer"),
    (r"valid (?:number|float)", "a number"),
    (r"not one of (.+?)\.?$", "{}"),
)
"""Patterns of the messages of Click and Pydantic, and the values that they allow."""


def report_usage(error: Any, arguments: Sequence[str]) -> None:
    """Print an error in one line, or the help of a command group without a command.

    Args:
        error: Instance of :data:`UsageError`.
        arguments: Arguments of the command line.
    """
    if type(error).__name__ == "NoArgsIsHelpError":
        error.show()
    else:
        print_error(describe(error, arguments))


def describe(error: Any, arguments: Sequence[str]) -> str:
    """Message of an error: command, place, the value that was found, the allowed values and the remedy.

    Args:
        error: Instance of :data:`UsageError`.
        arguments: Arguments of the command line.

    Returns:
        str: One line.
    """
    context = error.ctx
    path = context.command_path if context is not None else "spacerobot"
    remedy = f"`{path} --help` explains the options"
    kind = type(error).__name__
    if kind == "MissingParameter":
        return f"{path}: {_name(error)} is missing{_example(context) or f'; {remedy}'}"
    if kind == "NoSuchOption":
        names = [name for param in context.command.params for name in (*param.opts, *param.secondary_opts)]
        hint = near_names(error.option_name, [name for name in names if name.startswith("--")])
        return f"{path}: no option {error.option_name!r}; {hint}"
    unknown = re.search(r"No such command '([^']*)'", error.message)
    if unknown:
        return f"{path}: no command {unknown[1]!r}; {near_names(unknown[1], context.command.commands)}"
    surplus = re.search(r"unexpected extra arguments? ?\(?s?\)? \((.*)\)", error.message)
    if surplus:
        usage = " ".join(context.command.collect_usage_pieces(context))
        return (
            f"{path}: found {surplus[1]!r} after the last argument, allowed: {path} {usage}; "
            "a value with spaces needs quotes"
        )
    if kind == "BadOptionUsage" and "requires" in error.message:
        return f"{error.option_name}: its value is missing; `spacerobot COMMAND --help` explains the options"
    name = _name(error)
    if not name:
        return f"{path}: {error.message}"
    for pattern, allowed in ALLOWED:
        bound = re.search(pattern, error.message)
        if bound:
            found = _value(error.param, arguments)
            return f"{name}: found {found!r}, allowed: {allowed.format(*bound.groups())}; {remedy}"
    return f"{name}: {error.message}"


def _name(error: Any) -> str:
    """Name of the option or argument with the error, or ``""``."""
    hint = getattr(error, "param_hint", None)
    param = getattr(error, "param", None)
    if hint:
        return str(hint if isinstance(hint, str) else " ".join(hint))
    if param is None:
        return ""
    if param.param_type_name == "argument":
        return str((param.metavar or param.name).upper())
    return str(max(param.opts, key=len))


def _value(param: Any, arguments: Sequence[str]) -> str:
    """Last value of an option in the arguments."""
    values = [""]
    for position, argument in enumerate(arguments):
        option, equals, value = argument.partition("=")
        if option in param.opts:
            values.append(value if equals else "".join(arguments[position + 1 : position + 2]))
    return values[-1]


def _example(context: Any) -> str:
    """First example of a command's help, as ``, as in `spacerobot run paper` ``."""
    text = re.sub(r"\[/?[^\]]*\]|\\\n", "", context.command.help or "")
    example = re.search(r"^ *(spacerobot .*(?:\n {8,}.*)*)", text, re.MULTILINE)
    return f", as in `{' '.join(example[1].split())}`" if example else ""
