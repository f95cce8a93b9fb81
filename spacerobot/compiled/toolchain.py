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
    "-freciprocal-math",  # the articulated-body algorithm divides several times by the same joint inertia
    "-w",
)

GCC_FLAGS = (
    "-fschedule-insns",
    "-fsched-pressure",  # fewer spilled registers in blocks of 3000 operations
    "-fno-gnu-unique",  # else a library loaded later would share the method tables of the first one
)

ZIG_FLAGS = ("-fno-sanitize=all",)  # without it, zig adds run-time checks

BARE = (("-DNO_RUNTIME", "-fno-exceptions"), ("-nostdlib",))
"""Compile and link options of zig without the C++ run-time libraries, whose first build takes minutes."""

SUFFIX = {"darwin": ".dylib", "win32": ".dll"}.get(sys.platform, ".so")
"""Suffix of shared libraries on this platform."""

PROCESS_GROUP = 0 if os.name == "posix" else None
"""``process_group`` of a compiler: a new group, so that it can be ended with its child processes."""

ANSWER_S = 30.0
"""Time after which a query of a compiler's version or macros is ended [s]."""

NO_COMPILER = (
    "no C++ compiler was found (g++, clang++, CXX or SPACEROBOT_COMPILER); "
    "`pip install 'spacerobot[compiler]'` brings one"
)


@dataclass(frozen=True)
class Toolchain:
    """A C++ compiler with its options and the processor that it builds for.

    Attributes:
        command: Path of the compiler, followed by the arguments that select it (``-m ziglang c++``).
        version: First line of its version report.
        flags: Arguments to compile a source.
        libraries: Last arguments of the link command.
        processor: Model and instruction sets of the processor.
        lanes: Doubles in one vector register: 8 with AVX-512, 4 with AVX, 2 otherwise.
        vector_symbols: Routines of the vector maths library for this number of lanes, by function name; empty
            without that library.
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
        """Name of the compiler in messages."""
        return "ziglang" if self.is_zig else Path(self.command[0]).name

    @property
    def is_zig(self) -> bool:
        """Whether the compiler is that of the package ``ziglang``."""
        return self.command == ZIG

    @property
    def identity(self) -> tuple[str, str, str]:
        """Version, arguments and processor, which with the source decide a library's content."""
        return self.version, " ".join([*self.command, *self.flags, *self.libraries]), self.processor

    @property
    def cold_flags(self) -> tuple[str, ...]:
        """Arguments to compile a source that runs seldom: ``-O1`` instead of ``-O3``."""
        return tuple("-O1" if flag == "-O3" else flag for flag in self.flags)

    @property
    def portable(self) -> Toolchain:
        """The compiler with options for libraries that other programs load on other machines.

        The code runs on every processor of this architecture, needs no C++ run-time library and hides the
        symbols that it does not export by name. Arguments of ``SPACEROBOT_COMPILER_FLAGS`` still apply.
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
        """Version, lanes and maths library in one line."""
        maths = "vector maths" if self.vector_symbols else "plain maths"
        return f"{self.version}, {self.lanes} lanes, {maths}"


ZIG = (sys.executable, "-m", "ziglang", "c++")
"""Command of the compiler in the package ``ziglang``."""


def find_toolchain(*, plain: bool = False) -> Toolchain | None:
    """Compiler of ``SPACEROBOT_COMPILER`` or ``CXX``, or else an installed one; None without one.

    The order of the search is g++, clang++, c++ and the package ``ziglang``. ``SPACEROBOT_COMPILER=none``
    disables compilation. ``SPACEROBOT_COMPILER_FLAGS`` holds further arguments, which follow all others:
    with ``-O1``, libraries compile faster and run slower; with ``-march=x86-64-v3``, they run on every
    processor with AVX2, in four lanes.

    Args:
        plain: Whether to ignore ``SPACEROBOT_COMPILER_FLAGS``.

    Raises:
        CompileError: The compiler named by a variable cannot be run, or a variable has unbalanced quotes.
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
    except ValueError as error:  # an unbalanced quotation mark, or a backslash at the end
        raise CompileError(f"{variable} is {text!r}, which has no words: {error}") from None


def _described(command: tuple[str, ...], version: str, more: tuple[str, ...]) -> Toolchain:
    import ctypes

    from spacerobot.compiled.codegen import BINARY, UNARY

    processor = processor_of_machine()
    sets = _targeted_sets(command, more) if any(flag.startswith("-m") for flag in more) else processor.split()
    lanes = 8 if "avx512f" in sets and "avx512dq" in sets else 4 if "avx" in sets else 2
    # routines of libmvec, the vector maths of glibc, for this number of lanes; names follow the vector ABI:
    # _ZGV, instruction set (b SSE, d AVX2, e AVX-512, n Advanced SIMD), N (unmasked), lanes, v per argument
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
    else:  # -mtune=native on recent processors spills to general registers: measured 15 % slower
        target = ("-march=native", "-mtune=generic")
    if sys.platform != "win32":
        target, libraries = (*target, "-fPIC"), (*libraries, "-lm")
    target += ZIG_FLAGS if command == ZIG else () if "clang" in version else GCC_FLAGS
    if command == ZIG and sys.platform == "linux":
        target, libraries = (*target, *BARE[0]), (*BARE[1], *libraries)
    flags = (*FLAGS, *target, *more)
    return Toolchain(command, version, flags, libraries, processor, lanes, MappingProxyType(symbols))


def _targeted_sets(command: tuple[str, ...], more: tuple[str, ...]) -> set[str]:
    """Instruction sets, in lower case, that the compiler's predefined macros list for these arguments.

    The number of lanes must agree with the registers that the compiler may use: otherwise it would pass the
    arguments of vector routines in other registers than these expect.
    """
    macros = _answer([*command, "-march=native", *more, "-dM", "-E", "-x", "c++", os.devnull])
    # empty if the compiler rejects an argument; the error is reported at the first compilation
    return {name.lower() for name in re.findall(r"^#define __(\w+?)__ 1$", macros or "", re.MULTILINE)}


@functools.cache
def processor_of_machine() -> str:
    """Model and instruction sets of the first processor, from /proc/cpuinfo, sysctl or :mod:`platform`."""
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
    """Output of a compiler's command; None if it fails or exceeds the time limit."""
    process = None
    try:
        with uninterrupted():  # else Ctrl-C during its start would leave the process running
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
    """End a process that is still running, and its child processes.

    A process that has ended is left alone, since its number may belong to another process.

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
