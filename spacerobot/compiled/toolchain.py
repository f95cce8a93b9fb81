"""The C++ compiler, its options, and the processor it builds for."""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import os
import platform
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from spacerobot.common.errors import CompileError
from spacerobot.common.interrupts import uninterrupted

FLAGS = (
    "-std=c++17",
    "-O3",
    "-ffp-contract=fast",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-freciprocal-math",  # the articulated-body algorithm divides by each joint's inertia several times
    "-w",
)

GCC_FLAGS = (
    "-fschedule-insns",
    "-fsched-pressure",  # order 3000 operations in a row for few spilled registers
    "-fno-gnu-unique",  # else a library that is loaded later would read the tables of the first one's method
)

ZIG_FLAGS = ("-fno-sanitize=all",)  # it adds run-time checks unless told otherwise

BARE = (("-DNO_RUNTIME", "-fno-exceptions"), ("-nostdlib",))
"""How zig compiles and links without the run-time libraries of C++, which it would build first in minutes."""

SUFFIX = {"darwin": ".dylib", "win32": ".dll"}.get(sys.platform, ".so")
"""How the name of a shared library ends here."""

PROCESS_GROUP = 0 if os.name == "posix" else None
"""Process group of a compiler: a new one, so that it can be ended with what it started."""

ANSWER_S = 30.0
"""Time after which a compiler that is asked for its version or macros is held to hang [s]."""

NO_COMPILER = (
    "no C++ compiler was found (g++, clang++, CXX or SPACEROBOT_COMPILER); "
    "`pip install 'spacerobot[compiler]'` brings one"
)


@dataclass(frozen=True)
class Toolchain:
    """Everything besides the source that decides what a compiled library holds.

    Attributes:
        command: The C++ compiler: its path, and arguments that belong to its name.
        version: First line of its version report.
        flags: Its arguments for a source.
        libraries: Its last arguments when linking.
        processor: Model and instruction sets of the processor, since the code is built for this one.
        lanes: Doubles that one vector register holds: 8 with AVX-512, 4 with AVX, 2 otherwise.
        vector_symbols: Routines of the vector maths library for so many lanes, by function name; empty where
            it is missing.
    """

    command: tuple[str, ...]
    version: str
    flags: tuple[str, ...]
    libraries: tuple[str, ...]
    processor: str
    lanes: int
    vector_symbols: Mapping[str, str]

    @property
    def name(self) -> str:
        """The compiler's name for a message."""
        return "ziglang" if self.is_zig else Path(self.command[0]).name

    @property
    def is_zig(self) -> bool:
        """Whether it is the compiler of the ``ziglang`` package."""
        return self.command == ZIG

    @property
    def identity(self) -> tuple[str, str, str]:
        """Version, arguments and processor: with the source they decide what a library holds."""
        return self.version, " ".join([*self.command, *self.flags, *self.libraries]), self.processor

    @property
    def cold_flags(self) -> tuple[str, ...]:
        """Arguments for a source that runs seldom."""
        return tuple("-O1" if flag == "-O3" else flag for flag in self.flags)

    @property
    def portable(self) -> Toolchain:
        """The same compiler for libraries that other programs load on other machines.

        The code runs on every processor of this machine's kind, needs nothing of the C++ runtime and hides
        the symbols that it does not export by name. Arguments of ``SPACEROBOT_COMPILER_FLAGS`` still hold.
        """
        baseline = "x86_64" if self.is_zig else "x86-64"
        general = {"-march=native": f"-march={baseline}", "-mcpu=native": "-mcpu=generic"}
        flags = [general.get(flag, flag) for flag in self.flags if flag not in BARE[0]]
        libraries = tuple(library for library in self.libraries if "libmvec" not in library)
        return replace(
            self,
            flags=(*flags, *BARE[0], "-fvisibility=hidden"),
            libraries=(*libraries, "-s") if self.is_zig else ("-Wl,--as-needed", *libraries, "-s"),
            processor=platform.machine(),
            lanes=1,
            vector_symbols=MappingProxyType({}),
        )

    @property
    def summary(self) -> str:
        """One line for a report."""
        maths = "vector maths" if self.vector_symbols else "plain maths"
        return f"{self.version}, {self.lanes} lanes, {maths}"


ZIG = (sys.executable, "-m", "ziglang", "c++")
"""The compiler that the package ``ziglang`` brings."""


def find_toolchain(*, plain: bool = False) -> Toolchain | None:
    """The compiler named by ``SPACEROBOT_COMPILER`` or ``CXX``, else one that is installed; None without one.

    Looked for are g++, clang++, c++ and the package ``ziglang``, in this order. ``SPACEROBOT_COMPILER=none``
    says that nothing shall be compiled. ``SPACEROBOT_COMPILER_FLAGS`` holds further arguments for each
    source, which come last: with ``-O1`` libraries are made sooner and run slower, with ``-march=x86-64-v3``
    they run on every processor with AVX2, in four lanes.

    Args:
        plain: Whether these further arguments are left out.

    Raises:
        CompileError: A compiler named by the environment cannot be run, or the variable cannot be split into
            words.
    """
    wish = os.environ.get("SPACEROBOT_COMPILER", "").strip()
    if wish.lower() == "none":
        return None
    name = "SPACEROBOT_COMPILER" if wish else "CXX"
    flags = "" if plain else os.environ.get("SPACEROBOT_COMPILER_FLAGS", "")
    more = _words("SPACEROBOT_COMPILER_FLAGS", flags)
    return _toolchain(name, wish or os.environ.get("CXX", "").strip(), more)


@functools.cache
def _toolchain(variable: str, wish: str, more: tuple[str, ...]) -> Toolchain | None:
    if wish:
        named = (wish,) if shutil.which(wish) else _words(variable, wish)
        version = _version(named)
        if version is None:
            raise CompileError(
                f"{variable} names the compiler '{wish}', which cannot be run; "
                f"mend it, or unset {variable} to have one looked for"
            )
        return _described((shutil.which(named[0]) or named[0], *named[1:]), version, more)
    candidates: list[tuple[str, ...]] = [
        (path,) for name in ("g++", "clang++", "c++") if (path := shutil.which(name))
    ]
    if importlib.util.find_spec("ziglang") is not None:
        candidates.append(ZIG)
    for command in candidates:
        version = _version(command)
        if version:
            return _described(command, version, more)
    return None


def _words(variable: str, text: str) -> tuple[str, ...]:
    """Words of an environment variable, quoted as in a shell."""
    try:
        return tuple(shlex.split(text, posix=os.name == "posix"))
    except ValueError as error:  # a quotation mark or a backslash without its partner
        raise CompileError(f"{variable} is {text!r}, which has no words: {error}") from None


def _described(command: tuple[str, ...], version: str, more: tuple[str, ...]) -> Toolchain:
    import ctypes

    from spacerobot.compiled.codegen import BINARY, UNARY

    processor = processor_of_machine()
    sets = _targeted_sets(command, more) if any(flag.startswith("-m") for flag in more) else processor.split()
    lanes = 8 if "avx512f" in sets and "avx512dq" in sets else 4 if "avx" in sets else 2
    # symbols that the C library's vector maths offers for so many lanes, and how to link it
    machine, symbols = platform.machine().lower(), dict[str, str]()
    prefix = {"x86_64": {8: "e", 4: "d", 2: "b"}.get(lanes), "aarch64": {2: "n"}.get(lanes)}.get(machine)
    try:
        library = ctypes.CDLL("libmvec.so.1")
    except OSError:
        prefix = None
    if prefix is not None:
        symbols = {name: f"_ZGV{prefix}N{lanes}v_{name}" for name in UNARY}
        symbols |= {name: f"_ZGV{prefix}N{lanes}vv_{name}" for name in BINARY}
        symbols = {name: symbol for name, symbol in symbols.items() if hasattr(library, symbol)}
    libraries: tuple[str, ...] = ("-l:libmvec.so.1",) if symbols else ()
    if machine not in ("x86_64", "amd64"):
        target: tuple[str, ...] = ("-mcpu=native",)
    elif command == ZIG:
        target = ("-march=native",)
    else:  # tuning for the newest processors spills to general registers: 15 % slower here
        target = ("-march=native", "-mtune=generic")
    if sys.platform != "win32":
        target, libraries = (*target, "-fPIC"), (*libraries, "-lm")
    target += ZIG_FLAGS if command == ZIG else () if "clang" in version else GCC_FLAGS
    if command == ZIG and sys.platform == "linux":
        target, libraries = (*target, *BARE[0]), (*BARE[1], *libraries)
    flags = (*FLAGS, *target, *more)
    return Toolchain(command, version, flags, libraries, processor, lanes, MappingProxyType(symbols))


def _targeted_sets(command: tuple[str, ...], more: tuple[str, ...]) -> set[str]:
    """Instruction sets, in lower case, that a compiler's predefined macros state for these arguments.

    Lanes wider than the registers it may use would call vector maths with arguments in other registers.
    """
    macros = _answer([*command, "-march=native", *more, "-dM", "-E", "-x", "c++", os.devnull])
    # none if an argument is refused, which is reported when the compiler compiles
    return {name.lower() for name in re.findall(r"^#define __(\w+?)__ 1$", macros or "", re.MULTILINE)}


@functools.cache
def processor_of_machine() -> str:
    """Model and instruction sets of the first processor; without /proc, what Python knows about it."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    fields = re.compile(r"^(model name|flags|CPU implementer|CPU part|Features)\s*:\s*(.*)$", re.MULTILINE)
    first = text.split("\n\n", 1)[0]
    features = [value for _, value in fields.findall(first)]
    if not features and sys.platform == "darwin":
        arguments = ["sysctl", "-n", "machdep.cpu.brand_string", "machdep.cpu.features"]
        process = subprocess.run(arguments, capture_output=True, text=True, check=False)
        features = process.stdout.lower().splitlines()
    return " | ".join(
        [platform.machine(), *features] if features else [platform.machine(), platform.processor()]
    )


def _version(command: tuple[str, ...]) -> str | None:
    text = (_answer([*command, "--version"]) or "").strip()
    return text.splitlines()[0].strip() if text else None


def _answer(arguments: Sequence[str]) -> str | None:
    """Output of a compiler; None if it fails or hangs. It is ended with what it started."""
    process = None
    try:
        with uninterrupted():  # else Ctrl-C while it starts would leave it running
            process = subprocess.Popen(
                arguments,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                process_group=PROCESS_GROUP,
            )
        output, _ = process.communicate(timeout=ANSWER_S)
    except (OSError, subprocess.SubprocessError):
        return None
    finally:
        if process is not None:
            end_process(process)
            if process.stdout is not None:
                process.stdout.close()
    return None if process.returncode else output


def end_process(process: subprocess.Popen[Any]) -> None:
    """End a process of a group of its own and what it started, unless it ended by itself.

    The number of one that ended may be another's.

    Args:
        process: Started with ``process_group=PROCESS_GROUP``.
    """
    if process.poll() is not None:
        return
    if os.name == "posix":
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.wait()
