"""Designs, distributions and correlation against known statistics."""

import sys

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from optim.campaign.sampling.samplers import draw
from spacerobot.common.errors import SpaceRobotError
from spacerobot.scenario import Campaign

KINDS = {
    "u": {"paths": "a", "lower": -2, "upper": 6},
    "n": {"paths": "b", "kind": "normal", "mean": 3, "std": 2},
    "l": {"paths": "c", "kind": "lognormal", "median": 4, "sigma": 0.5},
    "t": {"paths": "d", "kind": "truncated_normal", "mean": 1, "std": 1, "lower": 0, "upper": 4},
}
KNOWN = {
    "u": stats.uniform(-2, 8),
    "n": stats.norm(3, 2),
    "l": stats.lognorm(0.5, scale=4),
    "t": stats.truncnorm(-1, 3, loc=1, scale=1),
}
DESIGNS = ("monte_carlo", "latin_hypercube", "sobol")


def unit_points(found):
    return found.sampler.points(found)


def campaign(**options):
    return Campaign.model_validate({"parameters": KINDS, "samples": 512, "seed": 3} | options)


@pytest.mark.parametrize("design", DESIGNS)
def test_marginals_follow_their_distributions(design):
    for column, known in zip(draw(campaign(design=design)).T, KNOWN.values(), strict=True):
        assert stats.kstest(column, known.cdf).pvalue > 0.01


def test_stratified_designs_are_stratified():
    lhs = unit_points(campaign(design="latin_hypercube", samples=100))
    assert (np.sort(np.floor(100 * lhs), axis=0) == np.arange(100)[:, None]).all()
    sobol = unit_points(campaign(design="sobol"))
    assert (np.sort(np.floor(512 * sobol), axis=0) == np.arange(512)[:, None]).all()
    plain = unit_points(campaign(design="monte_carlo"))
    assert qmc.discrepancy(sobol) < 0.2 * qmc.discrepancy(plain)


@pytest.mark.parametrize("design", DESIGNS)
@pytest.mark.parametrize("samples", [1, 37, 512])
def test_the_seed_decides(design, samples):
    first = draw(campaign(design=design, samples=samples))
    assert first.shape == (samples, 4)
    assert np.array_equal(first, draw(campaign(design=design, samples=samples)))
    assert not np.array_equal(first, draw(campaign(design=design, samples=samples, seed=4)))


@pytest.mark.parametrize("design", ["monte_carlo", "sobol"])
def test_more_samples_begin_with_the_same_ones(design):
    few, many = (draw(campaign(design=design, samples=n)) for n in (64, 200))
    assert np.array_equal(many[:64], few)


@pytest.mark.parametrize("design", DESIGNS)
def test_correlation_of_the_normal_scores(design):
    rows = [[1, 0.8, -0.3, 0], [0.8, 1, 0, 0], [-0.3, 0, 1, 0.5], [0, 0, 0.5, 1]]
    found = draw(campaign(design=design, correlation=rows, samples=4096))
    ranks = stats.spearmanr(found).statistic
    assert ranks == pytest.approx(6 / np.pi * np.arcsin(np.array(rows) / 2), abs=0.04)  # Gaussian copula
    for column, known in zip(found.T, KNOWN.values(), strict=True):
        assert stats.kstest(column, known.cdf).pvalue > 0.01


def test_a_grid_is_every_combination_with_its_ends():
    found = draw(
        Campaign.model_validate(
            {
                "design": "grid",
                "levels": 3,
                "parameters": {"u": KINDS["u"], "n": KINDS["n"], "t": KINDS["t"] | {"levels": 2}},
            }
        )
    )
    assert found.shape == (18, 3)
    assert len(np.unique(found, axis=0)) == 18
    assert sorted(set(found[:, 0])) == [-2, 2, 6]
    assert sorted(set(found[:, 1])) == pytest.approx(stats.norm(3, 2).ppf([1 / 6, 0.5, 5 / 6]))
    assert sorted(set(found[:, 2])) == [0, 4]


def test_a_design_names_the_extra_that_it_needs(monkeypatch):
    monkeypatch.setitem(sys.modules, "SALib.sample.sobol", None)
    with pytest.raises(SpaceRobotError, match=r"design saltelli needs .* 'spacerobot\[sobol\]'"):
        unit_points(campaign(design="saltelli", samples=8))


def test_a_design_for_sobol_indices_has_its_blocks():
    pytest.importorskip("SALib")
    u = unit_points(campaign(design="saltelli", samples=8))
    assert u.shape == (8 * 6, 4)
    blocks = u.reshape(8, 6, 4)
    for i in range(4):  # A with column i from B
        assert np.array_equal(np.delete(blocks[:, 1 + i], i, 1), np.delete(blocks[:, 0], i, 1))
        assert np.array_equal(blocks[:, 1 + i, i], blocks[:, 5, i])
