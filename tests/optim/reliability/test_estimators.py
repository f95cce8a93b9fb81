"""Estimators of failure probabilities against closed forms."""

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from optim.reliability.design_points import find_design_points
from optim.reliability.estimator import SamplingEffort
from optim.reliability.limit_state import CountedLimitState
from spacerobot.registry import ESTIMATORS

NAMES = tuple("abcde")
ALONG = np.array([0.6, -0.3, 0.2, 0.1, -0.7])
ALONG /= np.linalg.norm(ALONG)


class Plane:
    """Fails beyond a plane: P = Phi(-beta)."""

    names = NAMES

    def __init__(self, beta):
        self.beta = beta
        self.probability = stats.norm.sf(beta)

    def values(self, z):
        return self.beta - z @ ALONG

    def gradients(self, z):
        return self.values(z), np.tile(-ALONG, (len(z), 1))


class TwoPlanes(Plane):
    """Fails beyond either of two opposite planes."""

    def __init__(self, beta):
        super().__init__(beta)
        self.probability = stats.norm.sf(beta) + stats.norm.sf(beta + 0.3)

    def values(self, z):
        return np.minimum(self.beta - z @ ALONG, self.beta + 0.3 + z @ ALONG)

    def gradients(self, z):
        near = np.where(z @ ALONG > -0.15, -1.0, 1.0)
        return self.values(z), near[:, None] * ALONG


class Paraboloid(Plane):
    """Fails inside a paraboloid: P(z_1 > beta + 0.1 chi_4^2)."""

    def __init__(self, beta):
        super().__init__(beta)
        self.probability = quad(lambda c: stats.chi2.pdf(c, 4) * stats.norm.sf(beta + 0.1 * c), 0, 100)[0]

    def values(self, z):
        return self.beta - z[:, 0] + 0.1 * np.sum(z[:, 1:] ** 2, axis=1)

    def gradients(self, z):
        return self.values(z), np.column_stack([np.full(len(z), -1.0), 0.2 * z[:, 1:]])


def points_of(state):
    starts = np.vstack([np.zeros(5), np.random.default_rng(0).standard_normal((7, 5))])
    return find_design_points(state, starts)


@pytest.mark.parametrize("state", [Plane(4.75), Paraboloid(4.0)])
def test_the_most_probable_failure_is_found_once(state):
    (point,) = points_of(state)
    assert point.beta == pytest.approx(state.beta, abs=1e-4)
    assert point.direction == pytest.approx(ALONG if type(state) is Plane else np.eye(5)[0], abs=1e-3)


def test_both_failures_are_found_the_nearer_first():
    first, second = points_of(TwoPlanes(4.5))
    assert (first.beta, second.beta) == pytest.approx((4.5, 4.8), abs=1e-6)
    assert first.direction == pytest.approx(-second.direction)


@pytest.mark.parametrize("name", ["importance", "line", "subset"])
@pytest.mark.parametrize("state", [Plane(4.75), TwoPlanes(4.5), Paraboloid(4.0)])
def test_repeated_estimates_scatter_about_the_closed_form_as_they_say(name, state):
    estimator, points = ESTIMATORS.find(name), points_of(state)
    runs = [CountedLimitState(state) for _ in range(40)]
    found = [estimator.estimate(run, points, SamplingEffort(seed=i)) for i, run in enumerate(runs)]
    ratio = np.array([each.probability for each in found]) / state.probability
    told = np.mean([each.variation for each in found])
    if name == "line" and isinstance(state, TwoPlanes):
        # it sees the nearer region alone, as its page says
        assert ratio == pytest.approx(stats.norm.sf(4.5) / state.probability, rel=1e-6)
        return
    assert abs(ratio.mean() - 1) < 4 * max(ratio.std(), 1e-12) / np.sqrt(len(ratio)) + 1e-12
    assert told < (0.35 if name == "subset" else 0.1)
    # the standard deviation of 40 runs is known to 11 %; subset simulation's is an estimate by chains
    assert told == pytest.approx(ratio.std(), rel=0.4, abs=1e-12)
    assert max(run.rollouts for run in runs) <= 20_000


def test_a_failure_without_a_design_point_is_still_counted():
    state = Plane(1.0)
    found = ESTIMATORS.find("importance").estimate(state, [], SamplingEffort(variation=0.05))
    assert found.probability == pytest.approx(state.probability, rel=0.2)


@pytest.mark.parametrize("name", ["importance", "line", "subset"])
def test_no_failure_at_all_has_no_accuracy(name):
    found = ESTIMATORS.find(name).estimate(Plane(50.0), [], SamplingEffort(budget=3000))
    assert (found.probability, found.variation) == (0.0, np.inf)
