"""Exports: formats by name and suffix, what each takes, errors in one line, files whole or not at all."""

import csv

import numpy as np
import pytest
from scipy.io import loadmat

import spacerobot as sr
from spacerobot.cli import app
from spacerobot.common.errors import ResultError, SpaceRobotError
from spacerobot.common.registry import EXPORT_FORMATS
from spacerobot.exports.export import export, format_of
from spacerobot.exports.signals import signals


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    scene = sr.load_scene("docking", {"simulation.duration": 1})
    return sr.simulate(scene, backend="interpreted").save(tmp_path_factory.mktemp("result") / "docking")


def run(*arguments):
    app.command_line()(["export", *map(str, arguments)], standalone_mode=False)


def test_csv_holds_every_signal_to_the_bit(result, tmp_path):
    path = sr.export(result, tmp_path / "table.csv")
    with path.open(encoding="utf-8", newline="") as file:
        heading, *rows = csv.reader(file)
    table = np.array(rows, dtype=float)
    np.testing.assert_array_equal(table[:, 0], result.data.time)
    columns = dict(zip(heading, table.T, strict=True))
    error = result.data.tip_error.sel(tip="rpr2/tip", axis="y")
    np.testing.assert_array_equal(columns["tip_error[rpr2/tip,y] [m]"], error)
    np.testing.assert_array_equal(
        columns["body_angle[target] [rad]"], result.data.body_angle.sel(body="target")
    )
    per_row = sum(variable.size for variable in result.data.data_vars.values()) // len(table)
    assert len(heading) == 1 + per_row


def test_a_prismatic_joint_has_its_own_unit():
    joint = {"joint": ["a/turn", "a/slide"], "joint_kind": ("joint", ["revolute", "prismatic"])}
    import xarray as xr

    attributes = {"units": "rad/s or m/s", "long_name": "rates"}
    data = xr.Dataset(
        {"rate": (("time", "joint"), np.ones((3, 2)), attributes)}, {"time": [0.0, 1, 2]} | joint
    )
    assert [(one.name, one.unit) for one in signals(data)] == [
        ("rate[a/turn]", "rad/s"),
        ("rate[a/slide]", "m/s"),
    ]


def test_mat_is_read_by_scipy(result, tmp_path):
    content = loadmat(sr.export(result, tmp_path / "table.mat"), simplify_cells=True)
    np.testing.assert_array_equal(content["tip_error"], result.data.tip_error)
    np.testing.assert_array_equal(content["time"], result.data.time)
    assert content["units"]["tip_error"] == "m"
    assert list(content["dimensions"]["tip_error"]) == ["time", "tip", "axis"]
    assert list(content["labels"]["tip"]) == ["rpr1/tip", "rpr2/tip"]


def test_the_command_line_writes_the_same(result, tmp_path):
    sr.export(result, tmp_path / "one.csv")
    run(result.folder, tmp_path / "two.csv")
    run("csv", result.folder, "--out", tmp_path / "three")
    texts = {(tmp_path / name).read_bytes() for name in ("one.csv", "two.csv", "three")}
    assert len(texts) == 1


def test_every_format_is_listed_and_states_what_it_takes(capsys):
    run("--list")
    listed = capsys.readouterr().out
    suffixes = [suffix for kind in EXPORT_FORMATS.entries().values() for suffix in kind.suffixes]
    assert len(suffixes) == len(set(suffixes))
    for name, kind in EXPORT_FORMATS.entries().items():
        assert name in listed
        assert kind.summary
        assert set(kind.takes) <= {"result", "plan", "scene"}
        assert all(field.description for field in kind.options.model_fields.values())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("docking", "x.csv"), "format csv: takes a result or a plan; found the scenario 'docking': first"),
        (("docking", "x.nothing"), "suffix '.nothing' names no format; allowed: .*csv"),
        (("nothing", "docking", "--out", "x"), "no format 'nothing'; allowed: .*csv"),
        (("docking", "x.csv", "--colour"), "format csv: no option 'colour'; it has none"),
        (("docking",), "found 'docking', allowed: SOURCE PATH"),
        (("nowhere", "x.csv"), "no such file, nor a shipped scenario"),
        (("tests", "x.csv"), "holds neither a result nor a plan"),
    ],
)
def test_errors_are_one_line_and_nothing_is_written(arguments, message, tmp_path, monkeypatch):
    (tmp_path / "tests").mkdir()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SpaceRobotError, match=message) as error:
        run(*arguments)
    assert "\n" not in str(error.value)
    assert [path.name for path in tmp_path.iterdir()] == ["tests"]


def test_an_export_that_fails_leaves_the_earlier_file(result, tmp_path, monkeypatch):
    path = tmp_path / "table.csv"
    path.write_text("earlier")

    def fails(self, source, path, options):
        path.write_text("half")
        raise SpaceRobotError("no counterpart")

    monkeypatch.setattr(type(format_of(path)), "write", fails)
    with pytest.raises(SpaceRobotError, match="no counterpart"):
        export(result, path)
    assert path.read_text() == "earlier"
    assert [one.name for one in tmp_path.iterdir()] == ["table.csv"]


def test_a_folder_is_no_file(result, tmp_path):
    (tmp_path / "table.csv").mkdir()
    with pytest.raises(ResultError, match="is a folder; the format csv writes a file"):
        export(result, tmp_path / "table.csv")


def test_an_export_in_a_results_folder_goes_with_the_result(result, tmp_path):
    saved = result.save(tmp_path / "again")
    sr.export(saved, tmp_path / "again" / "table.csv")
    saved.save(tmp_path / "again")
    assert not (tmp_path / "again" / "table.csv").exists()
