"""Estimates against functions and distributions whose answers are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from optim.campaign.analysis.statistics import percentile, rank_correlations, rank_noise, share, sobol_indices
from optim.campaign.sampling.samplers import draw
from spacerobot.scenario import Campaign


@pytest.mark.parametrize("percent", [5, 50, 95])
def test_percentiles_are_those_of_the_distribution_as_often_as_promised(percent):
    known, rng = stats.lognorm(0.7).ppf(percent / 100), np.random.default_rng(5)
    trials = [percentile(rng.lognormal(0, 0.7, 200), percent, 0.9) for _ in range(800)]
    held = np.mean([t.low <= known <= t.high for t in trials])
    assert 0.89 <= held <= 0.96  # at least the promise, and not much more
    assert np.mean([t.value for t in trials]) == pytest.approx(known, rel=0.03)


def test_the_interval_by_hand():
    # n = 10, median: P(2 <= B <= 8) = 0.979, P(3 <= B <= 7) = 0.891
    found = percentile(np.arange(10.0), 50, 0.95)
    assert (found.value, found.low, found.high) == (4.5, 1.0, 8.0)


def test_samples_that_do_not_bound_a_percentile_say_so():
    found = percentile(np.arange(20.0), 99, 0.95)
    assert found.high is None
    assert found.low == pytest.approx(18, abs=1)


def test_diverged_samples_count_as_worse_than_any():
    values = np.array([*range(8), np.inf, np.inf], dtype=float)
    assert percentile(values, 50, 0.9).value == 4.5
    assert percentile(values, 95, 0.9).value == np.inf
    assert np.isfinite(percentile(values, 75, 0.9).value)


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=60), st.floats(1, 99))
def test_a_percentile_is_numpys(values, percent):
    known = np.percentile(values, percent)
    assert percentile(np.array(values), percent, 0.9).value == pytest.approx(known, abs=1e-6)


def test_shares_are_those_of_clopper_and_pearson():
    found = share(4, 20, 0.95)  # the textbook's
    assert (found.value, found.low, found.high) == pytest.approx((0.2, 0.0573, 0.4366), abs=1e-4)
    none = share(0, 100, 0.95)
    assert (none.low, none.high) == pytest.approx((0, 1 - 0.025 ** (1 / 100)))


def test_a_share_is_held_as_often_as_promised():
    hits = np.random.default_rng(1).binomial(150, 0.03, 400)
    held = np.mean([(e := share(int(h), 150, 0.9)).low <= 0.03 <= e.high for h in hits])
    assert held >= 0.9


def test_rank_correlations_are_scipys_and_see_through_any_rising_function():
    rng = np.random.default_rng(0)
    draws = rng.random((300, 3))
    values = np.exp(5 * draws[:, 0]) - draws[:, 1] + 0.1 * rng.random(300)
    found = rank_correlations(draws, values)
    assert found == pytest.approx([stats.spearmanr(c, values).statistic for c in draws.T])
    assert rank_correlations(draws, draws[:, 2] ** 9) == pytest.approx(
        [found[2]] * 0
        + [
            stats.spearmanr(draws[:, 0], draws[:, 2]).statistic,
            stats.spearmanr(draws[:, 1], draws[:, 2]).statistic,
            1.0,
        ]
    )
    assert np.isnan(rank_correlations(draws, np.ones(300))).all()


def test_noise_is_what_unrelated_things_keep_below():
    rng = np.random.default_rng(2)
    rows = [rank_correlations(rng.random((60, 1)), rng.random(60))[0] for _ in range(600)]
    assert np.mean(np.abs(rows) < rank_noise(60, 0.9)) == pytest.approx(0.9, abs=0.03)


def test_sobol_indices_of_ishigami():
    pytest.importorskip("SALib")
    parameters = {name: {"paths": name, "lower": -np.pi, "upper": np.pi} for name in "abc"}
    campaign = Campaign.model_validate({"parameters": parameters, "design": "saltelli", "samples": 1024})
    x = draw(campaign).T
    found = sobol_indices(np.sin(x[0]) + 7 * np.sin(x[1]) ** 2 + 0.1 * x[2] ** 4 * np.sin(x[0]), "abc", 0.95)
    assert found.first == pytest.approx([0.3139, 0.4424, 0.0], abs=0.03)
    assert found.total == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.03)
    assert (found.first_width < 0.15).all()
    assert sobol_indices(np.ones(5 * 8), "abc", 0.95) is None


def test_sobol_indices_of_a_sum():
    pytest.importorskip("SALib")
    parameters = {
        "a": {"paths": "a", "kind": "normal", "mean": 1, "std": 3},
        "b": {"paths": "b", "kind": "normal", "mean": -5, "std": 4},
    }
    campaign = Campaign.model_validate({"parameters": parameters, "design": "saltelli", "samples": 1024})
    found = sobol_indices(draw(campaign).sum(axis=1), ["a", "b"], 0.95)
    assert found.first == pytest.approx([9 / 25, 16 / 25], abs=0.02)
    assert found.total == pytest.approx([9 / 25, 16 / 25], abs=0.02)
