"""CasADi functions called with NumPy arrays: compiled to cached shared libraries, or interpreted.

The package depends on :class:`casadi.Function` alone, not on scenes or robots.
"""

from spacerobot.compiled.build import usable_cores
from spacerobot.compiled.codegen import statements_of
from spacerobot.compiled.library import Library, compile_functions
from spacerobot.compiled.numpy_function import numpy_function
from spacerobot.compiled.toolchain import NO_COMPILER, Toolchain, find_toolchain

__all__ = [
    "NO_COMPILER",
    "Library",
    "Toolchain",
    "compile_functions",
    "find_toolchain",
    "numpy_function",
    "statements_of",
    "usable_cores",
]
