"""The command itself."""

import json

import pytest
import typer
from typer.testing import CliRunner

from optim.campaign import load_campaign
from optim.campaign.gains import controllers, gain_sets
from spacerobot.cli import campaign, report, robust
from spacerobot.errors import ScenarioError


@pytest.fixture
def invoke():
    app = typer.Typer(pretty_exceptions_enable=False)
    for module in (campaign, robust, report):
        module.register(app)
    return lambda *words, name="campaign": CliRunner().invoke(app, [name, *map(str, words)])


def test_a_campaign_from_the_command_line(invoke, small_file, tmp_path):
    from spacerobot.cli.app import app

    words = [small_file, "--set", "robots.arm.tips.tip.pid.kp=77", "--out", tmp_path / "result"]
    assert CliRunner().invoke(app, ["run", *map(str, words)]).exit_code == 0
    out = tmp_path / "store"
    words = [small_file, "--out", out, "--samples", 30, "--threads", 1]
    words += ["--gains", "scenario", "--gains", "soft", "--gains", f"ran={tmp_path / 'result'}"]
    done = invoke(*words)
    assert done.exit_code == 0, done.output
    for text in ("probability of failure", "percentiles", "worst sample", "again: spacerobot run", "ran"):
        assert text in done.output
    summary = json.loads((out / "summary.json").read_text())
    assert list(summary["gains"]) == ["scenario", "soft", "ran"]
    assert summary["samples"] == 30
    assert "30 of 30 samples" in invoke(*words).output
    assert "holds another campaign" in str(invoke(small_file, "--out", out, "--samples", 31).exception)


def test_gains_of_a_result_and_unknown_ones(small, small_file, tmp_path):
    from spacerobot.result import save
    from spacerobot.simulate import simulate

    save(simulate(small(**{"robots.arm.tips.tip.pid.kp": 61})), tmp_path / "one")
    found = controllers(small(), tmp_path / "one")
    assert found["robots.arm.tips.tip.pid"]["kp"] == 61
    assert gain_sets(small(), []) is None
    assert gain_sets(small(), ["stiff"]) == {"stiff": {"robots.*.tips.tip.pid.kp": 300}}
    faults = {"stif": "did you mean stiff", "a=nowhere": "no such file", "soft soft": "twice"}
    for asked, words in faults.items():
        with pytest.raises(ScenarioError, match=words):
            gain_sets(small(), asked.split())


def test_ctrl_c_keeps_what_is_there(invoke, small_file, tmp_path, monkeypatch):
    from optim.campaign import Here

    def work(self, evaluator, draws, chunks):
        yield 0, evaluator.evaluate(draws[:11])
        raise KeyboardInterrupt

    monkeypatch.setattr(Here, "work", work)
    done = invoke(small_file, "--out", tmp_path / "store")
    assert done.exit_code == 130
    assert "11 of 100 samples" in done.output
    assert "11 samples" in done.output


def test_robust_tuning_from_the_command_line(invoke, small_file, tmp_path):
    kp = {"paths": "robots.*.tips.tip.pid.kp", "lower": 20, "upper": 400}
    tuning = json.dumps({"variables": {"kp": kp}, "step": 0.01, "starts": 1, "iterations": 8})
    words = [small_file, "--set", f"tuning={tuning}", "--samples", 9, "--fresh", 20, "--out", tmp_path / "r"]
    done = invoke(*words, "--measure", "mean", name="robust")
    assert done.exit_code == 0, done.output
    for text in ("objective on 20 fresh samples", "start", "nominal", "robust"):
        assert text in done.output
    told = json.loads((tmp_path / "r" / "robust.json").read_text())
    assert told["fresh"]["robust"]["mean"] < told["fresh"]["start"]["mean"]
    done = invoke(small_file, "--out", tmp_path / "s", "--samples", 5, "--gains", f"robust={tmp_path / 'r'}")
    assert done.exit_code == 0, done.output


def test_a_grid_over_two_parameters_is_a_map(invoke, small_file, tmp_path):
    mass = {"paths": "target.links.body.mass", "lower": 10, "upper": 50, "levels": 3}
    spin = {"paths": "target.base.spin_deg.2", "lower": -40, "upper": 40, "levels": 5}
    section = {"parameters": {"mass": mass, "spin": spin}, "design": "grid", "step": 0.01}
    words = ["--set", "campaign=" + json.dumps(section | {"limits": {"grip_force": 7.0}})]
    done = invoke(small_file, *words, "--out", tmp_path / "store", "--report")
    assert done.exit_code == 0, done.output
    assert '<section id="campaign">' in (tmp_path / "store" / "report.html").read_text()
    assert "where it holds" in done.output
    summary = json.loads((tmp_path / "store" / "summary.json").read_text())
    told = summary["gains"]["scenario"]["map"]
    assert told["first"] == [10, 30, 50]
    assert told["second"] == [-40, -20, 0, 20, 40]
    data = load_campaign(tmp_path / "store")
    grip = data.grip_force_peak.values.reshape(3, 5)
    assert told["failed"] == [["grip_force" if force > 7 else "" for force in row] for row in grip]
    assert 0 < (grip > 7).sum() < 15
