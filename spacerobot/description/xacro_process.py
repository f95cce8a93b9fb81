"""Process that expands one xacro file: ``python -m spacerobot.description.xacro_process FILE SECONDS``.

The process writes the URDF, or an error in one line with exit code 3, to standard output. Three measures
confine the file. :mod:`spacerobot.description.xacro_expression` evaluates its expressions. An audit hook
prevents the execution of code, the start of processes, and access to files outside the file's folder (or ROS
package) and the packages named by ``$(find ...)``. Processor time, memory, elements and text are limited.
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
"""File that identifies the folder of a ROS package."""
REFUSED = 3
"""Exit code after an error whose message is on standard output."""


class Confinement:
    """Folders that may be read, and the audit hook that enforces this.

    Args:
        source: The xacro file.
    """

    def __init__(self, source: Path) -> None:
        self._source = source
        package = next((folder for folder in source.parents if (folder / MANIFEST).is_file()), source.parent)
        self._folders = [package.resolve()]
        self._packages = [package.name]

    def find(self, name: str) -> str:
        """Find the folder of a ROS package and permit its reading.

        Raises:
            ValueError: If there is no such package.
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
        """Whether a resolved path is in an allowed folder, or in the source folder of an allowed package."""
        sources = (f for f in path.parents if f.name in self._packages and (f / MANIFEST).is_file())
        return any(path.is_relative_to(folder) for folder in self._folders) or any(sources)

    def audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        """Audit hook of the interpreter; see :func:`sys.addaudithook`.

        Raises:
            PermissionError: If the event writes a file, or reads outside the allowed folders.
            RuntimeError: If the event executes code, imports a module or starts a process.
        """
        if event in ("open", "os.listdir", "os.scandir", "glob.glob"):
            path, mode = arguments[0], arguments[1] if event == "open" else None
            if isinstance(path, int) and not mode:
                return
            writes = isinstance(mode, str) and not set(mode) <= set("rbtU")
            place = os.fsdecode(path or ".") if isinstance(path, str | bytes | os.PathLike) else str(path)
            if event == "glob.glob":  # every folder that it lists causes a separate event
                return
            if writes or not self._may_read(Path(os.path.realpath(place))):
                raise PermissionError(
                    errno.EACCES, f"may read only in {', '.join(map(str, self._folders))}", place
                )
        elif event.partition(".")[0] in ("exec", "import", "os", "subprocess", "socket", "shutil", "ctypes"):
            detail = f" of {arguments[0]}" if event == "import" else ""
            raise RuntimeError(f"uses {event}{detail}, which a xacro file may not")


def _limit_elements() -> None:
    """Limit the number of XML elements that the process creates."""
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
    except ImportError:  # not on Windows, where the parent process ends this one after TIMEOUT_S
        return
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 1))
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY, MAX_MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _restrict(confinement: Confinement) -> Any:
    """Replace the evaluators of the xacro package, and its access to the environment and to packages.

    Raises:
        ValueError: If the version of the package lacks the replaced functions.
    """
    import xacro
    from xacro import substitution_args

    for module in ("yaml", "xml.dom.expatbuilder", "xml.parsers.expat"):
        importlib.import_module(module)  # the audit hook prevents later imports

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
    """Innermost cause of an xacro error, with the expression in which it occurred."""
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
    """Expand the file named on the command line, and return the exit code."""
    source = Path(sys.argv[1])
    output, sys.stdout = sys.stdout.buffer, sys.stderr  # prints of the file must not mix with the URDF
    confinement = Confinement(source)
    try:
        xacro = _restrict(confinement)
        _limit_resources(int(sys.argv[2]))
        _limit_elements()
        sys.addaudithook(confinement.audit)
        text: bytes = xacro.process_file(str(source), verbosity=0).toxml("utf-8")
        if len(text) > MAX_BYTES:
            raise ValueError(f"expands to {len(text)} bytes, allowed are {MAX_BYTES}")
    except Exception as error:  # the file, a program, may raise anything
        text, code = _message(error).encode("utf-8", "replace"), REFUSED
    else:
        code = 0
    output.write(text)
    output.flush()
    return code


if __name__ == "__main__":
    sys.exit(main())
