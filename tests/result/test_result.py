"""Results against hand-made data, and folders that are whole or not there."""

import collections.abc
import dataclasses
import hashlib
import json
import os
import signal
import sys
import types
import typing

import numpy as np
import pinocchio as pin
import pytest
import xarray as xr

from spacerobot.cli.app import main
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ResultError
from spacerobot.result import Result, Summary, check_folder, note_derived
from spacerobot.result.ledger import build_ledger
from spacerobot.result.metrics import _unwrapped_angle, body_motion, greatest_torque, tip_errors
from spacerobot.result.store import FILES
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate


@pytest.fixture(scope="module")
def result():
    return simulate(load_scene("paper", {"simulation.duration": 1.0, "simulation.output_step": 0.05}))


def test_dataset_has_the_promised_variables_labels_and_units(result):
    data = result.data
    assert list(data.tip.values) == ["rpr1/tip", "rpr2/tip"]
    assert list(data.body.values) == ["rpr1", "rpr2", "target"]
    assert list(data.joint.values)[:2] == ["rpr1/joint_1", "rpr1/joint_2"]
    assert data.tip_error.dims == ("time", "tip", "axis")
    assert data.body_orientation.dims == ("time", "body", "quaternion")
    assert data.sizes["time"] == 21
    for name in data.data_vars:
        assert data[name].attrs["units"], name
        assert data[name].attrs["long_name"], name


def mismatches(value, kind, place="summary"):
    """Places where a value differs from a type that ``typing`` describes."""
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin is typing.NotRequired:
        return mismatches(value, arguments[0], place)
    if kind is typing.Any:
        return []
    if typing.is_typeddict(kind):
        keys = typing.get_type_hints(kind, include_extras=True)
        required = {key for key, one in keys.items() if typing.get_origin(one) is not typing.NotRequired}
        found = [f"{place}: {key}" for key in ({*value} - {*keys}) | (required - {*value})]
        return found + [m for k in {*value} & {*keys} for m in mismatches(value[k], keys[k], f"{place}.{k}")]
    if origin in (typing.Union, types.UnionType):
        return min((mismatches(value, one, place) for one in arguments), key=len)
    if origin is typing.Literal:
        return [] if value in arguments else [place]
    if origin is list:
        return [m for i, one in enumerate(value) for m in mismatches(one, arguments[0], f"{place}.{i}")]
    if origin is collections.abc.Mapping:
        return [m for k, one in value.items() for m in mismatches(one, arguments[1], f"{place}.{k}")]
    return [] if isinstance(value, (int, float) if kind is float else kind) else [place]


def test_the_summary_has_the_keys_and_types_that_type_checkers_read(result):
    assert mismatches(result.summary, Summary) == []
    docked = simulate(load_scene("docking", {"simulation.duration": 17.0}), backend="interpreted")
    assert {"events", "missed"} & {*docked.summary}
    assert mismatches(docked.summary, Summary) == []
    assert mismatches({**result.summary, "nmae": 1}, Summary) == ["summary: nmae"]


def test_tip_error_is_reference_minus_position(result):
    data = result.data
    difference = data.tip_reference - data.tip_position
    np.testing.assert_allclose(data.tip_error.values, difference.values, atol=1e-15)


def test_rows_of_q_go_straight_into_pinocchio(result):
    scene, data = result.scene(), result.data
    pin_data = scene.model.createData()
    row = data.isel(time=-1)
    pin.framesForwardKinematics(scene.model, pin_data, row.q.values)
    for tip in scene.tips:
        found = pin_data.oMf[tip.frame].translation
        np.testing.assert_allclose(found, row.tip_position.sel(tip=tip.label).values, atol=1e-12)
    for body in scene.bodies:
        placement = pin_data.oMf[body.root_frame]
        quaternion = pin.Quaternion(row.body_orientation.sel(body=body.name).values)
        np.testing.assert_allclose(quaternion.matrix(), placement.rotation, atol=1e-12)
        angle = float(row.body_angle.sel(body=body.name))
        np.testing.assert_allclose([np.cos(angle), np.sin(angle)], placement.rotation[:2, 0], atol=1e-12)


def test_body_angle_is_unwrapped_through_half_a_turn():
    scene = load_scene("paper", {"robots.rpr2.base.spin_deg.2": 30.0, "simulation.duration": 1.0})
    angle = simulate(scene).data.body_angle.sel(body="rpr2").values
    assert np.abs(np.diff(angle)).max() < 0.1
    assert angle[-1] > np.pi + 0.2


def test_momentum_of_the_dataset_is_pinocchios(result):
    scene, row = result.scene(), result.data.isel(time=10)
    pin_data = scene.model.createData()
    pin.computeCentroidalMomentum(scene.model, pin_data, row.q.values, row.v.values)
    linear = pin_data.hg.linear
    angular = pin_data.hg.angular + np.cross(pin_data.com[0], linear)
    np.testing.assert_allclose(row.momentum_linear.values, linear, atol=1e-12)
    np.testing.assert_allclose(row.momentum_angular.values, angular, atol=1e-12)
    kinetic = pin.computeKineticEnergy(scene.model, pin_data, row.q.values, row.v.values)
    assert float(row.energy_kinetic) == pytest.approx(kinetic, rel=1e-12)


def hand_made(**changes):
    time = np.array([0.0, 1.0, 2.0])
    error = np.zeros((3, 1, 3))
    error[:, 0, 0] = [0.001, -0.003, 0.002]
    rotation = np.zeros((3, 2, 3))
    rotation[1, 1, 2] = np.radians(2.0)
    position = np.zeros((3, 2, 3))
    position[2, 0] = [3.0, 4.0, 0.0]
    partial = np.zeros((3, 2, 3))
    partial[1, :, 0] = [2.0, -2.0 + 1e-6]
    data = {
        "tip_error": (("time", "tip", "axis"), error),
        "body_rotation": (("time", "body", "axis"), rotation),
        "body_position": (("time", "body", "axis"), position),
        "joint_torque": (("time", "joint"), np.array([[0.0, 1.0], [-5.0, 2.0], [0.0, 0.0]])),
        "body_momentum_linear": (("time", "body", "axis"), partial),
        "body_momentum_angular": (("time", "body", "axis"), 0 * partial),
        "momentum_linear": (("time", "axis"), partial.sum(axis=1)),
        "momentum_angular": (("time", "axis"), 0 * partial.sum(axis=1)),
        "energy_kinetic": ("time", np.array([0.0, 3.0, 1.0])),
        "energy_spring": ("time", np.array([0.0, 0.5, 0.0])),
        "energy_potential": ("time", np.zeros(3)),
        "work_actuator": ("time", np.array([0.0, 4.0, 2.5]), {"sign": 1}),
        "work_joint": ("time", np.array([0.0, 0.25, 1.0]), {"sign": -1}),
        "work_grasp": ("time", np.array([0.0, 0.25, 0.5]), {"sign": -1}),
        "work_constraint": ("time", np.zeros(3), {"sign": 1}),
    }
    coords = {
        "time": time,
        "tip": ["a/tip"],
        "axis": ["x", "y", "z"],
        "body": ["a", "target"],
        "joint": ["j1", "j2"],
        "joint_kind": ("joint", ["revolute", "prismatic"]),
    }
    return xr.Dataset(data | changes, coords, {"outside": ""})


def test_metrics_of_hand_made_data():
    data = hand_made()
    x = tip_errors(data)["a/tip"]["x"]
    assert (x["min_m"], x["max_m"], x["final_m"]) == (-0.003, 0.002, 0.002)
    assert x["rms_m"] == pytest.approx(np.sqrt(14e-6 / 3))
    moved = body_motion(data)
    assert moved["a"] == {"max_rotation_deg": 0.0, "max_travel_m": 5.0}
    assert moved["target"]["max_rotation_deg"] == pytest.approx(2.0)
    greatest = {"torque_n_m": 5.0, "joint": "j1", "time_s": 1.0, "unit": "N m"}
    assert greatest_torque(data) == greatest
    swapped = hand_made(joint_torque=(("time", "joint"), data.joint_torque.values[:, ::-1]))
    assert greatest_torque(swapped) == greatest | {"joint": "j2", "unit": "N"}
    turns = hand_made(body_angle=(("time", "body"), np.radians([[90, 0], [100, -500], [110, -400]])))
    moved = body_motion(turns)
    assert moved["a"]["max_rotation_deg"] == pytest.approx(20.0)
    assert moved["target"]["max_rotation_deg"] == pytest.approx(500.0)


def test_whole_turns_count_in_space_as_in_a_plane():
    count = 200
    angle = np.radians(480) * np.sin(np.linspace(0, 2.2, count))  # and back a little
    axis = np.array([1.0, 2.0, 2.0]) / 3
    shortest = (angle + np.pi) % (2 * np.pi) - np.pi
    turned = _unwrapped_angle(shortest[:, None] * axis)
    np.testing.assert_allclose(turned, np.abs(angle), atol=1e-12)


def test_ledger_of_hand_made_data():
    scenario = load_scene("paper").scenario
    ledger = build_ledger(hand_made(), scenario)
    assert ledger["momentum"]["linear"]["relative_drift"] == pytest.approx(1e-6 / 2.0)
    assert ledger["energy"]["largest_residual_j"] == pytest.approx(0.0, abs=1e-15)
    leak = hand_made(work_grasp=("time", np.array([0.0, 0.25, 0.4]), {"sign": -1}))
    assert build_ledger(leak, scenario)["energy"]["relative_residual"] == pytest.approx(0.1 / 4.0)


def test_momentum_of_bodies_that_hold_nothing_is_measured_by_what_moves_inside_them():
    """Alone, each robot's momentum stays zero to rounding, which is no measure of the drift."""
    loose = {"grasps": {}, "target": None, "robots.rpr2.base": {"joint": "planar", "position": [5, 0, 0]}}
    result = simulate(load_scene("paper", loose | {"simulation.duration": 1.0}))
    for kind in ("linear", "angular"):
        momentum = result.summary["ledger"]["momentum"][kind]
        assert momentum["relative_drift"] < 1e-6
    mass = 2 * (200 + 8 * 11.76)
    most = np.sqrt(2 * mass * float(result.data.energy_kinetic.max()))
    assert result.summary["ledger"]["momentum"]["linear"]["largest_partial_n_s"] == pytest.approx(1e-3 * most)


def test_ledger_says_why_momentum_is_not_conserved():
    scenario = load_scene("paper").scenario
    data = hand_made().assign_attrs(outside="a base is fixed, gravity acts")
    found = build_ledger(data, scenario)["momentum"]
    assert found == {"conserved": False, "reason": "a base is fixed, gravity acts"}


@pytest.mark.parametrize(
    ("changes", "outside"),
    [
        ({}, ()),
        ({"gravity": [0, -1, 0]}, ("gravity acts",)),
        ({"robots.rpr1.base.joint": "fixed"}, ("a base is fixed",)),
    ],
)
def test_what_acts_from_outside_is_said_by_the_closed_loop(changes, outside):
    assert build_closed_loop(load_scene("paper", changes)).outside == outside


def test_folder_reads_back_and_runs_again_to_the_same_result(result, tmp_path):
    saved = result.save(tmp_path / "a" / "b")
    again = Result.load(tmp_path / "a" / "b")
    assert again.scenario == result.scenario
    xr.testing.assert_identical(again.data, saved.data)
    rerun = simulate(load_scene(saved.folder / "scenario.yaml"))
    np.testing.assert_array_equal(rerun.data.q.values, result.data.q.values)
    np.testing.assert_array_equal(rerun.data.joint_torque.values, result.data.joint_torque.values)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_saving_leaves_nothing_beside_the_result(result, tmp_path):
    result.save(tmp_path / "r")
    result.save(tmp_path / "r")
    assert names(tmp_path) == ["r"]
    assert names(tmp_path / "r") == sorted(FILES)


def test_a_failing_write_keeps_what_was_there(result, tmp_path, monkeypatch):
    result.save(tmp_path / "r")
    before = {name: (tmp_path / "r" / name).read_bytes() for name in FILES}

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(xr.Dataset, "to_netcdf", full)
    with pytest.raises(ResultError, match="No space left"):
        result.save(tmp_path / "r")
    with pytest.raises(ResultError, match="No space left"):
        result.save(tmp_path / "new" / "deep")
    assert {name: (tmp_path / "r" / name).read_bytes() for name in FILES} == before
    assert names(tmp_path) == ["r"]


def test_ctrl_c_while_saving_leaves_a_whole_result(result, tmp_path, monkeypatch):
    written = xr.Dataset.to_netcdf

    def interrupted(*arguments, **options):
        signal.raise_signal(signal.SIGINT)
        return written(*arguments, **options)

    monkeypatch.setattr(xr.Dataset, "to_netcdf", interrupted)
    with pytest.raises(KeyboardInterrupt):
        result.save(tmp_path / "r")
    assert names(tmp_path) == ["r"]
    assert Result.load(tmp_path / "r").completed


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_results_of_two_writers_do_not_mix(result, tmp_path):
    """One writes a result of 1 s again and again, the other one of 0.5 s; a reader sees either."""
    short = simulate(load_scene("paper", {"simulation.duration": 0.5, "simulation.output_step": 0.05}))
    result.save(tmp_path / "r")
    writers = []
    for own in (result, short):
        writers.append(os.fork())
        if writers[-1] == 0:  # the netCDF library stands no threads, so writers are processes
            for _ in range(8):
                own.save(tmp_path / "r")
            os._exit(0)
    left = list(writers)
    while left:
        left = [pid for pid in left if os.waitpid(pid, os.WNOHANG) == (0, 0)]
        seen = Result.load(tmp_path / "r")
        lasts = (seen.scenario.simulation.duration, seen.summary["status"]["reached_s"], seen.data.time[-1])
        assert len({round(float(last), 9) for last in lasts}) == 1


def test_folders_that_are_no_place_for_a_result(tmp_path):
    (tmp_path / "file").write_text("x")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.tex").write_text("x")
    for name, found in (
        ("file", "is a file"),
        ("full", "holds files, no"),
        ("file/below", "cannot be written"),
    ):
        with pytest.raises(ResultError, match=found):
            check_folder(tmp_path / name)
    check_folder(tmp_path / "fine" / "deep")
    assert not (tmp_path / "fine").exists()
    (tmp_path / "soon" / ".spacerobot-abc").mkdir(parents=True)  # another process prepares its result there
    check_folder(tmp_path / "soon")


@pytest.mark.parametrize("job", ["tuning.json", "comparison.json", "sweep.json", "robust.json"])
def test_a_job_writes_into_its_own_folder_or_an_empty_one(tmp_path, job):
    for folder, name in (("thesis", "thesis.tex"), ("other", "campaign.json"), ("own", job)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / name).write_text("{}")
    (tmp_path / "killed" / "journals").mkdir(parents=True)
    for fine in ("own", "killed", "new"):
        check_folder(tmp_path / fine, job)
    with pytest.raises(ResultError, match=r"thesis: holds files, not a .*; name an empty or a new folder"):
        check_folder(tmp_path / "thesis", job)
    with pytest.raises(ResultError, match="other: holds a campaign, not a "):
        check_folder(tmp_path / "other", job)
    (tmp_path / "killed" / "campaign.json").write_text("{}")
    with pytest.raises(ResultError, match="holds a campaign"):
        check_folder(tmp_path / "killed", job)


@pytest.mark.parametrize("job", ["tune", "robust", "sweep", "compare"])
def test_a_command_refuses_a_folder_of_other_files_before_it_begins(monkeypatch, capsys, tmp_path, job):
    (tmp_path / "thesis.tex").write_text("x")
    monkeypatch.setattr(sys, "argv", ["spacerobot", job, "paper", "--out", str(tmp_path)])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    assert "holds files, not a" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("kind", ["campaign", "comparison", "sweep"])
def test_another_jobs_folder_is_no_place_for_a_result(result, tmp_path, kind):
    """Even though files of the same names are in it."""
    for name in ("scenario.yaml", "summary.json", f"{kind}.json"):
        (tmp_path / name).write_text("{}")
    with pytest.raises(ResultError, match=f"holds a {kind}, no result; name an empty or a new folder"):
        check_folder(tmp_path)


def test_a_result_with_files_beside_it_and_a_half_written_one_are_replaced(result, tmp_path):
    folder = result.save(tmp_path / "whole").folder
    (folder / "report.html").write_text("x")
    check_folder(folder)
    (tmp_path / "half").mkdir()
    (tmp_path / "half" / "scenario.yaml").write_text("{}")
    check_folder(tmp_path / "half")


def test_what_was_made_from_a_result_goes_with_it_and_what_is_the_users_stays(result, tmp_path):
    saved = result.save(tmp_path / "r")
    folder = saved.folder
    (folder / "figures").mkdir()
    made = [folder / name for name in ("report.html", "figures/joints.png", "edited.html")]
    outside, mine = tmp_path / "page.html", folder / "figures" / "mine.png"
    for path in (*made, outside, mine):
        path.write_text(path.name)
    note_derived([saved.folder], [*made[:2], outside])
    note_derived([saved.folder, result.folder], made[2:])
    made[2].write_text("edited")
    result.save(folder)
    kept = {path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()}
    own = {"r/scenario.yaml", "r/summary.json", "r/result.nc"}
    assert kept == own | {"r/edited.html", "r/figures/mine.png", "page.html"}
    mine.unlink()
    made[1].write_text("made once more")
    note_derived([saved.folder], made[1:2])
    result.save(folder)
    assert not (folder / "figures").exists()


@pytest.mark.parametrize("kind", ["text", "list", "number", "above", "absolute", "link", "folder"])
def test_a_list_of_made_files_that_is_damaged_or_leads_elsewhere_removes_nothing(result, tmp_path, kind):
    folder = result.save(tmp_path / "r").folder
    victim = tmp_path / "victim"
    victim.write_text("mine")
    sha256 = hashlib.sha256(b"mine").hexdigest()
    (folder / "link").symlink_to(tmp_path)
    (folder / "folder").mkdir()
    texts = {
        "text": "{",
        "list": "[1]",
        "number": json.dumps({"../victim": 1}),
        "above": json.dumps({"../victim": sha256}),
        "absolute": json.dumps({str(victim): sha256}),
        "link": json.dumps({"link/victim": sha256}),
        "folder": json.dumps({"folder": sha256, "\0": sha256, "": sha256}),
    }
    (folder / "derived.json").write_text(texts[kind])
    result.save(folder)
    assert victim.read_text() == "mine"
    assert (folder / "folder").is_dir()
    assert not (folder / "derived.json").exists()


def test_incomplete_foreign_and_broken_results_are_refused(result, tmp_path):
    saved = result.save(tmp_path / "r").folder
    summary = json.loads((saved / "summary.json").read_text())
    (saved / "summary.json").write_text(json.dumps(summary | {"format": 99}))
    with pytest.raises(ResultError, match="another version: layout 99"):
        Result.load(saved)
    (saved / "summary.json").write_text("{")
    with pytest.raises(ResultError, match="cannot be read"):
        Result.load(saved)
    (saved / "summary.json").write_text(json.dumps(summary))
    (saved / "result.nc").write_bytes(b"not netCDF")
    with pytest.raises(ResultError, match="cannot be read"):
        Result.load(saved)
    (saved / "result.nc").unlink()
    with pytest.raises(ResultError, match=r"not a complete result: no result\.nc"):
        Result.load(saved)
    with pytest.raises(ResultError, match="no such folder"):
        Result.load(tmp_path / "nowhere")


def test_notebook_table_escapes_what_users_write(result):
    named = dataclasses.replace(result, summary=json.loads(json.dumps(result.summary).replace("rpr2", "<b>")))
    text = named._repr_html_().replace("<wbr>", "")
    assert "<b>" not in text
    assert "&lt;b&gt;" in text
    assert "tip error rpr1/tip" in text


def test_a_rollout_that_diverges_is_kept_up_to_there(tmp_path):
    scene = load_scene(
        "paper", {"simulation.step": 0.02, "simulation.method": "rk4", "simulation.duration": 2.0}
    )
    result = simulate(scene).save(tmp_path / "r")
    status = Result.load(tmp_path / "r").summary["status"]
    assert status["state"] == "diverged"
    assert 0 < status["diverged_at_s"] < 2.0
    assert result.data.time.values[-1] <= status["diverged_at_s"] + 1e-9
    assert np.isfinite(result.data.q.values).all()
