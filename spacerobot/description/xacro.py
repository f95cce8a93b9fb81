"""Files written for xacro, the macro language of ROS, expanded in a confined process."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
from pathlib import Path

from lxml import etree

from spacerobot.common.errors import DescriptionError
from spacerobot.description.syntax import parse_xml

SUFFIX = ".xacro"
MAX_CPU_S = 10
"""Processor time after which an expansion is stopped [s]."""
TIMEOUT_S = 60
"""Duration after which it is stopped, whatever it waits for [s]."""
_ENVIRONMENT = ("PATH", "LD_LIBRARY_PATH", "SYSTEMROOT", "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")


def refuse_xacro(root: etree._Element, source: Path) -> None:
    """Refuse xacro elements in a file that is no xacro file.

    Raises:
        DescriptionError: With the first of them, and how to mend it.
    """
    for element in root.iter():
        if "xacro" in str(element.tag):
            name = f"xacro:{str(element.tag).rpartition('}')[2].removeprefix('xacro:')}"
            raise DescriptionError(
                f"found <{name}>, allowed in files named *{SUFFIX} only: rename it to "
                f"{source.stem}.urdf{SUFFIX}, or expand it first by `xacro {source.name} > expanded.urdf`",
                source=source,
                where=f"line {element.sourceline}",
            )


def expand_xacro(source: Path) -> str:
    """URDF text of a xacro file, indented and without comments, its arguments at their defaults.

    The file is a program. It runs in a process of its own, which may read the file's folder (or its ROS
    package) and the packages that ``$(find ...)`` names, and whose time, memory and output are limited;
    see :mod:`spacerobot.description.xacro_process`.

    Raises:
        DescriptionError: If the ``xacro`` package is not installed or cannot expand the file, or the file
            exceeds a limit.
    """
    from spacerobot.description.xacro_process import REFUSED

    if importlib.util.find_spec("xacro") is None:
        raise DescriptionError(
            "belongs to xacro; `pip install 'spacerobot[xacro]'`, or run xacro on the file first",
            source=source,
        )
    environment = {name: os.environ[name] for name in _ENVIRONMENT if name in os.environ}
    environment |= {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path), "PYTHONUTF8": "1"}
    command = [
        sys.executable,
        "-P",
        "-m",
        "spacerobot.description.xacro_process",
        str(source),
        str(MAX_CPU_S),
    ]
    try:
        completed = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=TIMEOUT_S,
            env=environment,
            check=False,
        )
    except subprocess.TimeoutExpired:
        message = f"it takes longer than {TIMEOUT_S} s"
    except OSError as error:
        message = error.strerror or str(error)
    else:
        if completed.returncode == 0:
            root = parse_xml(completed.stdout, source)
            etree.indent(root)
            text: str = etree.tostring(root, encoding="unicode")
            return text
        message = f"its process ended with code {completed.returncode}"
        if completed.returncode == REFUSED:
            message = completed.stdout.decode("utf-8", "replace")
        elif completed.returncode in (-getattr(signal, "SIGXCPU", 0), -getattr(signal, "SIGKILL", 0)):
            message = f"it takes more than {MAX_CPU_S} s of processor time"
    raise DescriptionError(f"xacro cannot expand it: {message}", source=source)
