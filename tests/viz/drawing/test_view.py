"""Scenes are looked at from where arms are seen, and from the same side everywhere."""

import dataclasses

import numpy as np

from spacerobot.description import Geometry
from spacerobot.scene import load_scene
from viz.drawing.motion import GREY, BodyMotion, DrawnSolid, Node
from viz.drawing.placements import JointPlacements
from viz.drawing.view import TOP, _clearest, _frame, first_view, grasp_view, oblique, view_of
from viz.figures import docking
from viz.page.animation import animation, still
from viz.recording.record import frames


def box(body, size, *, is_base=False):
    return Node(1, body, body, is_base, (DrawnSolid(np.eye(4), Geometry("box", np.full(3, size)), GREY),))


def motion(*places):
    """An arm's link at the origin, and boxes of an object at places."""
    nodes = (box("arm", 0.1), *(box("target", 1.0, is_base=True) for _ in places))
    position = np.array([[[0.0, 0.0, 0.0], *places]])
    quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (1, len(nodes), 1))
    nothing = JointPlacements(np.zeros((1, 0, 3, 3)), np.zeros((1, 0, 3)))
    rows, none = np.zeros(1, dtype=np.int64), np.zeros((1, 0, 3))
    return BodyMotion(nodes, rows, np.zeros(1), position, quaternion, none, nothing)


def test_an_arm_behind_the_object_is_seen_from_another_side():
    usual = oblique().towards
    assert (_clearest(motion(-usual)).towards == usual).all()
    beside = oblique(-30).towards
    chosen = _clearest(motion(usual)).towards
    assert not np.allclose(chosen, usual)
    assert (_clearest(motion(usual, beside)).towards != chosen).any()


def test_a_mate_on_the_far_face_is_behind_the_object():
    shown = motion([0.0, 0.6, 0.0])  # the link touches a face that looks along -y, towards the usual eye
    mates = np.array([[[0.0, 1.1, 0.0]]])  # the other face
    moved = BodyMotion(
        shown.nodes, shown.rows, shown.time, shown.position, shown.quaternion, mates, shown.joints
    )
    assert (_clearest(shown).towards == oblique().towards).all()
    assert _clearest(moved).towards[1] > -0.6


def test_a_grasp_is_seen_from_where_nothing_hides_it():
    behind = motion(oblique().towards)  # a box between the usual eye and the origin
    mates = np.zeros((1, 1, 3))
    moved = BodyMotion(
        behind.nodes, behind.rows, behind.time, behind.position, behind.quaternion, mates, behind.joints
    )
    frame = _frame(moved, 0)._replace(links=np.zeros((0, 3)))
    assert frame.seen(oblique().towards) == 0
    assert frame.seen(grasp_view(moved, [0], oblique()).towards) == 1
    np.testing.assert_allclose(grasp_view(moved, [0], oblique(120)).towards, oblique(120).towards)


def test_a_grasp_is_not_seen_at_a_grazing_angle():
    """The direction nearest to the usual one from which a grasp at an edge is just visible is not taken."""
    shown = motion([0.0, 0.6, 0.0])
    face = np.array([[[0.55, 0.6, 0.0]]])  # before the face that looks along +x
    moved = dataclasses.replace(shown, mates=face)
    frame = _frame(moved, 0)._replace(links=np.zeros((0, 3)))
    usual = oblique(-120)
    grazing = next(turn for turn in range(0, 180, 5) if frame.seen(oblique(-120 + turn).towards) == 1)
    chosen = grasp_view(moved, [0], usual).towards
    azimuth = np.degrees(np.arctan2(chosen[1], chosen[0])) + 120
    assert azimuth >= grazing + 15
    assert frame.seen(chosen) == 1


def test_pictures_and_pages_look_from_the_same_side(spatial):
    scene = spatial.scene()
    view = view_of(spatial, scene)
    np.testing.assert_allclose(animation(spatial)["towards"], view.towards, atol=1e-6)
    assert (frames(spatial, rate_hz=10).view.towards == view.towards).all()
    assert docking(spatial)
    np.testing.assert_allclose(still(scene)["towards"], first_view(scene).towards, atol=1e-6)


def test_planar_scenes_are_seen_from_above():
    assert first_view(load_scene("paper")) is TOP
