"""What a search makes small is the metric that the page shows; what is drawn has the shapes of the design."""

import pytest

from optim.problem.objectives import OBJECTIVE, build_terms
from spacerobot.closedloop import build_closed_loop
from spacerobot.rollout import build_rollout
from spacerobot.scenario import Constraints
from tests.oracles.free_bodies import FLAT, free_bodies
from viz.studio.metrics import build_metrics
from viz.studio.prepared_design import PreparedDesign


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


def test_a_changed_pad_has_another_shape_in_the_picture(tmp_path):
    pads = {
        "fist": {"link": "one/body", "kind": "sphere", "radius": 0.07},
        "wall": {"link": "target/body", "kind": "plane"},
    }
    bump = {"between": ["fist", "wall"], "stiffness": 1e4, "may_overlap": True}
    scene = free_bodies(
        tmp_path, FLAT, {"kind": "weld", "capture": {"distance": 1e-3}}, pads=pads, contacts={"bump": bump}
    )
    plant = PreparedDesign(scene, None, None, frozenset())

    def greatest_radius(numbers):  # the plane's normal ends in a small ball of its own
        nodes = plant.stage(plant.drawn(numbers)).nodes
        return max(
            float(solid.geometry.size[0])
            for node in nodes
            for solid in node.solids
            if solid.geometry.kind == "sphere"
        )

    assert greatest_radius({}) == 0.07
    assert greatest_radius({"pads.fist.radius": 0.11}) == 0.11
    assert plant.stage(plant.drawn({})) is plant.stage(scene)
