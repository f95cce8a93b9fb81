"""The C++ compiler, what it is told, and the processor it builds for."""

from __future__ import annotations

import functools
import os
import platform
import re
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

FLAGS = (
    "-std=c++17",
    "-O3",
    "-march=native",
    "-mtune=generic",  # tuning for the newest processors spills to general registers: 15 % slower here
    "-ffp-contract=fast",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-freciprocal-math",  # the articulated-body algorithm divides by each joint's inertia several times
    "-fPIC",
    "-shared",
    "-w",
)


GCC_FLAGS = (
    "-fschedule-insns",
    "-fsched-pressure",
)  # order 3000 operations in a row for few spilled registers


@dataclass(frozen=True)
class Toolchain:
    """Everything besides the source that decides what a compiled library holds.

    Attributes
    ----------
    compiler
        Path of the C++ compiler.
    version
        First line of its version report.
    flags
        Its arguments, libraries last.
    processor
        Model and instruction sets of the processor, since the code is built for this one.
    lanes
        Doubles that one vector register holds: 8 with AVX-512, 4 with AVX, 2 otherwise.
    vector_symbols
        Routines of the vector maths library for so many lanes, by function name; empty where it is missing.
    """

    compiler: str
    version: str
    flags: tuple[str, ...]
    processor: str
    lanes: int
    vector_symbols: Mapping[str, str]

    @property
    def summary(self) -> str:
        """One line for a report."""
        maths = "vector maths" if self.vector_symbols else "plain maths"
        return f"{self.version}, {self.lanes} lanes, {maths}"


def find_toolchain() -> Toolchain | None:
    """The compiler named by ``SPACEROBOT_COMPILER`` or ``CXX``, else g++, clang++ or c++; None without one.

    ``SPACEROBOT_COMPILER=none`` says that nothing shall be compiled.
    """
    wish = os.environ.get("SPACEROBOT_COMPILER", "").strip()
    if wish.lower() == "none":
        return None
    return _toolchain(wish or None, os.environ.get("CXX") or None)


@functools.cache
def _toolchain(wish: str | None, cxx: str | None) -> Toolchain | None:
    candidates = (wish,) if wish else (cxx, "g++", "clang++", "c++")
    for candidate in candidates:
        path = shutil.which(candidate) if candidate else None
        version = _version(path) if path else None
        if path and version:
            processor = _processor()
            lanes = _lanes(processor)
            symbols, libraries = _vector_maths(lanes)
            flags = FLAGS if "clang" in version else (*FLAGS, *GCC_FLAGS)
            return Toolchain(path, version, (*flags, *libraries, "-lm"), processor, lanes, symbols)
    return None


def _version(compiler: str) -> str | None:
    try:
        done = subprocess.run([compiler, "--version"], capture_output=True, text=True, timeout=30, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.splitlines()[0].strip() if done.stdout.strip() else None


def _processor() -> str:
    """Model and flags of the first processor; what Python knows about it where /proc does not exist."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        text = ""
    wanted = re.compile(r"^(model name|flags|CPU implementer|CPU part|Features)\s*:\s*(.*)$", re.MULTILINE)
    first = text.split("\n\n", 1)[0]
    found = [value for _, value in wanted.findall(first)]
    return " | ".join([platform.machine(), *found] if found else [platform.machine(), platform.processor()])


def _lanes(processor: str) -> int:
    flags = processor.split()
    if "avx512f" in flags and "avx512dq" in flags:
        return 8
    return 4 if "avx" in flags else 2


def _vector_maths(lanes: int) -> tuple[Mapping[str, str], tuple[str, ...]]:
    """Symbols that the C library's vector maths offers for so many lanes, and how to link it."""
    import ctypes

    from spacerobot.compiled.codegen import BINARY, UNARY

    machine = platform.machine().lower()
    prefix = {"x86_64": {8: "e", 4: "d", 2: "b"}.get(lanes), "aarch64": {2: "n"}.get(lanes)}.get(machine)
    try:
        library = ctypes.CDLL("libmvec.so.1")
    except OSError:
        prefix = None
    if prefix is None:
        return MappingProxyType({}), ()
    names = {name: f"_ZGV{prefix}N{lanes}v_{name}" for name in UNARY}
    names |= {name: f"_ZGV{prefix}N{lanes}vv_{name}" for name in BINARY}
    found = {name: symbol for name, symbol in names.items() if hasattr(library, symbol)}
    return MappingProxyType(found), (("-l:libmvec.so.1",) if found else ())
