"""Expansion of xacro files, ROS's macro language for URDF, in a confined process."""

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
"""Processor time after which an expansion is ended [s]."""
TIMEOUT_S = 60
"""Wall time after which an expansion is ended [s]."""
_ENVIRONMENT = ("PATH", "LD_LIBRARY_PATH", "SYSTEMROOT", "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH")


def refuse_xacro(root: etree._Element, source: Path) -> None:
    """Check that a URDF file has no xacro elements.

    Raises:
        DescriptionError: If it has one; the message states the remedy.
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
    """Expand a xacro file with its default arguments to URDF text, indented and without comments.

    A xacro file is a program. It runs in a separate process, which may read only the file's folder (or its
    ROS package) and the packages named by ``$(find ...)``, and whose time, memory and output are limited; see
    :mod:`spacerobot.description.xacro_process`.

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
