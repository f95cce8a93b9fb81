"""Files written for xacro, the macro language of ROS, expanded where its package is installed."""

from __future__ import annotations

from pathlib import Path

from lxml import etree

from spacerobot.errors import DescriptionError

SUFFIX = ".xacro"


def needs_xacro(root: etree._Element, source: Path) -> bool:
    """Whether a file is named for xacro or holds an element of it."""
    return source.suffix == SUFFIX or any("xacro" in str(element.tag) for element in root.iter())


def expand_xacro(source: Path) -> bytes:
    """URDF text of a xacro file, its arguments at their defaults.

    A xacro file is a program, of Python expressions among others: expand only files that you trust.

    Raises
    ------
    DescriptionError
        If the ``xacro`` package is not installed or cannot expand the file.
    """
    try:
        import xacro
    except ImportError:
        raise DescriptionError(
            "belongs to xacro; `pip install 'spacerobot[xacro]'`, or run xacro on the file first",
            source=source,
        ) from None
    try:
        text: bytes = xacro.process_file(str(source), verbosity=0).toxml("utf-8")
    except Exception as error:  # whatever the program in the file raises
        hint = "; `$(find ...)` needs ROS" if getattr(error, "name", "") == "ament_index_python" else ""
        raise DescriptionError(f"xacro cannot expand it: {error}{hint}", source=source) from None
    return text
