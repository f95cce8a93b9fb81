"""The command itself."""

import json

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from optim.campaign import load_campaign
from optim.campaign.rollouts.gain_sets import controllers, gain_sets
from spacerobot.common.errors import ScenarioError
from spacerobot.common.registry import COMMANDS
from tests import forks
from tests.oracles import one_arm

KP = json.dumps({"parameters": {"kp": {"paths": "robots.arm.tips.tip.pid.kp", "lower": 50, "upper": 90}}})
KP = KP[:-1] + ', "limits": {"grip_force": 7}}'


@pytest.fixture
def invoke():
    app = typer.Typer(pretty_exceptions_enable=False)
    for name in ("campaign", "robust", "report"):
        COMMANDS.find(name).join(app)
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
    for text in ("probability of failure", "percentiles", "worst sample", "reproduce: spacerobot run", "ran"):
        assert text in done.output
    summary = json.loads((out / "summary.json").read_text())
    assert list(summary["gains"]) == ["scenario", "soft", "ran"]
    assert summary["samples"] == 30
    assert "30 of 30 samples" in invoke(*words).output
    assert "holds another campaign" in str(invoke(small_file, "--out", out, "--samples", 31).exception)


def test_a_sample_that_no_base_can_close_fails_by_the_grasps_name(invoke, tmp_path, undrawn):
    """Its own command is refused for the same grasp; the others are simulated."""
    from spacerobot.cli.app import app
    from spacerobot.scene import load_scene

    placed = load_scene(one_arm.write(tmp_path)).q[-4:-2].tolist()
    fixed = {"urdf": "rectangle.urdf", "base": {"joint": "fixed", "position": [*placed, 0.0]}}
    bend = {"bend": {"paths": "robots.arm.joints.joint_2.angle_deg", "lower": -73, "upper": -67}}
    section = {"parameters": bend, "samples": 16, "step": 0.01}
    file = one_arm.write(tmp_path, target=fixed, campaign=section)
    done = invoke(file, "--out", tmp_path / "store", "--report")
    assert done.exit_code == 0, done.output
    summary = json.loads((tmp_path / "store" / "summary.json").read_text())
    told = summary["gains"]["scenario"]
    count = told["failure"]["unclosed"]["count"]
    assert 0 < count < 16
    assert told["failure"]["diverged"]["count"] == 0
    (caveat,) = summary["caveats"]
    assert caveat.startswith(
        f"gains scenario: {count} of 16 samples fail before they begin; the first: grasps.left"
    )
    assert told["worst"][0]["unclosed"] is None
    data = load_campaign(tmp_path / "store")
    gaps = data.gap.values[:, 0, 0]
    assert (gaps > 0.01).sum() == count
    assert np.array_equal(np.isfinite(data.diverged_at.values[:, 0]), gaps > 0.01)
    sample = data.draw.values[np.argmax(gaps), 0]
    words = ["run", str(file), "--set", f"robots.arm.joints.joint_2.angle_deg={sample}"]
    refused = CliRunner().invoke(app, [*words, "--out", str(tmp_path / "again")])
    assert f"grasps.left: does not close: arm/tip is {gaps.max():.4g} m from mate_1" in str(refused.exception)


def test_gains_of_a_result_and_unknown_ones(small, small_file, tmp_path):

    from spacerobot.simulation import simulate

    simulate(small(**{"robots.arm.tips.tip.pid.kp": 61})).save(tmp_path / "one")
    found = controllers(small(), tmp_path / "one")
    assert found["robots.arm.tips.tip.pid"]["kp"] == 61
    assert gain_sets(small(), []) is None
    assert gain_sets(small(), ["stiff"]) == {"stiff": {"robots.*.tips.tip.pid.kp": 300}}
    faults = {
        "stif": "did you mean stiff",
        "a=nowhere": "no such file",
        "soft soft": "twice",
        "a=": "found 'a=', allowed: NAME=DIR",
        "=out": "found '=out', allowed: NAME=DIR",
        "a/b=out": "the name of letters",
        "scenario=out": "names a set of the scenario's already",
        "stiff=out": "names a set of the scenario's already",
    }
    for asked, words in faults.items():
        with pytest.raises(ScenarioError, match=words):
            gain_sets(small(), asked.split())


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (
            ["--set", "campaign.design=grid", "--samples", 9],
            "--samples: a grid's samples follow from its levels",
        ),
        (["--set", "campaign=null", "--samples", 9], "no campaign section"),
        (["--set", "campaign.series=[tip_eror]"], "no signal 'tip_eror'; did you mean tip_error"),
        (
            ["--set", "grasps={}", "--set", "target=null", "--set", f"campaign={KP}"],
            "this scene has no grasp",
        ),
    ],
)
def test_faults_are_told_before_anything_runs(invoke, small_file, tmp_path, words, fault):
    done = invoke(small_file, *words, "--out", tmp_path / "store")
    assert isinstance(done.exception, ScenarioError)
    assert fault in str(done.exception)
    assert not (tmp_path / "store").exists()


def test_a_folder_of_something_else_is_refused_before_anything_is_built(
    invoke, small_file, tmp_path, monkeypatch
):
    monkeypatch.setattr("optim.campaign.run.build_evaluator", lambda *_: pytest.fail("built"))
    (tmp_path / "letter.txt").write_text("dear")
    assert "no campaign" in str(invoke(small_file, "--out", tmp_path).exception)


FULL = """
import resource, signal, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)  # as a full disk
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
del sys.argv[1]
from spacerobot.cli.app import main
main()
"""


def test_a_full_disk_takes_nothing_with_it(invoke, small_file, tmp_path):
    section = ["--set", "campaign.series=[joint_torque, tip_error]", "--set", "campaign.series_step=0.01"]
    words = ["campaign", str(small_file), "--out", str(tmp_path / "store"), *section, "--threads", "1"]
    child = forks.run(FULL, 850000, *words)
    assert child.returncode == 2
    assert child.stderr.count("\n") == 1
    assert "campaign.nc: cannot be written" in child.stderr
    assert not list((tmp_path / "store").glob(".merge-*"))
    assert invoke(*words[1:]).exit_code == 0
    assert load_campaign(tmp_path / "store").sizes["sample"] == 100


def test_ctrl_c_keeps_what_is_there(invoke, small_file, tmp_path, monkeypatch):
    from optim.campaign import LocalExecutor

    def work(self, evaluator, draws, chunks):
        yield 0, evaluator.evaluate(draws[:11])
        raise KeyboardInterrupt

    monkeypatch.setattr(LocalExecutor, "work", work)
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


def test_a_grid_over_two_parameters_is_a_map(invoke, small_file, tmp_path, monkeypatch):
    monkeypatch.setattr("viz.report.sections.to_bytes", lambda *_: b"<svg/>")  # figures of single results
    mass = {"paths": "target.links.body.mass", "lower": 10, "upper": 50, "levels": 3}
    spin = {"paths": "target.base.spin_deg.2", "lower": -40, "upper": 40, "levels": 5}
    section = {"parameters": {"mass": mass, "spin": spin}, "design": "grid", "step": 0.01}
    words = ["--set", "campaign=" + json.dumps(section | {"limits": {"grip_force": 7.0}})]
    done = invoke(small_file, *words, "--out", tmp_path / "store", "--report")
    assert done.exit_code == 0, done.output
    assert '<section id="campaign">' in (tmp_path / "store" / "report.html").read_text()
    assert "outcome over two parameters" in done.output
    summary = json.loads((tmp_path / "store" / "summary.json").read_text())
    told = summary["gains"]["scenario"]["map"]
    assert told["first"] == [10, 30, 50]
    assert told["second"] == [-40, -20, 0, 20, 40]
    data = load_campaign(tmp_path / "store")
    grip = data.grip_force_peak.values.reshape(3, 5)
    assert told["failed"] == [["grip_force" if force > 7 else "" for force in row] for row in grip]
    assert 0 < (grip > 7).sum() < 15
