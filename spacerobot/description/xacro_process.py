"""Process that expands one xacro file: ``python -m spacerobot.description.xacro_process FILE SECONDS``.

The URDF goes to standard output; after an error its one line does, with exit code 3. Three layers confine the
file. Its expressions are evaluated by :mod:`spacerobot.description.xacro_expression`. An audit hook refuses
whatever executes code, starts processes or opens files outside the file's own folder (its ROS package, if it
is in one) and the packages that ``$(find ...)`` names. Processor time, memory, elements and text are limited.
"""

from __future__ import annotations

import errno
import importlib
import os
import sys
from pathlib import Path
from typing import Any
from xml.dom import minidom

from spacerobot.description.find import find_package
from spacerobot.description.xacro_expression import WITHHELD, evaluate

MAX_MEMORY = 1 << 30
MAX_ELEMENTS = 30_000
MAX_BYTES = 2_000_000
MANIFEST = "package.xml"
"""File by which the folder of a ROS package is known."""
REFUSED = 3
"""Exit code after an error that standard output names."""


class Confinement:
    """Folders that may be read, and the audit hook that holds the process to them.

    Args:
        source: The xacro file.
    """

    def __init__(self, source: Path) -> None:
        self._source = source
        package = next((folder for folder in source.parents if (folder / MANIFEST).is_file()), source.parent)
        self._folders = [package.resolve()]
        self._packages = [package.name]

    def find(self, name: str) -> str:
        """Folder of a ROS package, which may be read from now on.

        Raises:
            ValueError: If there is none.
        """
        folder = find_package(name, self._source)
        if folder is None:
            raise ValueError(
                f"no package {name!r}: no folder of that name with a {MANIFEST} above the file, in "
                "ROS_PACKAGE_PATH or in AMENT_PREFIX_PATH"
            )
        self._folders.append(folder.resolve())
        self._packages.append(name)
        return str(folder)

    def _may_read(self, path: Path) -> bool:
        """Whether a resolved path lies in an allowed folder, or is linked from a package into its sources."""
        sources = (f for f in path.parents if f.name in self._packages and (f / MANIFEST).is_file())
        return any(path.is_relative_to(folder) for folder in self._folders) or any(sources)

    def audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Refuse an event of the interpreter; see :func:`sys.addaudithook`.

        Raises:
            PermissionError: If it reads elsewhere.
            RuntimeError: If it is no reading at all.
        """
        if event in ("open", "os.listdir", "os.scandir", "glob.glob"):
            path, mode = arguments[0], arguments[1] if event == "open" else None
            if isinstance(path, int) and not mode:
                return
            writes = isinstance(mode, str) and not set(mode) <= set("rbtU")
            place = os.fsdecode(path or ".") if isinstance(path, str | bytes | os.PathLike) else str(path)
            if event == "glob.glob":  # each folder that it lists is an event of its own
                return
            if writes or not self._may_read(Path(os.path.realpath(place))):
                raise PermissionError(
                    errno.EACCES, f"may read only in {', '.join(map(str, self._folders))}", place
                )
        elif event.partition(".")[0] in ("exec", "import", "os", "subprocess", "socket", "shutil", "ctypes"):
            detail = f" of {arguments[0]}" if event == "import" else ""
            raise RuntimeError(f"uses {event}{detail}, which a xacro file may not")


def _limit_elements() -> None:
    """Count the elements that are created."""
    create = minidom.Element.__init__
    count = 0

    def counted(self: minidom.Element, *arguments: Any, **named: Any) -> None:
        nonlocal count
        count += 1
        if count > MAX_ELEMENTS:
            raise ValueError(f"creates more than {MAX_ELEMENTS} elements")
        create(self, *arguments, **named)

    minidom.Element.__init__ = counted  # type: ignore[method-assign]


def _limit_resources(cpu_s: int) -> None:
    try:
        import resource
    except ImportError:  # Windows has none; there the waiting process ends it after a time
        return
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 1))
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _restrict(confinement: Confinement) -> Any:
    """Replace the xacro package's evaluators and its access to environment and packages.

    Raises:
        ValueError: If the package's version has others.
    """
    import xacro
    from xacro import substitution_args

    for module in ("yaml", "xml.dom.expatbuilder", "xml.parsers.expat"):
        importlib.import_module(module)  # imports are refused later on

    def refuse_environment(name: str) -> str:
        raise ValueError(
            f"reads the environment variable {name}; use an argument or $(optenv {name} DEFAULT)"
        )

    def evaluate_argument(text: str, context: dict[str, Any]) -> str:
        arguments = context.get("arg", {})
        converted = {
            name: substitution_args.convert_value(value, "auto") for name, value in arguments.items()
        }
        return str(evaluate(text, {**xacro._global_symbols, "arg": converted.get, **converted}))

    replacements = (
        (xacro, "safe_eval", evaluate),
        (substitution_args, "_eval", evaluate_argument),
        (substitution_args, "_eval_env", refuse_environment),
        (substitution_args, "_eval_optenv", lambda _, default="": default),
        (substitution_args, "_eval_find", confinement.find),
    )
    for module, name, replacement in replacements:
        if not hasattr(module, name):
            raise ValueError("its version cannot be confined; `pip install 'xacro>=2.1'`")
        setattr(module, name, replacement)
    for name in WITHHELD:
        dict.pop(xacro._global_symbols["python"], name, None)
    return xacro


def _message(error: BaseException) -> str:
    """Innermost cause of an error of xacro, and the expression that it occurred in."""
    place = ""
    while isinstance(cause := getattr(error, "exc", None), Exception):
        error, place = cause, getattr(error, "suffix", None) or place
    if isinstance(error, MemoryError):
        reason = f"needs more than {MAX_MEMORY >> 20} MiB of memory"
    elif isinstance(error, RecursionError):
        reason = "nested too deeply"
    elif isinstance(error, OSError) and error.filename:
        reason = f"{error.filename}: {error.strerror}"
    else:
        reason = str(error)
    return f"{reason} {place}"


def main() -> int:
    """Expand the file that the command line names."""
    source = Path(sys.argv[1])
    output, sys.stdout = sys.stdout.buffer, sys.stderr  # what the file prints is no URDF
    confinement = Confinement(source)
    try:
        xacro = _restrict(confinement)
        _limit_resources(int(sys.argv[2]))
        _limit_elements()
        sys.addaudithook(confinement.audit)
        text: bytes = xacro.process_file(str(source), verbosity=0).toxml("utf-8")
        if len(text) > MAX_BYTES:
            raise ValueError(f"expands to {len(text)} bytes, allowed are {MAX_BYTES}")
    except Exception as error:  # whatever the program in the file raises
        text, code = _message(error).encode("utf-8", "replace"), REFUSED
    else:
        code = 0
    output.write(text)
    output.flush()
    return code


if __name__ == "__main__":
    sys.exit(main())
