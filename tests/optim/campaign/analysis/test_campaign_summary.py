"""What a campaign says of itself, and the commands that run its samples again."""

import json
import shlex
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from optim.campaign.analysis.samples import command_of
from optim.campaign.analysis.summary import sample_statistics, summarise
from optim.campaign.rollouts.evaluator import build_evaluator
from optim.campaign.run import run_campaign
from optim.campaign.store.netcdf import load_campaign
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.elements.core import registry
from spacerobot.scenario.load import to_document
from spacerobot.scenario.paths import get
from spacerobot.scene import build_scene


@pytest.fixture(scope="module")
def told(small, tmp_path_factory):
    folder = tmp_path_factory.mktemp("told") / "store"
    ran = run_campaign(small(), folder)
    return ran, summarise(folder, ran.evaluator), load_campaign(folder)


def test_failures_are_counted(told):
    ran, summary, data = told
    assert json.loads((ran.folder / "summary.json").read_text()) == summary
    for name in ("soft", "stiff"):
        grip = data.grip_force_peak.sel(gains=name).values[:, 0]
        count = int((grip > 7.0).sum())
        found = summary["gains"][name]["failure"]
        assert 0 < count < 100
        assert found["grip_force"]["count"] == found["any"]["count"] == count
        assert found["grip_force"]["low"] < count / 100 < found["grip_force"]["high"]
        assert found["diverged"]["count"] == 0


def test_percentiles_and_worst_samples_are_the_stores(told):
    _, summary, data = told
    soft = summary["gains"]["soft"]
    x = data.tip_error_peak.sel(gains="soft").values
    row = soft["metrics"][0]
    assert (row["metric"], row["of"], row["unit"]) == ("tip_error_peak", "arm/tip x", "m")
    assert [q["value"] for q in row["percentiles"]] == pytest.approx(np.percentile(x[:, 0], [5, 50, 95, 99]))
    worst = soft["worst"]
    grip = data.grip_force_peak.sel(gains="soft").values[:, 0]  # what a limit is set for
    assert [w["sample"] for w in worst] == np.argsort(-grip, kind="stable")[:5].tolist()
    assert (worst[0]["metric"], worst[0]["value"]) == ("grip_force_peak", grip.max())
    assert worst[0]["draw"] == dict(
        zip(data.parameter.values, data.draw.values[worst[0]["sample"]], strict=True)
    )


def test_two_sets_on_the_same_samples(told):
    _, summary, data = told
    row = summary["against"][0]
    soft, stiff = (
        data.tip_error_peak.sel(gains=n).max("tip_error_peak_of").values for n in ("soft", "stiff")
    )
    assert (row["first"], row["second"], row["metric"]) == ("soft", "stiff", "tip_error_peak")
    assert row["first_is_better"]["value"] == pytest.approx((soft < stiff).mean())
    assert summary["against"][-1]["fails_alone"].keys() == {"soft", "stiff"}


def test_what_matters_is_found(told):
    _, summary, _ = told
    spin = summary["gains"]["stiff"]["matters"]["grip_force_peak"]
    assert spin["kind"] == "rank_correlation"
    assert set(spin["value"]) == {"mass", "spin", "com", "grip"}
    assert max(map(abs, spin["value"].values())) > summary["rank_noise"]


@pytest.mark.parametrize(("name", "at"), [("soft", 0), ("stiff", 2)])
def test_the_printed_command_runs_the_sample_again(told, tmp_path, name, at):
    from spacerobot.cli.app import app

    _, summary, data = told
    worst = summary["gains"][name]["worst"][at]
    words = shlex.split(worst["command"])
    assert words[:2] == ["spacerobot", "run"]
    done = CliRunner().invoke(app, [*words[1:], "--out", str(tmp_path / "again")])
    assert done.exit_code == 0, done.output
    again = json.loads((tmp_path / "again" / "summary.json").read_text())
    row = data.sel(sample=worst["sample"], gains=name)
    assert again["greatest_grip"]["force_n"] == pytest.approx(float(row.grip_force_peak[0]), rel=1e-9)
    assert again["greatest_torque"]["torque_n_m"] == pytest.approx(float(row.joint_torque_peak[0]), rel=1e-9)


def test_a_command_names_equal_numbers_once(told, small):
    ran, _, data = told
    words = shlex.split(command_of(ran.evaluator, data.draw.values[3], "soft", "my file.yaml"))
    assert words[2] == "my file.yaml"
    assert "robots.*.tips.tip.pid.kp=50" in words
    assert sum(word.startswith("grasps.*.stiffness=") for word in words) == 1


def test_a_command_loads_the_plugins_that_the_campaign_had(told, monkeypatch):
    monkeypatch.setitem(registry._PLUGINS, Path("/my plugins/one.py"), b"")
    ran, _, data = told
    words = shlex.split(command_of(ran.evaluator, data.draw.values[0], "soft", "my.yaml"))
    assert words[:5] == ["spacerobot", "run", "my.yaml", "--plugin", "/my plugins/one.py"]


def test_a_metric_that_is_not_known_may_be_a_plugins(small):
    with pytest.raises(ScenarioError, match=r"no 'my_peak'.*; your own come with --plugin FILE"):
        small(**{"campaign.metrics": ["my_peak"]})


def test_a_command_sets_what_a_later_pattern_meets_again(small):
    """Patterns that overlap: the command's changes, made in order, give the sample's own numbers."""
    paths = ["robots.arm.links.link_2.mass", "robots.arm.links.*.mass"]
    parameters = {"m": {"paths": paths, "apply": "factor", "lower": 0.5, "upper": 2}}
    scene = small(**{"campaign.parameters": parameters, "robots.arm.links.link_2.mass": 9.0})
    evaluator = build_evaluator(scene, {}, compiled=False)
    words = shlex.split(command_of(evaluator, np.array([1.5]), "scenario", "x"))
    changes = [word.split("=") for word in words if ".mass=" in word]
    made = build_scene(scene.scenario, [(path, float(value)) for path, value in changes], source=scene.source)
    space = evaluator.members[0].space
    found = [get(to_document(made.scenario), path) for path in space.paths]
    assert found == space.values(np.array([1.5]))[0].tolist()


@pytest.mark.parametrize("also", [[], ["robots.arm.links.link_2.inertia.2"]])
def test_a_sample_with_another_mass_is_what_its_command_runs(small, also):
    """The inertia follows the mass in the batch and under `--set`, and stands in both where varied too."""
    parameters = {"m": {"paths": "robots.arm.links.link_2.mass", "lower": 5, "upper": 30}}
    if also:
        parameters["i"] = {"paths": also, "lower": 0.5, "upper": 3}
    scene = small(**{"campaign.parameters": parameters})
    evaluator = build_evaluator(scene, {}, compiled=False)
    draw = np.array([20.0, 2.0])[: len(parameters)]
    words = shlex.split(command_of(evaluator, draw, "scenario", "x"))
    changes = [word.split("=") for word in words if ".links." in word]
    made = build_scene(scene.scenario, [(path, float(value)) for path, value in changes], source=scene.source)
    loop, own = evaluator.members[0].rollout.loop, build_closed_loop(made)
    values = dict(zip(evaluator.members[0].space.paths, map(float, draw), strict=True))
    x = loop.setup(loop.parameter_values)[0]
    found = loop.dynamics(0.2, x, loop.setup(loop.parameters(values))[1]).full().ravel()[: loop.nq + loop.nv]
    expected = own.dynamics(0.2, x[: own.nx], own.setup(own.parameter_values)[1]).full().ravel()
    np.testing.assert_allclose(found, expected[: loop.nq + loop.nv], atol=1e-12)
    assert len(changes) == len(parameters)


def test_divergence_counts_as_the_worst(told):
    ran, _, data = told
    lost = data.copy(deep=True)
    lost.diverged_at[7, 0] = 0.5
    lost.tip_error_peak[7, 0] = np.nan
    found = sample_statistics(lost, ran.evaluator)["soft"]
    assert found.failed["diverged"].sum() == 1
    assert found.largest("tip_error_peak")[7] == np.inf
    assert not found.failed["grip_force"][7]
    assert found.any_failure[7]


def test_sobol_indices_of_a_scene(small, tmp_path):
    pytest.importorskip("SALib")
    scene = small(
        **{
            "campaign.design": "saltelli",
            "campaign.samples": 32,
            "campaign.gains": {},
            "campaign.parameters": {
                "mass": {"paths": "target.links.body.mass", "lower": 10, "upper": 30},
                "rate": {"paths": "robots.arm.sensors.joint_position.offset", "lower": -1e-9, "upper": 1e-9},
            },
        }
    )
    with_pd = {"robots.arm.joint_pd": {"kp": 5, "kd": 1}}
    ran = run_campaign(scene, tmp_path / "store", gains={"pd": with_pd})
    summary = summarise(ran.folder, ran.evaluator)
    entry = summary["gains"]["pd"]["matters"]["grip_force_peak"]
    assert entry["kind"] == "sobol"
    assert entry["total"]["mass"] == pytest.approx(1, abs=0.05)  # the other hardly varies
    assert entry["total"]["rate"] == pytest.approx(0, abs=0.01)
    assert summary["gains"]["pd"]["failure"]["any"]["low"] is None
