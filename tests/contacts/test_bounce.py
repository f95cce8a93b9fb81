"""The shipped scene with contact: run, drawn, and the same in the second engine."""

from __future__ import annotations

import numpy as np
import pytest

from spacerobot.pinocchio_engine import simulate as checked_by
from spacerobot.scene import load_scene
from tests.oracles.balls import meeting
from viz.drawing.motion import PAD, scene_nodes
from viz.figures import draw_all
from viz.page.signals import quantities


def test_a_ball_bounces_off_and_everything_shows_it(bounce):
    data, summary = bounce.data, bounce.summary
    assert data.contact_force.dims == ("time", "contact", "axis")
    assert data.contact_normal_force.dims == data.contact_gap.dims == ("time", "contact")
    assert data.contact_gap.min() < 0 < data.contact_gap[-1]
    assert 10 < summary["greatest_contact"]["force_n"] < 30
    assert summary["greatest_contact"]["contact"] == "bump"
    touched, parted = summary["events"]
    assert (touched["kind"], parted["kind"]) == ("touched", "parted")
    change = data.body_momentum_linear.sel(body="target")[[0, -1]].values  # nothing else acts on the ball
    np.testing.assert_allclose(parted["impulses_n_s"]["bump"], change[1] - change[0], atol=1e-9)
    assert parted["energy_lost_j"] == pytest.approx(float(data.work_contact[-1]), rel=1e-9)
    assert touched["relative_velocity_m_s"][0] == pytest.approx(-0.25, abs=1e-6)
    assert summary["ledger"]["energy"]["relative_residual"] < 1e-6
    assert max(summary["ledger"]["momentum"][k]["relative_drift"] for k in ("linear", "angular")) < 1e-12
    assert data.work_contact[-1] > 0
    assert data.body_momentum_linear.sel(body="target", axis="x")[-1] > 0  # it came from there
    assert "contact_forces" in [name for name, _, _ in draw_all(bounce)]
    shown = {quantity.title: [s.name for s in quantity.signals] for quantity in quantities(bounce)}
    assert shown["contact force along the normal"] == ["bump"]
    assert "taken: contact" in shown["work since the start"]


def is_pad(solid):
    return np.array_equal(solid.rgba[:3], PAD[:3])


def test_pads_are_drawn_where_they_are():
    scene = load_scene(
        "bounce", {"pads.fist": {"link": "arm/tip", "kind": "capsule", "radius": 0.05, "length": 0.2}}
    )
    (node,) = [n for n in scene_nodes(scene) if any(is_pad(s) for s in n.solids)]
    drawn = [solid for solid in node.solids if is_pad(solid)]
    assert [solid.geometry.kind for solid in drawn] == ["cylinder", "sphere", "sphere"]
    heights = sorted(solid.placement[2, 3] for solid in drawn)
    np.testing.assert_allclose(heights, [-0.1, 0, 0.1])


def test_the_second_engine_sees_the_same(bounce):
    scene = load_scene("bounce", {"simulation.duration": 2.3})
    found = checked_by(scene, output_step_s=0.1, rtol=1e-9, atol=1e-10)
    ours = bounce.data.q.values[: 10 * len(found.state) : 10]
    assert np.abs(ours - found.state[:, : scene.model.nq]).max() < 1e-6


def test_a_plane_is_seen_as_a_plate_below_it_that_is_wide_enough_with_its_normal():
    at = {"floor": {"link": "one/body", "kind": "plane", "position": [0, 0.3, 0], "rotation_deg": [90, 0, 0]}}
    found = meeting({"stiffness": 1e4, "between": ["floor", "target/body"]}, pads=at)
    (node,) = (node for node in scene_nodes(found) if any(is_pad(s) for s in node.solids))
    plate, *normal = (s for s in node.solids if is_pad(s))
    assert plate.rgba[3] < 1
    up, surface = np.array([0, -1, 0]), np.array([0, 0.3, 0])
    half = plate.geometry.size / 2
    np.testing.assert_allclose(plate.placement[:3, 3] + half[2] * up, surface, atol=1e-12)
    np.testing.assert_allclose(plate.placement[:3, 2], up, atol=1e-12)
    assert min(half[:2]) > 0.205 + 0.1  # as far as the ball reaches
    heights = [(solid.placement[:3, 3] - surface) @ up for solid in normal]
    assert min(heights) > 0.05
