"""A command loads no more than it needs."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LOADED = """
import atexit, sys
atexit.register(lambda: print("loaded:", *(name for name, module in sys.modules.items() if module)))
from spacerobot.cli.start import main
main()
"""
COMPUTING = {"casadi", "matplotlib", "netCDF4", "numpy", "pandas", "pinocchio", "scipy", "xarray", "yaml"}
ONLY_SOME = {"cma", "dask", "distributed", "matplotlib", "networkx", "pymoo", "scipy", "tornado", "trimesh"}


def loaded(*arguments):
    command = [sys.executable, "-c", LOADED, *map(str, arguments)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return set(done.stdout.rpartition("loaded: ")[2].split())


@pytest.mark.parametrize("words", [["--help"], ["run", "--help"], ["--version"]])
def test_help_loads_nothing_that_computes(words):
    assert not loaded(*words) & COMPUTING


def test_a_run_loads_neither_meshes_nor_clusters_nor_pictures(tmp_path):
    short = ("--set", "simulation.duration=0.1", "--set", "simulation.step=0.01")
    found = loaded("run", "paper", "--out", tmp_path / "r", *short)
    assert {"casadi", "pinocchio", "xarray", "yourdfpy"} <= found
    assert not found & ONLY_SOME


def test_a_missing_library_of_the_system_is_one_line():
    # Debian's minimal image has no libgomp, which Pinocchio's wheel is linked with
    script = """
import sys
class Missing:
    def find_spec(self, name, *_):
        if name == "pinocchio":
            raise ImportError("libgomp.so.1: cannot open shared object file: No such file", name=name)
sys.meta_path.insert(0, Missing())
sys.argv[1:] = ["run", "paper"]
from spacerobot.cli.start import main
main()
"""
    command = [sys.executable, "-c", script]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert " ".join(done.stderr.split()).startswith("error: libgomp.so.1 is missing on this system")
    assert "apt install libgomp1" in " ".join(done.stderr.split())
