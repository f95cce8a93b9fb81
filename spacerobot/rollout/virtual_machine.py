"""One library of loops for all scenes, with a virtual machine for their functions: ``loops/machine.hpp``."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import re
from collections.abc import Iterable
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.common.arrays import Array
from spacerobot.common.errors import CompileError
from spacerobot.compiled import Toolchain, find_toolchain, statements_of
from spacerobot.compiled.build import SourceUnit, build
from spacerobot.compiled.library import cached_library
from spacerobot.compiled.toolchain import processor_of_machine
from spacerobot.rollout.kernel import Kernel
from spacerobot.rollout.kernel_tables import (
    FUNCTIONS,
    INTEGERS,
    LENGTHS,
    REALS,
    SIZES,
    built_file,
    generic_source,
    processors,
)
from spacerobot.rollout.methods.tableau import INNER, Tableau

MOST_STAGES = 16
"""Maximum number of stages of a method in the loops."""

NO_LOOPS = (
    "this installation has no compiled loops for this processor, and there is no C++ compiler to make them; "
    "install spacerobot again, or `pip install 'spacerobot[compiler]'`"
)

_CONSTANT = re.compile(r"=(-?(?:\d|\.|casadi_(?:inf|nan))[^;]*);")
_NAMED = {"casadi_inf": np.inf, "-casadi_inf": -np.inf, "casadi_nan": np.nan, "-casadi_nan": np.nan}

_GROUP = np.dtype([("kind", np.int32), ("part", np.int32), ("number", np.int64)])
_TABLEAU = np.dtype(
    [
        ("stages", np.int64, 3),
        ("a", float, (MOST_STAGES, MOST_STAGES)),
        *((name, float, MOST_STAGES) for name in ("b", "c", "e")),
        ("inside", float, 3),
        ("inner", float, (3, MOST_STAGES)),
        ("dense", float, (MOST_STAGES, 4)),
        ("place", np.int64, MOST_STAGES),
    ]
)


class _ProgramAddresses(ctypes.Structure):
    _fields_ = (
        ("group", ctypes.c_void_p),
        ("narrow", ctypes.c_void_p),
        ("wide", ctypes.c_void_p),
        ("constant", ctypes.c_void_p),
        ("groups", ctypes.c_int64),
        ("constants", ctypes.c_int64),
        ("slots", ctypes.c_int64),
        ("inputs", ctypes.c_int64),
    )


class _SceneAddresses(ctypes.Structure):
    _fields_ = (
        ("size", ctypes.c_void_p),
        ("integers", ctypes.c_void_p),
        ("reals", ctypes.c_void_p),
        ("tableau", ctypes.c_void_p),
        ("function", ctypes.c_void_p),
    )


@functools.cache
def load_loops() -> ctypes.CDLL:
    """Library of the loops, built with the package or compiled on first use.

    Raises:
        CompileError: The package has no built loops, and compilation fails.
    """
    package = Path(str(resources.files("spacerobot")))
    source = generic_source(package)
    best, *others = processors()
    kinds = (best, *others) if not others or _has_fma() else others
    for kind in kinds:
        file = built_file(package, kind, source)
        if file.exists():
            with contextlib.suppress(OSError):  # no library of this machine
                return ctypes.CDLL(str(file))

    def make(folder: Path) -> Path:
        return build([SourceUnit(source)], _toolchain(), folder)

    compiler: tuple[str, ...] = ("none",)
    with contextlib.suppress(CompileError):  # raised by `make` where no compiler made them before
        compiler = _toolchain().identity
    return cached_library([source, processor_of_machine()], make, compiler=compiler)[1]


def _toolchain() -> Toolchain:
    toolchain = find_toolchain(plain=True)
    if toolchain is None:
        raise CompileError(NO_LOOPS)
    # GCC fuses products and sums, on which sine and cosine rely, only where FMA may be used
    return replace(toolchain, flags=(*toolchain.cold_flags, "-fexpensive-optimizations"))


def call_loops(name: str, *arguments: Any) -> int:
    """Call a function of the loops and return its result.

    Raises:
        CompileError: See :func:`load_loops`.
    """
    entry = load_loops()[name]
    entry.restype = ctypes.c_int64
    return int(entry(*arguments))


def _has_fma() -> bool:
    """Whether this processor has the instructions of x86-64-v3."""
    return {"avx2", "bmi2", "fma", "f16c", "movbe", "abm"} <= set(processor_of_machine().split())


class Program:
    """A function in the form of a program for the virtual machine.

    Args:
        name, function: Name for messages, and SX function with dense arguments.

    Raises:
        CompileError: There are no loops, or CasADi's code for the function has an unknown form.
    """

    def __init__(self, name: str, function: ca.Function) -> None:
        lines = statements_of(name, function)
        text = "\n".join(lines)
        words = _CONSTANT.findall(text)
        constants = np.array([_NAMED[word] if word in _NAMED else float(word) for word in words])
        groups, sizes = np.zeros(len(lines) + 1, dtype=_GROUP), np.zeros(2, dtype=np.int64)
        indices = np.zeros((len(lines) + 1, 4), dtype=np.uint32)
        pointers = (ctypes.c_void_p(array.ctypes.data) for array in (groups, indices, sizes))
        count = call_loops(
            "make_program", ctypes.c_char_p(text.encode()), ctypes.c_int64(len(lines)), *pointers
        )
        if count == -1:
            raise CompileError(f"no memory for the program of '{name}'")
        if count < 0:
            line = text[text.rfind("\n", 0, -2 - count) + 1 :].partition("\n")[0]
            raise CompileError(f"the code that this CasADi generates for '{name}' is unknown: {line}")
        slots, operations = map(int, sizes)
        indices = indices[:operations]
        narrow = int(indices.max(initial=0)) < 2**16
        packed = indices.astype(np.uint16) if narrow else indices.copy()
        self._kept = (groups[:count].copy(), packed, constants)  # the structure has only their addresses
        place = packed.ctypes.data
        self._addresses = _ProgramAddresses(
            self._kept[0].ctypes.data,
            place if narrow else None,
            None if narrow else place,
            constants.ctypes.data,
            count,
            len(constants),
            slots,
            function.n_in(),
        )
        self._lengths = [function.numel_out(i) for i in range(function.n_out())]

    @property
    def address(self) -> int:
        """Address of the data in memory, valid while this object exists."""
        return ctypes.addressof(self._addresses)

    def __call__(self, *arguments: npt.ArrayLike) -> list[Array]:
        """Evaluate; arguments and results have shape (n,).

        Raises:
            CompileError: There is no memory.
        """
        arrays = [np.array(argument, dtype=float).ravel() for argument in arguments]
        results = [np.zeros(length) for length in self._lengths]
        places = (ctypes.c_void_p * 8)(*(array.ctypes.data for array in (*arrays, *results)))
        if call_loops("evaluate_program", ctypes.byref(self._addresses), places) < 0:
            raise CompileError("no memory to evaluate a function")
        return results


class SceneProgram:
    """Data of a kernel for the loops, at :attr:`address`.

    Args:
        kernel: Functions, with their reverse for gradients.

    Raises:
        CompileError: There are no loops, or a function has an unknown form.
    """

    def __init__(self, kernel: Kernel) -> None:
        self._kept: list[object] = []
        functions = kernel.functions
        sizes = [size(kernel) for size in SIZES.values()]
        sizes += [kernel.size(*length) if length[0] in functions else 0 for length in LENGTHS.values()]
        programs = [self._program(name, functions[name]) if name in functions else 0 for name in FUNCTIONS]
        scene = _SceneAddresses(
            self._array(np.array(sizes, dtype=np.int64)),
            self._addresses(np.array([*table(kernel), -1], dtype=np.int64) for table in INTEGERS.values()),
            self._addresses(np.array([*table(kernel), -1.0]) for table in REALS.values()),
            self._array(_tableau(kernel.method)),
            self._array(np.array(programs, dtype=np.uint64)),
        )
        self._kept.append(scene)
        self.address = ctypes.addressof(scene)

    def _array(self, array: npt.NDArray[Any]) -> int:
        """Address of an array, which is kept alive."""
        self._kept.append(array)
        return int(array.ctypes.data)

    def _addresses(self, arrays: Iterable[npt.NDArray[Any]]) -> int:
        return self._array(np.array([self._array(array) for array in arrays], dtype=np.uint64))

    def _program(self, name: str, function: ca.Function) -> int:
        program = Program(name, function)
        self._kept.append(program)
        return program.address


def _tableau(method: Tableau) -> npt.NDArray[np.void]:
    """Numbers of a method as the loops read them."""
    tableau = np.zeros(1, dtype=_TABLEAU)
    total, stages, row = len(method.nodes), method.stages, tableau[0]
    row["stages"] = stages, total, max(method.places) + 1
    row["a"][:total, :total], row["b"][:stages], row["c"][:total] = method.a, method.b, method.nodes
    row["e"][:total], row["inside"], row["inner"][:, :stages] = method.error, INNER, method.inner
    row["dense"][:stages], row["place"][:stages] = method.dense, method.places
    return tableau
