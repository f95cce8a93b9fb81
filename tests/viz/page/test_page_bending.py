"""Flexible links on the page: bent as simulated, and enlarged by a factor."""

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.simulation import simulate
from tests.elements.test_flexible_links import LENGTH, PANEL, PLANE, scene_of
from tests.viz.page.test_animated_page import READY
from viz.page.animation import animation, look_at
from viz.page.page import animation_page

BENT = {"joints": {"own_1a": {"angle_deg": 0.5}, "own_2a": {"angle_deg": 0.3}}}


@pytest.fixture(scope="module")
def swinging():
    scene = scene_of(PLANE | {"segments": 2}, "planar", changes={"simulation.duration": 0.4}, **BENT)
    return simulate(scene, backend="interpreted")


def test_deflections_are_enlarged_by_the_model_itself(swinging):
    """Poses of a factor are those of the model with the hinges' angles multiplied; the rest stays."""
    shown = look_at(swinging, "swinging")
    scene, data = shown.scene, shown.scene.model.createData()
    passive = [scene.model.idx_qs[joint] for joint in scene.bodies[0].passive]
    for factor, motion in {1: shown.motion, **shown.bent}.items():
        q = swinging.array("q")[motion.rows[-1]].copy()
        q[passive] *= factor
        pin.forwardKinematics(scene.model, data, q)
        joints = [node.joint for node in motion.nodes]
        exact = [data.oMi[joint].translation for joint in joints]
        np.testing.assert_allclose(motion.position[-1], exact, atol=1e-12)
    first, last = (motion.position[0, -1] for motion in (shown.motion, shown.bent[10]))
    assert np.linalg.norm(last - first) > 0.1 * LENGTH / 4


def test_rigid_pages_carry_nothing_more(swinging):
    rigid = simulate(scene_of(None, "planar", changes={"simulation.duration": 0.1}), backend="interpreted")
    assert "bent" not in animation(rigid)["runs"][0]
    assert list(animation(swinging)["runs"][0]["bent"]) == ["10", "100"]


def test_the_page_enlarges_deflections(browser, swinging, tmp_path):
    path = tmp_path / "page.html"
    path.write_text(animation_page(swinging), encoding="utf-8")
    browser.open(f"{path.as_uri()}#t=0", 900, 600)
    browser.wait_for(READY)
    assert browser.evaluate("document.getElementById('bending').hidden") is False

    def enlarge(factor):
        change = f"s.value = '{factor}'; s.dispatchEvent(new Event('change'))"
        browser.evaluate(f"(s => {{ {change}; }})(document.getElementById('enlarged'))")
        return browser.picture()

    before = enlarge(1)  # the camera fits the view to all that is drawn at each change
    after = enlarge(10)
    assert (np.abs(after - before).sum(axis=2) > 60).sum() > 300
    browser.evaluate("location.hash = '#bending=1&t=0'")
    browser.wait_for("document.getElementById('enlarged').value === '1'")
    again = browser.picture()
    assert (np.abs(again - before).sum(axis=2) > 60).sum() < 100
    assert browser.errors == []


def test_shapes_of_a_link_that_carries_others_move_with_the_mode_if_they_are_named():
    flexible = PANEL | {"participation": [[1.0, 0, 0, 0, 0, 0]], "shapes": [0]}
    links = {link.name: link for link in scene_of(flexible).bodies[0].description.links}
    assert [len(links[name].visuals) for name in ("beam", "own_mode_1")] == [0, 1]
