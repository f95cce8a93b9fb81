"""Tables, trees and sentences that present results in the terminal, on pages and in notebooks."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """Table of texts.

    Attributes:
        title: Title of the table, or None.
        headings: Heading of each column; empty for a table of names and values.
        rows: Cells of each row.
        keys: Number of the first columns that name a row.
    """

    title: str | None
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    keys: int = 1

    @classmethod
    def of_pairs(cls, title: str | None, rows: Iterable[tuple[str, object]]) -> Table:
        """Table of names and values; rows with an empty value are omitted.

        Args:
            title: Title of the table.
            rows: Names and values, which are converted by ``str``.
        """
        return cls(title, (), [(name, str(value)) for name, value in rows if value != ""])

    @property
    def has_headings(self) -> bool:
        """Whether any column has a heading."""
        return any(self.headings)

    def html(self) -> str:
        """HTML of the table; all texts are escaped."""

        def cells(tag: str, scope: str, texts: Iterable[str]) -> str:
            attributes = f" scope='{scope}' style='text-align:left'" if scope else ""
            return "".join(f"<{tag}{attributes}>{breakable(text)}</{tag}>" for text in texts)

        caption = f"<caption><span>{escape(self.title)}</span></caption>" if self.title else ""
        head = f"<thead><tr>{cells('th', 'col', self.headings)}</tr></thead>" if self.has_headings else ""
        body = "".join(
            f"<tr>{cells('th', 'row', [first])}{cells('td', '', others)}</tr>" for first, *others in self.rows
        )
        return f"<div class='wide'><table>{caption}{head}<tbody>{body}</tbody></table></div>"

    def markdown(self) -> str:
        """Markdown of the table, without its title."""
        lines = [self.headings, ("---",) * len(self.headings), *self.rows]
        return "\n".join(
            "| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines
        )


@dataclass(frozen=True)
class Tree:
    """Tree of texts.

    Attributes:
        name: Name of the root, emphasised.
        text: Text after the name.
        branches: Subtrees and texts below it.
    """

    name: str
    text: str = ""
    branches: Sequence[Tree | str] = ()

    def html(self) -> str:
        """HTML of the tree; all texts are escaped."""
        items = "".join(
            f"<li>{escape(one) if isinstance(one, str) else one.html()}</li>" for one in self.branches
        )
        return f"<b>{escape(self.name)}</b> {escape(self.text)}" + (f"<ul>{items}</ul>" if items else "")


Content = Table | Tree | str
"""Table, tree, or sentence as plain text."""


def content_html(content: Iterable[Content]) -> str:
    """HTML of tables and sentences; all texts are escaped."""
    return "".join(f"<p>{escape(part)}</p>" if isinstance(part, str) else part.html() for part in content)


ROTORS = ("wheel_speed", "motor_speed")
"""Signals that are speeds of rotors."""


def unit_scale(unit: str, signal: str = "") -> tuple[float, str]:
    """Factor and unit for display of an SI unit: mm for m, degrees for radians, rpm for rotors.

    Args:
        unit: SI unit of the values.
        signal: Name of the signal, or empty.
    """
    degrees = 180 / math.pi
    if unit == "rad/s" and signal in ROTORS:
        return 30 / math.pi, "rpm"
    scales = {"m": (1e3, "mm"), "rad": (degrees, "deg"), "rad/s": (degrees, "deg/s")}
    return scales.get(unit, (1.0, unit))


def unit_of_joint(unit: str, kind: str) -> str:
    """Unit of a joint's number: of ``rad or m`` the second for a prismatic joint, otherwise the first."""
    first, _, second = unit.partition(" or ")
    return second if second and kind == "prismatic" else first


_NAME_PARTS = re.compile(r"(?<=[\w*][._])(?=[A-Za-z*])|(?<=\w\w/)(?=\w{3})")
"""Ends of the parts of a dotted path or a name; neither in numbers nor in units such as deg/s."""


def breakable(text: str) -> str:
    """HTML of a text that a narrow page may break after the dots, slashes and underscores of names."""
    return _NAME_PARTS.sub("<wbr>", escape(text))


def escape(text: str) -> str:
    """Text with HTML's special characters escaped."""
    return html.escape(str(text), quote=True)
