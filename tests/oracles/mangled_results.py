"""Mangled folders of results: whatever a file holds, its readers end in one line or do their work."""

from __future__ import annotations

import copy
import json
import random
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import spacerobot as sr
from spacerobot.result import Result
from viz.page.animation import animation

VALUES = (np.nan, np.inf, -np.inf, 1e308, -1e308, 0.0, -1.0)


def mangle(rng: random.Random, whole: Path, folder: Path) -> None:
    """Copy a result, and change one to three places in one of its files.

    Args:
        rng: Source of the choices.
        whole, folder: The result, and its copy.
    """
    shutil.copytree(whole, folder)
    match rng.choice(("summary.json", "scenario.yaml", "result.nc", "bytes")):
        case "summary.json":
            summary = json.loads((folder / "summary.json").read_text())
            for _ in range(rng.choice((1, 2, 3))):
                holder, key = rng.choice(list(_places(summary)))
                if rng.random() < 0.3:
                    del holder[key]
                else:
                    wrong = (None, True, -1, 1e308, float("nan"), "", "x", [], [1], {}, {"a": None}, "../x")
                    holder[key] = copy.deepcopy(rng.choice(wrong))
            (folder / "summary.json").write_text(json.dumps(summary))
        case "scenario.yaml":
            lines = (folder / "scenario.yaml").read_text().split("\n")
            for _ in range(rng.choice((1, 2, 3))):
                at = rng.randrange(len(lines))
                key, colon, _ = lines[at].partition(": ")
                wrong = ("~", "-1", "1e308", ".nan", "x", "[]", "{}", "[1, 2]", "!!map [1]")
                lines[at] = f"{key}: {rng.choice(wrong)}" if colon and rng.random() < 0.8 else ""
            (folder / "scenario.yaml").write_text("\n".join(lines))
        case "result.nc":
            with xr.open_dataset(folder / "result.nc", engine="netcdf4") as stored:
                data = stored.load().drop_encoding()
            name = str(rng.choice(sorted(map(str, data.variables))))
            match rng.choice(("drop", "values", "text", "transpose", "attributes", "shorten")):
                case "drop":
                    data = data.drop_vars(name)
                case "values" if data[name].dtype.kind == "f":
                    values = np.array(data[name].values)
                    values[tuple(rng.randrange(size) for size in values.shape)] = rng.choice(VALUES)
                    data[name] = (data[name].dims, values, data[name].attrs)
                case "text":
                    data[name] = (data[name].dims, np.full(data[name].shape, "x", dtype=object))
                case "transpose" if data[name].ndim > 1:
                    data[name] = data[name].transpose()
                case "attributes":
                    data.attrs, data[name].attrs = {}, {}
                case _:
                    data = data.isel(time=slice(0, rng.choice((0, 1, 2))))
            data.to_netcdf(folder / "new.nc", engine="netcdf4")
            (folder / "new.nc").replace(folder / "result.nc")
        case _:
            file = folder / rng.choice(("summary.json", "scenario.yaml", "result.nc"))
            content = bytearray(file.read_bytes())
            for _ in range(rng.choice((1, 10, 100))):
                content[rng.randrange(len(content))] = rng.randrange(256)
            file.write_bytes(bytes(content[: rng.choice((None, None, len(content) // 2))]))


def _places(node: Any) -> Iterator[tuple[Any, Any]]:
    for key in list(node) if isinstance(node, dict) else range(len(node)):
        yield node, key
        if isinstance(node[key], dict | list):
            yield from _places(node[key])


def use(folder: Path) -> None:
    """Load a result, rebuild its scene, and make what pages, tables and analyses show of it.

    Raises:
        SpaceRobotError: What is wrong with it.
    """
    result = Result.load(folder)
    result.scene()
    assert repr(result)
    assert result._repr_html_()
    animation(result)
    sr.passive_safety(result, duration_s=1.0)
