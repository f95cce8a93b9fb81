"""CasADi functions compiled to machine code: generated, built once, cached, loaded.

This room knows nothing of robots, only :class:`casadi.Function`.
"""

from spacerobot.compiled.library import Library, compile_functions
from spacerobot.compiled.toolchain import Toolchain, find_toolchain

__all__ = ["Library", "Toolchain", "compile_functions", "find_toolchain"]
