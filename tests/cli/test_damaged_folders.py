"""Damaged folders of results, campaigns and comparisons: every command that reads them ends in one line."""

import json
import shutil
import sys

import numpy as np
import pytest
import xarray as xr

import spacerobot as sr
from optim.planning.output.plan_folder import DIMENSIONS, read
from spacerobot.cli.app import main
from spacerobot.common.errors import ResultError
from tests.oracles import one_arm

TUNING = {
    "variables": {"kp": {"paths": "robots.arm.tips.tip.pid.kp", "lower": 50, "upper": 400}},
    "objective": {"kind": "ise"},
    "methods": ["random", "nlp"],
    "budget": 4,
    "runs": 1,
    "starts": 1,
    "iterations": 1,
    "step": 0.02,
}
CAMPAIGN = {
    "parameters": {
        "kd": {"paths": "robots.arm.tips.tip.pid.kd", "kind": "uniform", "lower": 20, "upper": 40}
    },
    "samples": 4,
    "step": 0.02,
}
READERS = {  # commands that read a folder, with what they are given beside it
    "result": [("animate", "--html"), ("figures", "--out"), ("report", "--out")],
    "campaign": [("report", "--out")],
    "comparison": [("report", "--out")],
}
WRITERS = {"campaign": ["campaign"], "comparison": ["compare", "--report"]}  # these go on where they were
FILES = {
    "result": ["result.nc", "scenario.yaml", "summary.json"],
    "campaign": ["campaign.json", "campaign.nc", "summary.json"],
    "comparison": ["comparison.json"],
}


def call(monkeypatch, *arguments):
    """Exit code."""
    monkeypatch.setattr(sys, "argv", ["spacerobot", *map(str, arguments)])
    with pytest.raises(SystemExit) as left:
        main()
    return left.value.code or 0


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A folder of each kind, beside the scenario that they are of."""
    root = tmp_path_factory.mktemp("whole")
    scenario = one_arm.write(
        root, simulation={"duration": 0.4, "step": 0.02, "output_step": 0.1}, tuning=TUNING, campaign=CAMPAIGN
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("viz.figures.comparison.to_bytes", lambda *_: b"<svg/>")
        assert call(patch, "run", scenario, "--out", root / "result") == 0
        assert call(patch, "campaign", scenario, "--out", root / "campaign") == 0
        assert call(patch, "compare", scenario, "--out", root / "comparison") == 0
    for design in (root / "comparison").glob("tuning/*/result.nc"):
        design.unlink()  # a page without pictures takes no time
    return root


def damages(file):
    """Contents of a damaged file; None for one that is missing."""
    content = file.read_bytes()
    yield None
    yield from (content[: int(share * len(content))] for share in (0.0, 0.5, 0.99))
    yield b"[3]"
    yield bytes(range(256))


def dropped(node):
    """The same data without one key, or with another value, for each key; of lists the first entry."""
    if isinstance(node, list) and node:
        for first in dropped(node[0]):
            yield [first, *node[1:]]
    if isinstance(node, dict):
        for key, value in node.items():
            yield {name: other for name, other in node.items() if name != key}
            yield {**node, key: "?"}
            for inner in dropped(value):
                yield {**node, key: inner}


def told(monkeypatch, capsys, *arguments):
    """Exit code, after a look at what was printed."""
    capsys.readouterr()
    code = call(monkeypatch, *arguments)
    lines = [
        line for line in capsys.readouterr().err.splitlines() if line.startswith(("error: ", "Traceback"))
    ]
    assert code in (0, 2), lines
    assert len(lines) == (code != 0)
    assert all(line.startswith("error: ") for line in lines)
    return code


@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind, names in FILES.items() for name in names])
def test_every_reader_of_a_damaged_file_ends_in_one_line(
    whole, tmp_path, monkeypatch, capsys, undrawn, kind, name
):
    folder = shutil.copytree(whole / kind, tmp_path / kind)
    codes = []
    for content in damages(folder / name):
        (folder / name).unlink(missing_ok=True)
        if content is not None:
            (folder / name).write_bytes(content)
        for command, option in READERS[kind]:
            codes.append(told(monkeypatch, capsys, command, folder, option, tmp_path / "out"))
    assert codes.count(2) >= len(codes) / 2 or (kind, name) == ("campaign", "summary.json")  # made anew


def test_a_comparison_that_lacks_a_key_or_holds_something_else_ends_in_one_line(
    whole, tmp_path, monkeypatch, capsys, undrawn
):
    folder = shutil.copytree(whole / "comparison", tmp_path / "c")
    data = json.loads((folder / "comparison.json").read_text())
    for benchmark in data["problems"]:
        benchmark["methods"] = {"nlp": benchmark["methods"]["nlp"] | {"runs": [], "trials": []}}
    codes = []
    for found in dropped(data):
        (folder / "comparison.json").write_text(json.dumps(found))
        codes.append(told(monkeypatch, capsys, "report", folder, "--out", tmp_path / "out"))
    assert codes.count(2) > 50


@pytest.fixture
def plan_folder(whole, tmp_path):
    """Folder of a plan: every variable that one has, without a motion."""
    folder = tmp_path / "plan"
    folder.mkdir()
    sizes = {"time": 2, "configuration": 3, "velocity": 3, "joint": 1, "tip": 1, "axis": 3}
    variables = {
        name: (dims, np.zeros([sizes[dim] for dim in dims]), {"units": "1"})
        for name, dims in DIMENSIONS.items()
        if name not in ("joint", "tip", "axis")
    }
    labels = {"joint": ["arm/a"], "tip": ["arm/tip"], "axis": ["x", "y", "z"]}
    xr.Dataset(variables, labels).to_netcdf(folder / "plan.nc", engine="netcdf4")
    errors = {"replay_error_m": {}, "followed_error_m": {}, "tolerance_m": 1e-3}
    verification = {"residual": 0.0, "second_order": "solved", "violations": [], **errors}
    numbers = {"duration_s": 1.0, "cost": 1.0, "intervals": 1, "order": 2, "unknowns": 1, "phases": []}
    numbers |= {"terms": {}, "choices": [], "solver_runs": []}
    summary = {"scenario": "s", **numbers, "verification": verification, "collision_avoidance": {}}
    (folder / "plan.json").write_text(json.dumps(summary))
    for name in ("scenario.yaml", "followed.yaml"):
        shutil.copy(whole / "result" / "scenario.yaml", folder / name)
    return folder


@pytest.mark.parametrize("name", ["plan.json", "plan.nc"])
def test_a_damaged_plan_ends_in_one_line(plan_folder, tmp_path, monkeypatch, capsys, undrawn, name):
    data, summary = read(plan_folder)
    data = data.drop_encoding()
    contents = [None, b"", b"[1]", b"{}", b'"x"', bytes(range(256))]
    if name == "plan.json":
        texts = ("scenario", "second_order")  # any text will do
        kept = {key: value for key, value in summary.items() if key not in texts}
        del kept["verification"]["second_order"]
        contents += [json.dumps(one).encode() for one in dropped(kept)]
    else:
        damaged = [data.drop_vars(key) for key in ("q", "joint_rate", "tip")]
        damaged += [data.assign(q=(data.q.dims, np.full(data.q.shape, value))) for value in (np.nan, "x")]
        damaged += [data.isel(time=slice(0, 0)), data.assign(q=("configuration", np.zeros(3)))]
        for one in damaged:
            one.to_netcdf(tmp_path / "damaged.nc", engine="netcdf4")
            contents.append((tmp_path / "damaged.nc").read_bytes())
    for content in contents:
        (plan_folder / name).unlink(missing_ok=True)
        if content is not None:
            (plan_folder / name).write_bytes(content)
        with pytest.raises(ResultError) as raised:
            sr.PlanResult.load(plan_folder)
        assert "\n" not in str(raised.value)
    (plan_folder / name).write_bytes(b"[1]")
    for command, option in READERS["result"]:
        assert told(monkeypatch, capsys, command, plan_folder, option, tmp_path / "out") == 2


@pytest.mark.parametrize("kind", WRITERS)
def test_what_goes_on_in_a_damaged_folder_ends_in_one_line_or_does_its_work(
    whole, tmp_path, monkeypatch, capsys, undrawn, kind
):
    folder = shutil.copytree(whole / kind, tmp_path / kind)
    files = [folder / name for name in FILES[kind]]
    files += sorted(folder.glob("journals/*/*"))[:1]
    for number, file in enumerate(files):
        content = file.read_bytes()
        file.write_bytes(content[: len(content) // 2] if number % 2 else b"[3]")
        command = [*WRITERS[kind][:1], whole / "small.yaml", *WRITERS[kind][1:]]
        told(monkeypatch, capsys, *command, "--out", folder)
        file.write_bytes(content)
