"""The main job: what it tells on the way, and what helps when it cannot be done."""

import dataclasses
import json
import re

import pytest

from spacerobot.cli.app import main
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import DivergedError, ScenarioError
from spacerobot.scene import load_scene
from spacerobot.scene.memory import numbers_each
from spacerobot.simulation import simulate, simulate_designs

SHORT = {"simulation.duration": 0.1, "simulation.output_step": 0.02}


def test_the_checking_engine_says_how_far_it_is():
    told = []
    simulate(load_scene("paper", SHORT | {"simulation.engine": "pinocchio"}), progress=told.append)
    parts = [int(found.group(1)) for words in told if (found := re.search(r"Pinocchio.*: (\d+)%$", words))]
    assert parts == [20, 40, 60, 80, 100]


def test_a_step_that_is_chosen_is_told():
    told = []
    result = simulate(load_scene("paper", SHORT | {"simulation.step": None}), progress=told.append)
    tried = [words for words in told if words.startswith("choosing a step: trying ")]
    assert tried[:2] == ["choosing a step: trying 0.02 s", "choosing a step: trying 0.01 s"]
    assert "step_chosen" in result.summary["engine"]


def test_a_loop_too_stiff_for_any_step_names_the_last_one_and_what_helps():
    stiff = {"simulation.step": None, "robots.*.joint_pd": {"kp": 50, "kd": 2e9}}
    with pytest.raises(DivergedError) as raised:
        simulate(load_scene("paper", SHORT | stiff))
    text = str(raised.value)
    assert re.match(r"no step down to \d\.\d+e-0[67] s reaches an error of 1e-07: ", text)
    assert re.search(r"fastest rate at the start is \S+ 1/s, set by robots\.rpr1\.joint_pd\.kd", text)
    assert all(part in text for part in ("softer gains", "`simulation.step`", "`simulation.tolerance`"))


@pytest.mark.parametrize("path", ["target.base.spin_deg.2", "robots.rpr1.joints.joint_1.rate_deg"])
def test_a_start_beyond_all_numbers_is_refused_in_one_line(path):
    with pytest.raises(ScenarioError, match=r"found 1e\+300, allowed: numbers up to 1e\+100( \[deg/s\])?$"):
        load_scene("paper", SHORT | {path: 1e300})


@pytest.mark.parametrize("worst", [float("nan"), float("inf"), 1e200])
def test_what_lies_before_a_number_that_is_none_is_kept(worst, monkeypatch):
    import spacerobot.simulation.run as job

    run = job.Rollout.run

    def spoilt(rollout, *given, **asked):
        whole = run(rollout, *given, **asked)
        error = whole.outputs["tip_error"].copy()
        error[9:, 0] = worst  # every step of 5 ms is one
        return dataclasses.replace(whole, outputs={**whole.outputs, "tip_error": error})

    monkeypatch.setattr(job.Rollout, "run", spoilt)
    result = simulate(load_scene("paper", SHORT))
    status = result.summary["status"]
    assert (status["state"], status["trusted"]) == ("diverged", False)
    assert status["diverged_at_s"] == pytest.approx(0.04)
    assert result.data.sizes["time"] == 3
    json.dumps(result.summary, allow_nan=False)


def test_a_result_that_the_memory_does_not_hold_is_refused_before_it_runs(monkeypatch):
    monkeypatch.setattr("spacerobot.scene.memory.available_memory", lambda: 8e9)
    long = {"simulation.duration": 1e6, "simulation.output_step": 0.1}
    begin = []
    with pytest.raises(
        ScenarioError, match=r"simulation\.output_step: the result would take \S+ GB"
    ) as raised:
        simulate(load_scene("paper", long), progress=begin.append)
    assert begin == []
    raised.match(r"10000001 samples x \d+ numbers x 24 bytes\), allowed: \S+ GB, half of what is free; raise")
    raised.match(r"`simulation\.output_step` to \S+ s or more, or lower `simulation\.duration`")


@pytest.mark.parametrize("name", ["paper", "servicer"])
def test_what_a_result_takes_is_counted_from_its_scene(name):
    scene = load_scene(name, {"simulation.duration": 0.1, "simulation.step": 0.01})
    data = simulate(scene, backend="interpreted").data
    held = (
        sum(values.size for values in data.variables.values() if "time" in values.dims) / data.sizes["time"]
    )
    assert numbers_each(scene) == pytest.approx(held, rel=0.1)


@pytest.mark.parametrize("command", ["check", "tune", "compare", "robust"])
def test_every_command_refuses_it_in_one_line(command, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("spacerobot.scene.memory.available_memory", lambda: 8e9)
    to = [] if command == "check" else ["--out", str(tmp_path / "out")]
    long = ["--set", "simulation.duration=1e6", "--set", "simulation.output_step=0.1"]
    monkeypatch.setattr("sys.argv", ["spacerobot", command, "paper", *long, *to])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    assert "simulation.output_step: the result would take" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_far_from_the_origin_is_no_divergence():
    changes = {"robots.rpr1.base.position": [7e6, 0, 0], "simulation.duration": 0.2}
    assert simulate(load_scene("paper", changes)).completed


def test_headline_numbers_see_every_step_whatever_is_kept():
    changes = {"simulation.duration": 1.0, "simulation.step": 0.005}
    fine, coarse = (
        simulate(load_scene("paper", {**changes, "simulation.output_step": s})) for s in (0.02, 1.0)
    )
    assert len(coarse.data.time) == 2
    for name in ("tip_error", "greatest_torque", "greatest_grip", "bases", "target", "ledger"):
        assert _close(fine.summary[name], coarse.summary[name]), name


def test_designs_that_share_a_closed_loop_give_what_each_gives_alone():
    scene = load_scene("paper", {"simulation.duration": 0.4})
    path = "robots.rpr1.tips.tip.pid.kp"
    designs = {"own": {}, "soft": {path: 50.0}}
    for name, shared in simulate_designs(scene, build_closed_loop(scene), designs):
        alone = simulate(load_scene("paper", {"simulation.duration": 0.4, **designs[name]}))
        assert shared.scenario == alone.scenario
        assert shared.summary["tip_error"] == alone.summary["tip_error"]
        assert shared.summary["engine"] == alone.summary["engine"]


def _close(one, other):
    if isinstance(one, dict):
        return all(_close(value, other[key]) for key, value in one.items())
    return one == pytest.approx(other, rel=1e-6, abs=1e-9) if isinstance(one, float) else one == other


def test_a_step_that_is_too_long_is_warned_of():
    changes = {"simulation.duration": 0.4, "simulation.method": "rk4", "simulation.step": 0.01}
    result = simulate(load_scene("paper", changes))
    assert any("a single step errs by up to" in warning for warning in result.summary["warnings"])
    assert float(result.summary["engine"]["step_error"]) > 1e-5
