"""Worst cases and failure probabilities of a simulated arm, against plain samples and a grid."""

import json

import numpy as np
import pytest
from scipy import stats
from typer.testing import CliRunner

import spacerobot as sr
from optim.campaign.sampling.samplers import draw, probabilities, quantiles, score_values
from optim.reliability.limit_state import RolloutLimitState, build_limit_state
from spacerobot.cli.app import app
from spacerobot.common.errors import DivergedError, ScenarioError, SpaceRobotError
from spacerobot.scenario import UncertainParameter

FEW = sr.SamplingEffort(budget=1000)
CAMPAIGN = {
    "parameters": {
        "mass": {
            "paths": "target.links.body.mass",
            "apply": "factor",
            "kind": "lognormal",
            "median": 1,
            "sigma": 0.2,
        },
        "grip": {"paths": "grasps.left.stiffness", "apply": "factor", "lower": 0.7, "upper": 1.3},
        "tumble": {"paths": "target.base.spin_deg.2", "kind": "normal", "mean": 0, "std": 1},
    },
    "correlation": [[1, 0.5, 0], [0.5, 1, 0], [0, 0, 1]],
    "metrics": ["tip_error_peak"],
    "limits": {"tip_error": 0.01},
    "step": 0.01,
}


@pytest.fixture(scope="module")
def state(small):
    return build_limit_state(small(campaign=CAMPAIGN))


@pytest.fixture(scope="module")
def limit(state):
    """A limit that is rarely exceeded."""
    return 1.2 * float(state.quantities(state.draws(np.zeros(3))[0])[0])


@pytest.mark.parametrize(
    "parameter",
    [
        {"lower": -2, "upper": 3},
        {"kind": "normal", "mean": 1, "std": 2},
        {"kind": "lognormal", "median": 2, "sigma": 0.3},
        {"kind": "truncated_normal", "mean": 20, "std": 5, "lower": 5, "upper": 31},
    ],
)
def test_scores_and_quantiles_are_one_distribution(parameter):
    made, z = UncertainParameter(paths="a", **parameter), np.linspace(-3, 3, 25)
    values, slopes = score_values(made, z)
    assert values == pytest.approx(quantiles(made, stats.norm.cdf(z)), rel=1e-12)
    assert probabilities(made, values) == pytest.approx(stats.norm.cdf(z), rel=1e-9)
    ends = [score_values(made, z + h)[0] for h in (1e-5, -1e-5)]
    assert slopes == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-7)


def test_gradients_by_scores_are_finite_differences(state):
    z = np.random.default_rng(3).standard_normal((3, 3))
    value, slope = state.gradients(z)
    assert value == pytest.approx(state.values(z), rel=1e-9)
    h = 1e-4
    for i, step in enumerate(h * np.eye(3)):
        difference = (state.values(z + step) - state.values(z - step)) / (2 * h)
        assert slope[:, i] == pytest.approx(difference, rel=1e-4, abs=1e-9)


def test_a_probability_is_that_of_plain_samples(small, state):
    campaign = state.campaign.model_copy(update={"samples": 4096, "design": "monte_carlo"})
    values = state.quantities(draw(campaign))
    limit = float(np.quantile(values, 0.98))
    plain = float(np.mean(values > limit))
    for method in ("importance", "line", "subset"):
        found = sr.failure_probability(
            small(campaign=CAMPAIGN), limit=limit, method=method, effort=sr.SamplingEffort(0.05)
        )
        spread = np.hypot(found.variation * found.probability, np.sqrt(plain / 4096))
        assert abs(found.probability - plain) < 3 * spread
        assert found.interval[0] < found.probability < found.interval[1]


def test_the_most_probable_failure_is_on_the_limit(small, state, limit):
    found = sr.failure_probability(small(campaign=CAMPAIGN), limit=limit, effort=sr.SamplingEffort(0.2))
    for failure in found.failures:
        at = np.array(list(failure.parameters.values()))
        assert state.quantities(at[None])[0] == pytest.approx(limit, rel=1e-3)
        assert sum(failure.importance.values()) == pytest.approx(1)
    assert [f.beta for f in found.failures] == sorted(f.beta for f in found.failures)
    # the first-order estimate Phi(-beta) of the nearest one is of the right size
    assert stats.norm.sf(found.failures[0].beta) == pytest.approx(found.probability, rel=1)


def test_the_worst_case_is_that_of_a_grid_and_no_better_is_found_at_random(small, state):
    campaign = {name: value for name, value in CAMPAIGN.items() if name != "correlation"}
    found = sr.falsify(small(campaign=campaign), effort=sr.Effort(starts=4))
    ends = [np.exp(0.2 * np.array([-3, 3])), np.array([0.7, 1.3]), np.array([-3.0, 3.0])]
    levels = [np.linspace(*end, 9) for end in ends]
    grid = np.array(np.meshgrid(*levels)).reshape(3, -1).T
    values = state.quantities(grid)
    assert found.worst.value >= values.max() * (1 - 1e-9)
    assert found.worst.value >= found.random.value
    assert found.worst.value == pytest.approx(values.max(), rel=0.02)
    assert found.is_falsified == (found.worst.value > 0.01)
    # the changed scene has this value, whatever computes it
    again = build_limit_state(found.scene(small(campaign=campaign)))
    nominal = again.rollout.run(None).costs["tip_error_peak"]
    assert nominal == pytest.approx(found.worst.value, rel=1e-9)


def test_results_are_kept_and_told_in_one_line(small, tmp_path):
    found = sr.failure_probability(small(campaign=CAMPAIGN), limit=1e3, effort=FEW)
    assert (found.probability, found.variation) == (0, np.inf)
    assert dict(found.rows())["method"] == "importance"
    found.save(tmp_path / "rare.json")
    assert sr.load(tmp_path / "rare.json") == found
    worst = sr.falsify(small(campaign=CAMPAIGN), effort=sr.Effort(starts=1))
    worst.save(tmp_path / "worst.json")
    assert sr.load(tmp_path / "worst.json") == worst
    (tmp_path / "other.json").write_text('{"colour": 1}')
    with pytest.raises(sr.SpaceRobotError, match="no result in this file"):
        sr.load(tmp_path / "other.json")


def test_an_interrupted_search_stops_and_continues_from_its_journal(small, tmp_path, monkeypatch):
    scene, journals = small(campaign=CAMPAIGN), tmp_path / "journals"
    whole = sr.falsify(scene, effort=sr.Effort(starts=2))
    asked = RolloutLimitState.quantities
    calls = []

    def interrupted(self, draws):
        calls.append(len(draws))
        if len(calls) == 3:
            raise KeyboardInterrupt
        return asked(self, draws)

    monkeypatch.setattr(RolloutLimitState, "quantities", interrupted)
    with pytest.raises(KeyboardInterrupt):
        sr.falsify(scene, effort=sr.Effort(starts=2), folder=journals)
    assert sr.falsify(scene, effort=sr.Effort(starts=2), folder=journals) == whole


def test_a_search_in_which_everything_diverges_says_so(small, monkeypatch):
    monkeypatch.setattr(RolloutLimitState, "quantities", lambda _, draws: np.full(len(draws), np.nan))
    with pytest.raises(DivergedError, match=r"all \d+ simulations diverged, so no worst case was found"):
        sr.falsify(small(campaign=CAMPAIGN), effort=sr.Effort(starts=1))


def test_numbers_do_not_depend_on_threads(small, limit):
    one, two = (
        sr.failure_probability(small(campaign=CAMPAIGN), limit=limit, effort=FEW, threads=n) for n in (1, 2)
    )
    assert one == two


DRIFT = {
    "name": "drift",
    "robots": {"one": {"urdf": "short_arm.urdf", "base": {"joint": "planar"}, "tips": {"tip": {}}}},
    "simulation": {"duration": 1, "step": 0.05},
    "campaign": {
        "parameters": {
            axis: {"paths": f"robots.one.base.velocity.{i}", "kind": "normal", "mean": 0, "std": 0.01}
            for i, axis in enumerate("xy")
        },
        "metrics": ["tip_error_peak"],
        "limits": {"tip_error": 0.04},
    },
}


def test_a_drifting_base_fails_in_four_directions(tmp_path):
    """The largest component of the tip's drift decides; at rest the quantity is stationary."""
    (tmp_path / "drift.yaml").write_text(json.dumps(DRIFT))
    scene = sr.load_scene(tmp_path / "drift.yaml")
    ratios, covered = [], 0
    for seed in range(40):
        found = sr.failure_probability(scene, effort=sr.SamplingEffort(seed=seed))
        assert len(found.failures) == 4
        assert found.warnings == ()
        ratios.append(found.probability / (1 - (1 - 2 * stats.norm.sf(4)) ** 2))
        covered += abs(np.log(ratios[-1])) <= 1.96 * found.variation
    assert covered >= 34  # of 40 at 95 %: fewer once in 1000 times
    assert np.median(ratios) == pytest.approx(1, abs=0.05)
    (row,) = (value for name, value in found.rows() if name == "most probable failures")
    assert row.startswith("4 from ")


@pytest.mark.parametrize(
    ("changes", "arguments", "message"),
    [
        ({"limits": {}}, {}, "limits of exactly one quantity are needed, found none"),
        ({}, {"quantity": "grip_force_peak"}, "no limit of grip_force_peak; give one with --limit"),
        ({}, {"quantity": "capture_time", "limit": 1.0}, "no grasp of this scene begins open"),
    ],
)
def test_what_is_missing_is_told(small, changes, arguments, message):
    with pytest.raises(ScenarioError, match=message):
        build_limit_state(small(campaign=CAMPAIGN | changes), **arguments)


def test_an_unknown_method_is_named(small):
    with pytest.raises(SpaceRobotError, match=r"no estimator 'lines'; .*line"):
        sr.failure_probability(small(campaign=CAMPAIGN), method="lines")


def test_the_commands_print_what_was_found(small_file, limit, tmp_path):
    scenario = [str(small_file), "--set", f"campaign={json.dumps(CAMPAIGN)}"]
    run = CliRunner().invoke(app, ["reliability", *scenario, "--limit", str(limit), "--budget", "1000"])
    assert run.exit_code == 0, run.output
    assert "P(tip_error_peak > " in run.output
    assert "most probable failure" in run.output
    few = ["--starts", "1", "--budget", "40", "--out", str(tmp_path / "worst")]
    run = CliRunner().invoke(app, ["falsify", *scenario, *few])
    assert run.exit_code == 0, run.output
    assert "by random search at equal cost" in run.output
    assert sr.load(tmp_path / "worst").summary["status"]["state"] == "completed"
