"""Bodies that begin inside one another are warned of."""

import pytest

from spacerobot.scene import load_scene
from spacerobot.scene.overlaps import overlaps


@pytest.mark.parametrize("name", ["paper", "servicer"])
def test_the_shipped_scenes_overlap_nowhere(name):
    assert overlaps(load_scene(name)) == []


def test_robots_in_one_place_are_named_with_their_links():
    changes = {
        "target": None,
        "grasps": {},
        "robots.rpr2.base": {"joint": "planar", "position": [0.3, 0, 0]},
    }
    (warning,) = overlaps(load_scene("paper", changes))
    assert warning.startswith("rpr1 and rpr2 overlap at the start: base and base")
    inside = {"robots.rpr2.base": {"joint": "planar", "position": [0.0, 0, 0]}}
    (warning,) = overlaps(load_scene("paper", {**changes, **inside}))
    assert "base and base, base and link_1, link_1 and base, link_1 and link_1;" in warning
    apart = load_scene("paper", {**changes, "robots.rpr2.base.position.0": 30.0})
    assert overlaps(apart) == []


def test_what_is_gripped_at_its_tip_is_left_out_but_not_what_reaches_elsewhere():
    scene = load_scene("paper", {"target.links.body.mass": 21.0})
    assert overlaps(scene) == []
    # the object turned round lies over the arm that holds it
    turned = load_scene(
        "paper", {"target.base.rotation_deg.2": 180.0, "robots.rpr2.base.rotation_deg.2": 0.0}
    )
    assert any("target" in warning and "rpr1" in warning for warning in overlaps(turned))
