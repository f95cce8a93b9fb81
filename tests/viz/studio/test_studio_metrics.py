"""What a search makes small is the metric that the page shows."""

import pytest

from optim.problem.objectives import OBJECTIVE, build_terms
from spacerobot.closedloop import build_closed_loop
from spacerobot.rollout import build_rollout
from spacerobot.scenario import Constraints
from tests.oracles.free_bodies import FLAT, free_bodies
from viz.studio.metrics import build_metrics


def test_a_search_makes_small_what_is_shown_a_miss_distance_too(tmp_path):
    capture = {"kind": "weld", "capture": {"distance": 0.001}}
    scene = free_bodies(tmp_path, FLAT, capture, simulation={"duration": 1.0, "step": 0.05})
    loop = build_closed_loop(scene)
    metrics, grid = build_metrics(loop, scene), {"duration_s": 1.0, "step_s": 0.05, "backend": "interpreted"}
    shown = build_rollout(loop, **grid, measures=metrics.measures).run().costs
    for key in ("miss_distance", "target_rotation_peak", "capture_time"):
        terms = build_terms(loop, scene, metrics.reduced(metrics[key]), Constraints())
        found = build_rollout(loop, **grid, measures=terms.measures).run().costs[OBJECTIVE]
        assert found == pytest.approx(shown[key], rel=1e-12)
    assert 0.001 < shown["miss_distance"] < 0.1
