"""Damaged folders: one line that names the file and what is missing, whatever is missing."""

import functools
import json
import shutil

import numpy as np
import pytest
import xarray as xr

from spacerobot.common.errors import ResultError, SpaceRobotError
from spacerobot.result import Result
from spacerobot.result.completeness import DIMENSIONS
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from tests.oracles import one_arm

ENGINE = ("name", "backend", "step_s", "steps")  # the rest says how it was done, where it was


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    scene = load_scene(one_arm.write(folder), {"simulation.duration": 0.2})
    return simulate(scene).save(folder / "r").folder


@pytest.fixture
def damaged(whole, tmp_path):
    """A copy of it, to be damaged."""
    return shutil.copytree(whole, tmp_path / "r")


def leaves(node, path=()):
    for key, value in node.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from leaves(value, (*path, key))


def rewrite(folder, data):
    data.to_netcdf(folder / "new.nc", engine="netcdf4")
    (folder / "new.nc").replace(folder / "result.nc")


@pytest.mark.parametrize("name", sorted(DIMENSIONS))
def test_a_variable_that_is_missing_is_named(damaged, name):
    data = xr.load_dataset(damaged / "result.nc")
    rewrite(damaged, data.drop_vars(name))
    with pytest.raises(ResultError, match=rf"r/result\.nc: damaged: no variable '{name}'; run its"):
        Result.load(damaged)


@pytest.mark.parametrize("name", ["time", "q", "v", "body_position", "body_orientation"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), "text"])
def test_a_variable_without_finite_numbers_is_named(damaged, name, value):
    data = xr.load_dataset(damaged / "result.nc")
    values = np.full(data[name].shape, value, dtype=object if value == "text" else float)
    attributes = data[name].attrs
    data[name] = (data[name].dims, values, attributes)
    rewrite(damaged, data)
    with pytest.raises(ResultError, match=rf"damaged: {name}: found .*(not finite|allowed: numbers)"):
        Result.load(damaged)


def test_every_key_of_a_summary_that_is_missing_or_something_else_is_named(damaged, monkeypatch):
    monkeypatch.setattr(xr, "load_dataset", functools.cache(xr.load_dataset))  # it stays the same
    file = damaged / "summary.json"
    text = file.read_text()
    paths = [path for path in leaves(json.loads(text)) if path[0] not in ("format", "versions")]
    paths = [path for path in paths if path[0] != "engine" or path[-1] in (*ENGINE, "engine")]
    assert len(paths) > 70
    for path in paths:
        for replaced in (False, True):
            found = node = json.loads(text)
            for key in path[:-1]:
                node = node[key]
            if replaced:
                node[path[-1]] = object.__name__ if not isinstance(node[path[-1]], str) else 7
            else:
                del node[path[-1]]
            file.write_text(json.dumps(found))
            if replaced and path[-1] in ("joint", "grasp", "advice", "cause", "outcome"):
                continue  # a text or nothing
            with pytest.raises(ResultError) as raised:
                Result.load(damaged)
            assert f"summary.json: damaged: {'' if replaced else 'no '}{'.'.join(path)}" in str(raised.value)


@pytest.mark.parametrize("key", ["time_s", "kind", "who"])
def test_an_event_that_lacks_a_key_is_named(damaged, key):
    file = damaged / "summary.json"
    summary = json.loads(file.read_text())
    event = {"time_s": 0.5, "kind": "captured", "who": "left"}
    summary["events"] = [event, {name: value for name, value in event.items() if name != key}]
    file.write_text(json.dumps(summary))
    with pytest.raises(ResultError, match=rf"summary\.json: damaged: no events\.1\.{key}"):
        Result.load(damaged)


def test_a_truncated_scenario_that_is_one_still_does_not_fit(damaged):
    file = damaged / "scenario.yaml"
    lines = file.read_text().splitlines(keepends=True)
    for count in range(0, len(lines), 3):
        file.write_text("".join(lines[:count]))
        try:
            result = Result.load(damaged)
            result.scene()
        except SpaceRobotError:
            continue
        assert list(result.data.tip.values) == ["arm/tip"]


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.99])
@pytest.mark.parametrize("name", ["result.nc", "summary.json"])
def test_a_file_cut_short_is_named(damaged, name, share):
    file = damaged / name
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ResultError, match=rf"r/{name}: "):
        Result.load(damaged)
