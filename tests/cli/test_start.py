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
