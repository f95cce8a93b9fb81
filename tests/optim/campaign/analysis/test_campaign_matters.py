"""What matters, in numbers, in sentences and in figures, where the answer is known."""

from dataclasses import dataclass

import numpy as np
import pytest
from matplotlib.colors import same_color

from optim.campaign.analysis.sensitivity import correlated, noise_of, what_matters
from optim.campaign.analysis.sentences import depends, failing, failure_criteria, mixed, unfinished
from optim.campaign.analysis.statistics import percentile
from optim.campaign.sampling.samplers import draw
from spacerobot.scenario import Campaign
from viz.figures import SampleSpread, bands, distributions, moving_components, robustness
from viz.figures.campaign import BAD

UNIFORM = {"lower": -1, "upper": 3}
PLAIN = {"parameters": {name: {"paths": name, **UNIFORM} for name in "abcd"}, "samples": 256}


def campaign(**changes):
    return Campaign.model_validate(PLAIN | changes)


def matters(values, **changes):
    section = campaign(**changes)
    draws = draw(section)
    return what_matters(draws, values(draws.T), section, complete=True)


def strongest(entry):
    return [(row["parameter"], row["how"]) for row in entry["strongest"]]


def test_how_a_parameter_acts_is_told():
    entry = matters(lambda x: x[0] + 2 * (x[1] - 1) ** 2 - 0.5 * x[2])
    assert strongest(entry) == [("b", "away"), ("a", "rises"), ("c", "falls")]
    assert strongest(matters(lambda x: -np.abs(x[3] - 1))) == [("d", "middle")]
    assert entry["value"]["b"] == pytest.approx(0, abs=0.05)  # a rank correlation alone would not see it
    assert depends("tip_error_peak", matters(lambda x: np.exp(x[1]))) == (
        "The peak tip error (one axis) grows with b (+1.00)."
    )
    both = depends("joint_torque_peak", matters(lambda x: x[0] + 0.9 * x[1]))
    assert both.startswith("The peak joint torque grows with a (+0.")
    assert " and b (+0." in both


def test_nothing_is_made_of_chance():
    """Of 200 metrics that depend on nothing, about one in twenty may be taken for one that does."""
    section, rng = campaign(samples=64), np.random.default_rng(4)
    draws = draw(section)
    taken = [
        bool(what_matters(draws, rng.random(64), section, complete=True)["strongest"]) for _ in range(200)
    ]
    assert np.mean(taken) < 0.12
    assert noise_of(64, section) > 0.2
    nothing = {"strongest": [], "kind": "rank_correlation"}
    assert depends("tip_error_rms", nothing) == "The RMS tip error depends on none of them clearly."


def test_what_does_not_vary_or_always_diverges():
    assert matters(lambda x: np.ones_like(x[0]))["note"] == "it does not vary"
    assert matters(lambda x: np.full_like(x[0], np.inf))["note"] == "no rollout has a value"
    some = matters(lambda x: np.where(x[0] > 2, np.inf, 1.0))
    assert strongest(some) == [("a", "rises")]
    assert "note" not in some


def test_sobol_indices_that_cannot_be_had_say_why():
    pytest.importorskip("SALib")
    saltelli = {"design": "saltelli", "samples": 64}
    entry = matters(lambda x: x[0] + 0.1 * x[1], **saltelli)
    assert strongest(entry)[0] == ("a", "share")
    assert "% of the variance" in depends("tip_error_peak", entry)
    lost = matters(lambda x: np.where(x[0] > 2.9, np.inf, x[0]), **saltelli)
    assert (lost["kind"], strongest(lost)[0]) == ("rank_correlation", ("a", "rises"))
    assert "rollouts have no value: Sobol' indices need them all" in depends("tip_error_peak", lost)


def test_parameters_drawn_together_are_told():
    rows = [[1, 0.8, 0, 0], [0.8, 1, 0, -0.1], [0, 0, 1, 0], [0, -0.1, 0, 1]]
    pairs = correlated(campaign(correlation=rows))
    assert pairs == [{"first": "a", "second": "b", "value": 0.8}]
    assert "a and b (+0.8)" in mixed({"correlated": pairs})
    assert mixed({"correlated": correlated(campaign())}) is None


def test_sentences_about_failures():
    told = {"failure": {"any": {"count": 3, "low": 0.01, "high": 0.2}, "diverged": {"count": 1}}}
    told["failure"]["grip_force"] = {"count": 2}
    summary = {"samples": 30, "of": 30, "confidence": 0.95}
    text = failing("scenario", told, summary)
    assert text.startswith("With the scenario's own gains, 3 of 30 samples fail: the probability")
    assert text.endswith("is between 1 and 20 %, with 95 % confidence. Of them: 1 diverged, 2 by grip force.")
    assert unfinished(summary) is None
    assert "30 of 40 samples" in unfinished(summary | {"of": 40})


def test_limits_have_units():
    summary = {"limits": {"tip_error": 0.005, "base_rotation_deg": 2}, "gains": {"": {"failure": {}}}}
    text = failure_criteria(summary)
    assert "peak tip error (one axis) 5 mm, peak base rotation 2 deg" in text


def test_a_percentile_that_falls_on_a_sample_is_that_sample():
    """0.07 times 100 is a little more than 7, and the next sample diverged."""
    values = np.array([*range(8), *[np.inf] * 93], dtype=float)
    assert percentile(values, 7, 0.9).value == 7


def texts(axes):
    return [text.get_text() for text in axes.texts]


def test_distributions_show_limits_and_what_diverged():
    values = np.linspace(1, 2, 101)
    lost = np.where(np.arange(101) < 20, np.nan, values)
    figure = distributions(
        [
            SampleSpread({"a": values, "b": values}, "near", "mm", 1.9),
            SampleSpread({"a": values, "b": lost}, "far", "N", 90.0),
            SampleSpread({"a": lost * np.nan, "b": lost * np.nan}, "gone", "N", 3.0),
            SampleSpread({"a": values, "b": 1000 * values}, "wide", "N"),
            SampleSpread({"a": values, "b": np.r_[1e-9, values]}, "none in one sample", "N"),
        ]
    )
    near, far, gone, wide, none, _ = figure.axes
    assert any(same_color(line.get_color(), BAD) for line in near.get_lines())
    assert "limit 90 N, far to the right →" in texts(far)
    assert far.get_xlim()[1] < 3
    assert "20 diverged" in texts(far)
    assert texts(gone) == ["all of 202 diverged"]
    assert [axes.get_xscale() for axes in (near, wide, none)] == ["linear", "log", "linear"]


def test_marks_are_the_percentiles_of_all_runs():
    figure = robustness(
        {"one": [1.0, 2.0, 3.0, 4.0, 5.0], "lost": [1.0, 2.0, np.nan, np.nan, np.nan]},
        quantity="error",
        unit="mm",
    )
    labels = [text.get_text() for text in figure.legends[0].texts]
    assert labels == ["one: 5 runs, 50 % below 3 mm, 95 % below 4.8 mm", "lost: 5 runs, 3 diverged"]
    tight = robustness({"x": 2 + 1e-7 * np.arange(5)}, quantity="error", unit="mm")
    assert "50 % below 2.0000002 mm, 95 % below 2.0000004 mm" in tight.legends[0].texts[0].get_text()


@dataclass
class Bands:
    least: np.ndarray
    greatest: np.ndarray
    name = "tip_error"
    unit = "m"
    components = ("x", "y")
    time = np.linspace(0, 1, 11)
    sample = 7

    @property
    def left(self):
        return np.full(11, 3)

    @property
    def median(self):
        return np.stack([np.sin(self.time), np.zeros(11)], axis=1)

    low = property(lambda self: self.median - np.array([0.01, 0]))
    high = property(lambda self: self.median + np.array([0.01, 0]))
    sample_values = median


def test_bands_show_what_moves_and_cut_what_runs_away():
    median = Bands(None, None).median
    calm = Bands(median - np.array([0.02, 0]), median + np.array([0.02, 0]))
    assert moving_components(calm) == [0]
    figure = bands(calm)
    assert [axes.get_title("left") for axes in figure.axes] == ["x"]
    assert texts(figure.axes[0]) == []
    wild = Bands(median - np.array([0.02, 0]), median + np.array([50.0, 0]))
    panel = bands(wild).axes[0]
    assert texts(panel) == ["cut; reaches 5.08e+04"]
    assert panel.get_ylim()[1] < 10_000
