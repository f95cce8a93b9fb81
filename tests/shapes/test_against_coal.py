"""Distances of pairs of shapes against coal's and the second engine's, apart and inside one another."""

from __future__ import annotations

import functools
import itertools

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from spacerobot import elements
from spacerobot.elements import create
from spacerobot.pinocchio_engine.crowned_distance import crowned_distance
from spacerobot.scene.contacts import coal_distance
from spacerobot.scene.scene import SceneShape
from spacerobot.shapes import Shape, proximity

SIZES = {
    "sphere": {"radius": 0.3},
    "capsule": {"radius": 0.2, "length": 0.7},
    "cylinder": {"radius": 0.4, "length": 0.5},
    "box": {"size": (0.6, 0.4, 1.0)},
    "plane": {},
}
CONFIGS = {kind: create("shape", kind, link="a/b", **sizes) for kind, sizes in SIZES.items()}
PRECISE = 2e-9
"""[m] coal's own precision where it iterates."""
SHALLOW = 0.05
"""[m] Indentation up to which the way out is the shortest, a quarter of the least of the sizes."""
PAIRS = [pair for pair in itertools.combinations_with_replacement(SIZES, 2) if pair != ("plane", "plane")]
EXACT = [pair for pair in PAIRS if "sphere" in pair]
CROWNED = [pair for pair in PAIRS if "sphere" not in pair]
NAMED = pytest.mark.parametrize("kinds", PAIRS, ids="-".join)


@functools.cache
def near(kinds):
    """(R, p) of both and the crown to gap, normal and point."""
    places = [ca.SX.sym("R1", 3, 3), ca.SX.sym("p1", 3), ca.SX.sym("R2", 3, 3), ca.SX.sym("p2", 3)]
    shapes = []
    for i, kind in enumerate(kinds):
        own = CONFIGS[kind]
        shapes.append(Shape(type(own), places[2 * i], places[2 * i + 1], own.measures()))
    crown = ca.SX.sym("crown")
    found = proximity(*shapes, crown)
    return ca.Function("near", [*places, crown], [found.gap, found.normal, found.point])


def ours(kinds, one, other, crown=1e-3):
    """Gap, normal and point of two placements."""
    gap, normal, point = near(kinds)(one.rotation, one.translation, other.rotation, other.translation, crown)
    return float(gap), normal.full().ravel(), point.full().ravel()


def scene_shapes(kinds):
    return tuple(SceneShape(kind, None, CONFIGS[kind], 0, 0, np.eye(4)) for kind in kinds)


def by_coal(kinds, one, other):
    found = coal_distance(*scene_shapes(kinds), (one, other))
    middle = (found.getNearestPoint1() + found.getNearestPoint2()) / 2
    return found.min_distance, np.array(found.normal), middle


def poses(seed, count, spread):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield [pin.SE3(pin.exp3(rng.normal(size=3)), spread * rng.uniform(-1, 1, 3)) for _ in range(2)]


def parallel(seed, count):
    """Shapes with parallel faces and axes, some tilted by next to nothing."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        one = pin.SE3(pin.exp3(rng.normal(size=3)), rng.uniform(-1, 1, 3))
        turn = pin.exp3((0.0, np.pi / 2, 1.0)[i % 3] * np.eye(3)[rng.integers(3)])
        tilt = pin.exp3((0.0, 1e-12, 1e-7, 1e-3)[i % 4] * rng.normal(size=3))
        yield one, one * pin.SE3(turn @ tilt, rng.uniform(-0.8, 0.8, 3))


def dome(kinds, crown):
    """Greatest height of the domes of both [m]."""
    heights = {"sphere": 0, "plane": 0, "capsule": 0.35, "cylinder": 0.4 + 0.25, "box": 0.3 + 0.2 + 0.5}
    return crown * sum(heights[kind] for kind in kinds)


def test_every_kind_is_here():
    assert {*SIZES, "hull"} == set(elements.kinds("shape"))  # which test_hull.py compares


@pytest.mark.parametrize("kinds", EXACT, ids="-".join)
def test_distance_normal_and_point_from_a_sphere_are_those_of_coal(kinds):
    inside = 0
    for one, other in poses(3, 200, 0.7):
        wanted, direction, middle = by_coal(kinds, one, other)
        if "cylinder" in kinds and wanted < -SIZES["sphere"]["radius"]:
            continue  # the centre inside a curved solid: coal's polytope ends at a way out that is longer
        gap, normal, point = ours(kinds, one, other)
        inside += wanted < 0
        assert abs(gap - wanted) < PRECISE
        assert normal @ direction > 1 - 1e-6
        assert np.abs(point - middle).max() < 1e-4
    assert 30 < inside < 200


@pytest.mark.parametrize("kinds", CROWNED, ids="-".join)
def test_crowned_shapes_are_as_far_apart_as_coal_says_but_for_their_domes(kinds):
    inside, odd = 0, 0
    for one, other in itertools.chain(poses(3, 300, 0.7), parallel(5, 60)):
        wanted, direction, _ = by_coal(kinds, one, other)
        if wanted < -SHALLOW:
            continue
        inside += wanted < 0
        gap = ours(kinds, one, other, 1e-4)[0]
        assert gap > wanted - dome(kinds, 1e-4) - PRECISE
        odd += gap > wanted + PRECISE  # now and then coal's polytope ends at a way out that is longer
        gap, normal, point = ours(kinds, one, other)
        again = crowned_distance(scene_shapes(kinds), (one, other), 1e-3, direction)
        assert abs(gap - again[0]) < 1e-11
        assert np.abs(normal - again[1]).max() < 1e-10
        assert np.abs(point - again[2]).max() < 1e-8
    assert inside > 5
    assert odd < 5


def _from_point(kind, place, point):
    """Signed distance of a point from a shape without domes [m]."""
    own = place.actInv(point)
    if kind == "plane":
        return own[2]
    if kind == "capsule":
        return np.linalg.norm(own - [0, 0, np.clip(own[2], -0.35, 0.35)]) - 0.2
    over = np.abs(own) - [0.3, 0.2, 0.5] if kind == "box" else [np.hypot(*own[:2]) - 0.4, abs(own[2]) - 0.25]
    return np.linalg.norm(np.maximum(over, 0)) + min(np.max(over), 0)


@pytest.mark.parametrize("kinds", CROWNED, ids="-".join)
def test_the_point_is_in_both_shapes_where_they_touch(kinds):
    crown = 1e-3
    for one, other in itertools.chain(poses(8, 100, 0.6), parallel(9, 100)):
        gap, _, point = ours(kinds, one, other, crown)
        if gap < -SHALLOW:
            continue
        for kind, place in zip(kinds, (one, other), strict=True):
            assert _from_point(kind, place, point) < max(gap, 0) / 2 + dome((kind,), crown) + 1e-12


@pytest.mark.parametrize("depth", [1e-6, 1e-3])
def test_flat_on_flat_acts_at_a_point_of_what_is_shared(depth):
    flat, crown = pin.SE3.Identity(), 1e-3
    # faces 0.6 x 0.4 m one on the other, shifted by 0.4 and 0.1 m: the middle, for they are alike
    gap, normal, point = ours(("box", "box"), flat, pin.SE3(np.eye(3), np.array([0.4, 0.1, 1.0 - depth])))
    assert -depth - dome(("box", "box"), crown) < gap < -depth
    assert normal @ [0, 0, 1] > 1 - 1e-5
    assert np.allclose(point, [0.2, 0.05, 0.5 - depth / 2], rtol=0, atol=1e-5)
    for kind, high in (("box", 0.5), ("cylinder", 0.25)):
        place = pin.SE3(np.eye(3), np.array([0.4, 0.1, high - depth]))
        gap, normal, point = ours(("plane", kind), flat, place)
        assert -depth - dome((kind,), crown) - 1e-6 < gap < -depth
        assert np.allclose(point, [0.4, 0.1, gap / 2], rtol=0, atol=1e-9)


def test_the_point_moves_smoothly_as_flat_on_flat_tilts():
    crown, tilts = 1e-3, np.linspace(-0.02, 0.02, 401)
    places = [
        ours(
            ("box", "box"),
            pin.SE3.Identity(),
            pin.SE3(pin.exp3(np.array([0, t, 0])), np.array([0.1, 0, 0.999])),
            crown,
        )[2]
        for t in tilts
    ]
    steps = np.abs(np.diff(np.array(places), axis=0)).max(axis=1)
    assert np.ptp(np.array(places)[:, 0]) > 0.3  # from one edge to the other
    # half the length over the crown, for each rad
    assert steps.max() < 0.3 / crown * np.diff(tilts)[0]


@NAMED
def test_the_gap_changes_with_the_velocity_of_the_shapes_points_along_the_normal(kinds):
    rng, step = np.random.default_rng(1), 1e-6
    for one, other in poses(4, 40, 0.7):
        twists = rng.normal(size=(2, 6))
        places = [
            [pin.SE3(pin.exp3(s * t[3:]) @ p.rotation, p.translation + s * t[:3]) for s in (-step, step)]
            for p, t in zip((one, other), twists, strict=True)
        ]
        ends = [ours(kinds, a, b)[0] for a, b in zip(*places, strict=True)]
        gap, n, p = ours(kinds, one, other)
        if gap < -SHALLOW:
            continue  # directions that are equally short may meet there
        speeds = [
            t[:3] + np.cross(t[3:], p - place.translation)
            for t, place in zip(twists, (one, other), strict=True)
        ]
        rate = (ends[1] - ends[0]) / (2 * step)
        assert rate == pytest.approx(n @ (speeds[1] - speeds[0]), abs=2e-5)


@pytest.mark.parametrize("kinds", CROWNED, ids="-".join)
def test_derivatives_are_those_of_differences(kinds):
    tangent, rng, step, crown = near(kinds).forward(1), np.random.default_rng(2), 1e-6, 0.03
    for one, other in poses(6, 8, 0.6):
        places = [one.rotation, one.translation, other.rotation, other.translation, crown]
        found = near(kinds)(*places)
        if float(found[0]) < -SHALLOW:
            continue
        turns = [pin.skew(rng.normal(size=3)) @ places[i] for i in (0, 2)]
        seeds = [turns[0], rng.normal(size=3), turns[1], rng.normal(size=3), 0.01]
        ends = [
            near(kinds)(*(np.asarray(x) + s * np.asarray(d) for x, d in zip(places, seeds, strict=True)))
            for s in (-step, step)
        ]
        for got, low, high in zip(tangent(*places, *found, *seeds), *ends, strict=True):
            wanted = (high - low).full() / (2 * step)
            assert np.abs(got.full() - wanted).max() < 1e-6 * max(1, np.abs(wanted).max())


@NAMED
def test_parallel_shapes_and_coincident_ones_have_finite_answers_and_derivatives(kinds):
    back, tangent = near(kinds).reverse(1), near(kinds).forward(1)
    for height in (0.0, 0.45, 0.9):
        places = (np.eye(3), np.zeros(3), np.eye(3), np.array([0.0, 0.0, height]), 1e-3)
        found = near(kinds)(*places)
        seeds = [np.ones(np.shape(place)) for place in places]
        slopes = [*back(*places, *found, 1, np.ones(3), np.ones(3)), *tangent(*places, *found, *seeds)]
        assert all(np.isfinite(np.array(value)).all() for value in (*found, *slopes))
