"""Shared libraries of CasADi functions: generated, compiled once, loaded from the cache."""

from __future__ import annotations

import ctypes
import hashlib
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.common.arrays import Array
from spacerobot.common.errors import CompileError, near_names
from spacerobot.common.progress import tell
from spacerobot.compiled import cache
from spacerobot.compiled.build import Progress, SourceUnit, build
from spacerobot.compiled.codegen import HIDDEN, maths_of, source_of
from spacerobot.compiled.pieces import CodePiece
from spacerobot.compiled.toolchain import NO_COMPILER, Toolchain, find_toolchain


@dataclass(frozen=True)
class Library:
    """A loaded shared library of compiled functions.

    Attributes:
        functions: The compiled CasADi functions, by name.
        lanes: Evaluations in one call.
        toolchain: Compiler and its options.
        path: The library file.
        cached: Whether the library comes from the cache.
        seconds: Time to generate, compile (or look up) and load it [s].
    """

    functions: Mapping[str, ca.Function]
    lanes: int
    toolchain: Toolchain
    path: Path
    cached: bool
    seconds: float
    _handle: ctypes.CDLL

    def entry(self, name: str) -> Any:
        """New ctypes function object, without a return value, of an exported C function.

        An attribute of the handle would be one object, with one result type, for all threads.
        """
        function = self._handle[name]
        function.restype = None
        return function

    def __call__(self, name: str, *arguments: npt.ArrayLike) -> tuple[Array, ...]:
        """Evaluate one function.

        Args:
            name: Name of the function.
            arguments: One array for each input, (n,), or (n, lanes) with one set of arguments in each lane.

        Returns:
            tuple of arrays: One for each output, (n,), or (n, lanes) if an argument has two dimensions.

        Raises:
            KeyError: The library has no such function.
        """
        if name not in self.functions:
            raise KeyError(f"no function '{name}', {near_names(name, self.functions)}")
        function = self.functions[name]
        wide = any(np.ndim(argument) == 2 for argument in arguments)
        inputs = []
        for i, argument in enumerate(arguments):
            values, size = np.asarray(argument, dtype=float), function.numel_in(i)
            inputs.append(_aligned(size, self.lanes))
            inputs[-1][:] = values if values.ndim == 2 else values.reshape(size, 1)
        results = [_aligned(function.numel_out(i), self.lanes) for i in range(function.n_out())]
        pointers = (ctypes.c_void_p * len(inputs))(*[a.ctypes.data for a in inputs])
        targets = (ctypes.c_void_p * len(results))(*[a.ctypes.data for a in results])
        self.entry(f"call_{name}")(pointers, targets)
        return tuple(r.copy() if wide else r[:, 0].copy() for r in results)

    def columns(self, name: str, *arguments: Array) -> Array:
        """Evaluate the first output of a function for many argument sets, ``lanes`` of them in each call.

        Args:
            name: Name of the function.
            arguments: One array for each input, with a column for each set (n, N).

        Returns:
            numpy.ndarray: Values (m, N).
        """
        count, size = arguments[0].shape[1], self.functions[name].numel_out(0)
        groups, entry = -(-count // self.lanes), self.entry(f"call_{name}")
        blocks = []
        for argument in arguments:
            wide = np.concatenate(
                [argument, np.repeat(argument[:, -1:], -count % self.lanes, axis=1)], axis=1
            )
            block = _aligned(groups * len(argument), self.lanes).reshape(groups, len(argument), self.lanes)
            block[:] = wide.reshape(len(argument), groups, self.lanes).transpose(1, 0, 2)
            blocks.append(block)
        values = _aligned(groups * size, self.lanes).reshape(groups, size, self.lanes)
        inputs, outputs = (ctypes.c_void_p * len(blocks))(), (ctypes.c_void_p * 1)()
        starts = [(block.ctypes.data, block.strides[0]) for block in blocks]
        first, stride = values.ctypes.data, values.strides[0]
        for group in range(groups):
            inputs[:] = [start + group * step for start, step in starts]
            outputs[0] = first + group * stride
            entry(inputs, outputs)
        return values.transpose(1, 0, 2).reshape(size, groups * self.lanes)[:, :count]


_keys: dict[str, str] = {}
"""Keys in the cache by the hash of the functions that this process has compiled: generating the sources,
whose hash is the key, takes seconds for 100 000 operations."""


def compile_functions(
    functions: Mapping[str, ca.Function],
    *,
    lanes: int = 1,
    cold: Collection[str] = (),
    tail: str = "",
    toolchain: Toolchain | None = None,
    progress: Progress | None = None,
) -> Library:
    """Compile CasADi functions to one library, or load it from the cache.

    Args:
        functions: SX functions with dense inputs and outputs, by name.
        lanes: Evaluations in one call: 1, or ``toolchain.lanes``.
        cold: Names of functions that run seldom and are compiled with less optimisation.
        tail: C++ source that follows the struct ``Generated``, whose static members are the functions.
        toolchain: Compiler; that of :func:`find_toolchain` if None.
        progress: Callback with the number of compiled sources and of all sources, called if anything is
            compiled; the listeners of :mod:`spacerobot.common.progress` if None.

    Raises:
        CompileError: There is no compiler, it rejects the source or exceeds its time limit, or the library
            cannot be loaded.
    """
    begin = time.perf_counter()
    toolchain = toolchain or find_toolchain()
    if toolchain is None:
        raise CompileError(NO_COMPILER)
    serialized = (f"{name}\0{function.serialize()}" for name, function in functions.items())
    parts = [*serialized, str(lanes), *sorted(cold), tail, *toolchain.identity]
    content = hashlib.sha256("\0".join(parts).encode()).hexdigest()
    loaded = _loaded(cache.cache_folder(), _keys[content]) if content in _keys else None
    if loaded is not None:
        path, handle = loaded
        return Library(dict(functions), lanes, toolchain, path, True, time.perf_counter() - begin, handle)
    vector_symbols = toolchain.vector_symbols if lanes == toolchain.lanes else {}
    units = source_units(functions, lanes=lanes, cold=cold, tail=tail, vector_symbols=vector_symbols)
    parts = [*(unit.text for unit in units), *toolchain.identity]

    def make(folder: Path) -> Path:
        return build(units, toolchain, folder, progress or tell)

    path, handle, cached = cached_library(parts, make)
    _keys[content] = path.stem.rpartition("-")[0]
    return Library(dict(functions), lanes, toolchain, path, cached, time.perf_counter() - begin, handle)


def source_units(
    functions: Mapping[str, ca.Function],
    *,
    lanes: int = 1,
    cold: Collection[str] = (),
    tail: str = "",
    vector_symbols: Mapping[str, str] | None = None,
) -> list[SourceUnit]:
    """C++ sources of CasADi functions: the pieces in sources of about equal length, then the struct and tail.

    Args:
        functions, lanes, cold, tail: As for :func:`compile_functions`.
        vector_symbols: Routines of the vector maths library for this number of lanes, by function name.

    Raises:
        CompileError: As :func:`source_of`.
    """
    source = source_of(functions, cold=cold, lanes=lanes)
    lanes_hpp = resources.files("spacerobot.compiled").joinpath("lanes.hpp").read_text(encoding="utf-8")
    head = "\n".join([f"#define LANES {lanes}", lanes_hpp, maths_of(vector_symbols or {})])
    bins: list[list[CodePiece]] = []
    for piece in sorted(source.pieces, key=lambda piece: (piece.cold, -len(piece.lines))):
        room = UNIT - sum(len(other.lines) for other in bins[-1]) if bins else 0
        if bins and len(piece.lines) <= room and bins[-1][0].cold == piece.cold:
            bins[-1].append(piece)
        else:
            bins.append([piece])
    units = [
        SourceUnit(
            "\n".join(["#define PIECES", head, *(f"{HIDDEN} {piece.text}" for piece in held), ""]),
            held[0].cold,
        )
        for held in bins
    ]
    units.append(SourceUnit("\n".join([head, source.struct, tail, ""])))
    return units


def _loaded(folder: Path, key: str) -> tuple[Path, ctypes.CDLL] | None:
    """File and library stored under a key; None if there is none that this machine can load."""
    path = cache.find(folder, key)
    if path is None:
        return None
    try:
        return path, ctypes.CDLL(str(path))
    except OSError:
        path.unlink(missing_ok=True)
        return None


def cached_library(
    parts: Sequence[str], make: Callable[[Path], Path], *, compiler: Sequence[str] = ()
) -> tuple[Path, ctypes.CDLL, bool]:
    """Library from the cache, or built and stored there.

    Args:
        parts: Sources and options that decide the library's content; the cache key is their hash.
        make: Function that builds the library in a folder and returns its file.
        compiler: Further parts of the key for a library that any compiler may have built. If the build
            fails, a cached library with the same ``parts`` and another ``compiler`` is loaded instead.

    Returns:
        tuple: The file, the loaded library, and whether it comes from the cache.

    Raises:
        CompileError: The library cannot be built or loaded.
    """
    folder = cache.cache_folder()
    general, special = (
        hashlib.sha256("\0".join(each).encode()).hexdigest()[:32] for each in (parts, compiler)
    )
    key = f"{general}{special}" if compiler else general
    loaded = _loaded(folder, key)
    if loaded is not None:
        return *loaded, True
    try:
        try:
            path = cache.store(folder, key, make(folder))
        except CompileError:
            other = cache.find(folder, f"{general}?*") if compiler else None
            if other is None:
                raise
            return other, ctypes.CDLL(str(other)), True
        return path, ctypes.CDLL(str(path)), False
    except OSError as error:
        raise CompileError(f"the compiled library cannot be made or loaded: {error}") from error


UNIT = 3000
"""Maximum number of lines of the pieces in one source, unless a single piece is longer."""


def _aligned(size: int, lanes: int) -> Array:
    """Zeros (size, lanes) whose memory is aligned to the width of a vector register."""
    width = 8 * lanes
    room = np.zeros(size * lanes + lanes, dtype=float)
    shift = (-room.ctypes.data % width) // 8
    return room[shift : shift + size * lanes].reshape(size, lanes)
