"""The paper's printed formulas: mating points (Eq. 14-25) and the circle (Eq. 39-44)."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.description.planar import rectangle_urdf
from spacerobot.scenario.document import parse_yaml
from spacerobot.scenario.load import validate
from spacerobot.scene import build_scene, load_scene
from tests.oracles.small_scenes import PLANAR, small_scene
from tests.oracles.two_engines import ENGINES, Symbolic, part, places


@pytest.mark.parametrize("alpha_deg", [0.0, 17.0, 30.0, 45.0, 80.0])
@pytest.mark.parametrize("engine", ENGINES)
def test_mating_points_move_as_printed(alpha_deg, engine, tmp_path):
    half = 0.2
    urdf = rectangle_urdf(half_diagonal_m=half, alpha_deg=alpha_deg)
    (tmp_path / "box.urdf").write_text(urdf, encoding="utf-8")
    text = "robots: {box: {urdf: box.urdf, base: {joint: planar}, tips: {mate_1: {}, mate_2: {}}}}"
    scene = build_scene(validate(parse_yaml(text)), source=tmp_path / "scenario.yaml")
    loop = ENGINES[engine](scene)
    reach = half * np.cos(np.radians(alpha_deg))
    first = loop.outputs(0.0, loop.x0)["tip_position"]
    np.testing.assert_allclose(first, [-reach, 0, 0, reach, 0, 0], atol=1e-15)  # Eq. 14, 15
    for gamma, rate in ((0.3, 0.7), (-1.2, 2.0), (2.9, -0.4)):
        x = loop.x0.copy()
        x[places(loop, "q.box/root")] = 0, 0, np.cos(gamma), np.sin(gamma)
        x[places(loop, "v.box/root")] = 0, 0, rate
        seen = loop.outputs(0.0, x)
        c, s = np.cos(gamma), np.sin(gamma)
        position = [-reach * c, -reach * s, 0, reach * c, reach * s, 0]  # Eq. 16, 17
        moved = [reach * (1 - c), -reach * s, 0, reach * (c - 1), reach * s, 0]  # Eq. 18-21
        velocity = np.array([reach * s, -reach * c, 0, -reach * s, reach * c, 0]) * rate  # Eq. 22-25
        np.testing.assert_allclose(seen["tip_position"], position, atol=1e-15)
        np.testing.assert_allclose(seen["tip_position"] - first, moved, atol=1e-15)
        np.testing.assert_allclose(seen["tip_velocity"], velocity, atol=1e-15)


def circle_43_44(t, start_deg, end_deg, final_s, radius):
    """Eq. 42-44, the sign of Eq. 44 corrected: angle, and velocity along x and y."""
    first, last = np.radians(start_deg), np.radians(end_deg)
    t = min(t, final_s)
    delta = first + 3 * (last - first) * (t / final_s) ** 2 - 2 * (last - first) * (t / final_s) ** 3
    rate = 6 * (last - first) * t / final_s**2 - 6 * (last - first) * t**2 / final_s**3
    return delta, -radius * rate * np.sin(delta), radius * rate * np.cos(delta)


@pytest.mark.parametrize("engine", ENGINES)
def test_paper_circle_is_the_printed_one(engine):
    loop = ENGINES[engine](load_scene("paper"))
    first = loop.outputs(0.0, loop.x0)["tip_position"].reshape(2, 3)
    x = loop.x0
    assert not part(loop, x, "rpr1/tip/amnesia").any()
    for t in (0.0, 0.1, 2.5, 5.0, 7.77, 9.999, 10.0, 12.0):
        delta, vx, vy = circle_43_44(t, 0.0, 360.0, 10.0, 0.1)
        reference = loop.outputs(t, x)["tip_reference"].reshape(2, 3)
        for tip in range(2):
            centre = first[tip] - [0.1, 0, 0]
            expected = centre + np.array([0.1 * np.cos(delta), 0.1 * np.sin(delta), 0])  # Eq. 40, 41
            np.testing.assert_allclose(reference[tip], expected, atol=1e-14)
            assert np.linalg.norm(reference[tip] - centre) == pytest.approx(0.1, rel=1e-13)  # Eq. 39
            # at rest and without memory, what the PID integrates is the reference velocity itself
            error = part(loop, loop.rate(t, x), f"rpr{tip + 1}/tip/pid.integral")
            np.testing.assert_allclose(error, [vx, vy], atol=1e-14)


def test_circle_of_any_arc_begins_at_the_tip_and_turns_counter_clockwise():
    arc = {"kind": "circle", "radius": 0.07, "start_deg": -40, "end_deg": 100, "duration": 3}
    scene = small_scene(PLANAR, {"robots.one.tips.tip.reference": arc, "robots.one.base.velocity": [0, 0, 0]})
    loop = Symbolic(scene)
    first = loop.outputs(0.0, loop.x0)["tip_position"][:2]
    x = loop.x0.copy()
    x[loop.loop.nq : loop.loop.nq + loop.loop.nv] = 0
    begin = 0.07 * np.array([np.cos(np.radians(-40)), np.sin(np.radians(-40))])
    for t in (0.0, 0.4, 1.5, 2.9, 4.0):
        delta, vx, vy = circle_43_44(t, -40.0, 100.0, 3.0, 0.07)
        expected = first - begin + 0.07 * np.array([np.cos(delta), np.sin(delta)])
        np.testing.assert_allclose(loop.outputs(t, x)["tip_reference"][:2], expected, atol=1e-14)
        error = part(loop, loop.rate(t, x), "one/tip/pid.integral")
        np.testing.assert_allclose(error, [vx, vy], atol=1e-14)


def test_tilted_circle_lies_in_its_plane():
    arc = {"kind": "circle", "radius": 0.1, "plane_deg": [90, 0, 0], "duration": 2}
    text = "robots: {a: {urdf: odd_arm.urdf, tips: {tip: {reference: {kind: hold}}}}}"
    loop = Symbolic(small_scene(text, {"robots.a.tips.tip.reference": arc}))
    first = loop.outputs(0.0, loop.x0)["tip_position"]
    # rolled by a quarter turn, the circle's x axis stays x and its y axis becomes the world's z
    quarter = loop.outputs(0.653, loop.x0)["tip_reference"] - (first - [0.1, 0, 0])
    angle = 2 * np.pi * (3 * 0.3265**2 - 2 * 0.3265**3)
    np.testing.assert_allclose(quarter, [0.1 * np.cos(angle), 0, 0.1 * np.sin(angle)], atol=1e-14)


def test_reference_derived_from_the_target_carries_the_tips_rigidly():
    turn = {"kind": "line", "displacement": [0.2, 0.1, 0], "rotation_deg": [0, 0, 90], "duration": 2}
    scene = small_scene(PLANAR, {"robots.*.tips.tip.reference": None, "target.reference": turn})
    loop = Symbolic(scene)
    seen = loop.outputs(5.0, loop.x0)
    first = seen["tip_position"].reshape(2, 3)
    target = seen["body_position"][-3:]
    for found, tip in zip(seen["tip_reference"].reshape(2, 3), first, strict=True):
        expected = target + [0.2, 0.1, 0] + pin.rpy.rpyToMatrix(0, 0, np.pi / 2) @ (tip - target)
        np.testing.assert_allclose(found, expected, atol=1e-14)
    np.testing.assert_allclose(seen["tip_orientation_error"][[2, 5]], np.pi / 2, atol=1e-12)
