"""Code that is linked without the run-time libraries of C++, as with the package ziglang."""

import ctypes
import importlib.util
import shlex
import sys

import casadi as ca
import numpy as np
import pytest

from spacerobot.compiled import compile_functions, find_toolchain, toolchain

TAIL = """
struct alignas(64) Wide { double values[8]; };
extern "C" void remembered(const double* x, double* y) {
  Room<Wide> wide(100);
  Room<double> plain(100);
  Wide* const one = new (std::nothrow) Wide;
  double* const single = new (std::nothrow) double;
  if (!wide.at || !one || !plain.at || !single) return;
  wide.at[99].values[7] = one->values[0] = plain.at[99] = *single = *x;
  if (reinterpret_cast<uintptr_t>(wide.at) % 64 == 0)
    *y = wide.at[99].values[7] + one->values[0] + plain.at[99] + *single;
  delete one;
  delete single;
}
"""


@pytest.fixture
def environment(monkeypatch, tmp_path):
    for name in ("CXX", "SPACEROBOT_COMPILER"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("SPACEROBOT_CACHE_DIR", str(tmp_path / "cache"))
    toolchain._toolchain.cache_clear()
    yield monkeypatch
    toolchain._toolchain.cache_clear()


def check():
    x = ca.SX.sym("x")
    library = compile_functions({"f": ca.Function("f", [x], [ca.sin(x)], ["x"], ["y"])}, tail=TAIL)
    assert library("f", [0.5])[0][0] == pytest.approx(np.sin(0.5), rel=1e-15)
    given, result = np.array([0.5]), np.zeros(1)
    library.entry("remembered")(ctypes.c_void_p(given.ctypes.data), ctypes.c_void_p(result.ctypes.data))
    assert result[0] == 2.0


@pytest.mark.skipif(sys.platform != "linux", reason="linked otherwise elsewhere")
def test_memory_comes_from_c(environment):
    compiling, linking = toolchain.BARE
    environment.setenv("SPACEROBOT_COMPILER", shlex.join([*find_toolchain().command, *compiling, *linking]))
    check()


@pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="no ziglang")
def test_ziglang_is_enough(environment, tmp_path):
    environment.setenv("PATH", str(tmp_path))
    assert find_toolchain().is_zig
    check()
