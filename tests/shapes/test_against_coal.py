"""Distances of pairs of shapes against coal's, apart and inside one another."""

from __future__ import annotations

import casadi as ca
import coal
import numpy as np
import pinocchio as pin
import pytest

from spacerobot.shapes import PAIRS, Shape, proximity

SIZES = {
    "sphere": ([0.3], [], coal.Sphere(0.3)),
    "capsule": ([0.2], [0.35], coal.Capsule(0.2, 0.7)),
    "cylinder": ([0.4], [0.25], coal.Cylinder(0.4, 0.5)),
    "box": ([], [0.3, 0.2, 0.5], coal.Box(0.6, 0.4, 1.0)),
    "plane": ([], [], coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)),
}
PRECISE = 2e-9
"""[m] coal's own precision where it iterates."""


def numbers_of(kind):
    radius, half, _ = SIZES[kind]
    return ca.DM(radius or [0.0]), ca.DM(half) if half else ca.DM(0, 1)


def compiled(kinds):
    """(R, p) of both to gap, normal and point."""
    places = [ca.SX.sym("R1", 3, 3), ca.SX.sym("p1", 3), ca.SX.sym("R2", 3, 3), ca.SX.sym("p2", 3)]
    shapes = [
        Shape(places[2 * i], places[2 * i + 1], *(ca.SX(n) for n in numbers_of(kind)))
        for i, kind in enumerate(kinds)
    ]
    found = proximity(kinds, *shapes)
    return ca.Function("near", places, [found.gap, found.normal, found.point])


def by_coal(kinds, one, other):
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = request.epa_tolerance = 1e-13
    request.gjk_max_iterations = request.epa_max_iterations = 1000
    geometries = [SIZES[kind][2] for kind in kinds]
    placements = [coal.Transform3s(place.rotation, place.translation) for place in (one, other)]
    gap = coal.distance(geometries[0], placements[0], geometries[1], placements[1], request, result)
    return gap, result.normal, (result.getNearestPoint1() + result.getNearestPoint2()) / 2


def poses(seed, count, spread):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield [pin.SE3(pin.exp3(rng.normal(size=3)), spread * rng.uniform(-1, 1, 3)) for _ in range(2)]


EVERY = [*PAIRS, *((b, a) for a, b in PAIRS if a != b)]


@pytest.mark.parametrize("kinds", EVERY, ids=lambda kinds: "-".join(kinds))
def test_distance_normal_and_point_are_those_of_coal(kinds):
    near, inside, odd = compiled(kinds), 0, 0
    for one, other in poses(3, 300, 0.7):
        gap, normal, point = near(one.rotation, one.translation, other.rotation, other.translation)
        wanted, direction, middle = by_coal(kinds, one, other)
        core = SIZES["capsule" if "capsule" in kinds else "sphere"][0][0]
        if "cylinder" in kinds and "plane" not in kinds and wanted < -core:
            # a core inside a curved solid: coal's polytope ends at a way out that is not the shortest, and a
            # segment's deepest point lies less deep than the whole
            assert float(gap) > wanted - PRECISE
            continue
        if set(kinds) == {"capsule", "cylinder"} and abs(float(gap) - wanted) > PRECISE:
            odd += 1  # now and then coal's polytope ends millimetres off: points of the segment tell
            inside += wanted < 0
            assert abs(float(gap) - _by_points(kinds, one, other)) < 1e-8
            continue
        assert abs(float(gap) - wanted) < PRECISE
        inside += wanted < 0
        # the direction is the gap's gradient: as precise as the square root of the gap, and not at ties
        assert normal.full().ravel() @ direction > 1 - 1e-6
        assert np.abs(point.full().ravel() - middle).max() < 1e-4
    assert 50 < inside < 300
    assert odd < 6


def _by_points(kinds, one, other):
    """Gap of a capsule and a cylinder, by many points of the capsule's segment."""
    capsule, cylinder = (one, other) if kinds[0] == "capsule" else (other, one)
    (thick,), (half,) = SIZES["capsule"][:2]
    (radius,), (high,) = SIZES["cylinder"][:2]
    relative = cylinder.inverse() * capsule
    along = np.linspace(-half, half, 200_001)[:, None]
    x, y, z = (relative.translation + along * relative.rotation[:, 2]).T
    over = np.array([np.hypot(x, y) - radius, np.abs(z) - high])
    apart = np.where(over.max(axis=0) > 0, np.hypot(*np.maximum(over, 0)), over.max(axis=0))
    return apart.min() - thick


@pytest.mark.parametrize("turn", [0.0, np.pi / 2, 1.0], ids=["along", "across", "askew"])
@pytest.mark.parametrize("tilt", [0.0, 1e-12, 1e-7])
def test_boxes_with_parallel_faces_are_as_far_apart_as_coal_says(turn, tilt):
    near, rng, inside = compiled(("box", "box")), np.random.default_rng(5), 0
    for _ in range(60):
        one = pin.SE3(pin.exp3(rng.normal(size=3)), rng.uniform(-1, 1, 3))
        rotation = pin.exp3(turn * np.eye(3)[rng.integers(3)]) @ pin.exp3(tilt * rng.normal(size=3))
        other = one * pin.SE3(rotation, rng.uniform(-0.9, 0.9, 3))
        gap, normal, _ = near(one.rotation, one.translation, other.rotation, other.translation)
        wanted, direction, _ = by_coal(("box", "box"), one, other)
        assert abs(float(gap) - wanted) < PRECISE
        assert normal.full().ravel() @ direction > 1 - 1e-6
        inside += wanted < 0
    assert 5 < inside < 55


@pytest.mark.parametrize("depth", [1e-6, 1e-3])
def test_flat_on_flat_acts_in_the_middle_of_what_is_shared(depth):
    flat = (np.eye(3), np.zeros(3), np.eye(3))
    # faces 0.6 x 0.4 m one on the other, shifted by 0.4 and 0.1 m
    gap, normal, point = compiled(("box", "box"))(*flat, np.array([0.4, 0.1, 1.0 - depth]))
    assert float(gap) == pytest.approx(-depth, abs=1e-12)
    assert np.allclose(normal.full(), [[0], [0], [1]], rtol=0, atol=1e-12)
    assert np.allclose(point.full(), [[0.2], [0.05], [0.5 - depth / 2]], rtol=0, atol=1e-12)
    for kind, high in (("box", 0.5), ("cylinder", 0.25)):
        place = np.array([0.4, 0.1, high - depth])
        gap, normal, point = compiled(("plane", kind))(*flat, place)
        assert float(gap) == pytest.approx(-depth, abs=1e-12)
        assert np.allclose(point.full(), [[0.4], [0.1], [-depth / 2]], rtol=0, atol=1e-9)


@pytest.mark.parametrize("kinds", EVERY, ids=lambda kinds: "-".join(kinds))
def test_the_gap_changes_with_the_velocity_of_the_shapes_points_along_the_normal(kinds):
    near, rng, step = compiled(kinds), np.random.default_rng(1), 1e-6
    for one, other in poses(4, 60, 0.7):
        twists = rng.normal(size=(2, 6))
        places = [
            [pin.SE3(pin.exp3(s * t[3:]) @ p.rotation, p.translation + s * t[:3]) for s in (-step, step)]
            for p, t in zip((one, other), twists, strict=True)
        ]
        ends = [
            near(a.rotation, a.translation, b.rotation, b.translation) for a, b in zip(*places, strict=True)
        ]
        _, normal, point = near(one.rotation, one.translation, other.rotation, other.translation)
        if set(kinds) == {"capsule", "cylinder"} and ends[0][0] < -SIZES["capsule"][0][0]:
            continue  # the segment itself is inside: its deepest point may lie where two directions meet
        n, p = normal.full().ravel(), point.full().ravel()
        speeds = [
            t[:3] + np.cross(t[3:], p - place.translation)
            for t, place in zip(twists, (one, other), strict=True)
        ]
        rate = float(ends[1][0] - ends[0][0]) / (2 * step)
        assert rate == pytest.approx(n @ (speeds[1] - speeds[0]), abs=2e-5)


def test_parallel_shapes_and_coincident_ones_have_finite_answers_and_derivatives():
    for kinds in EVERY:
        near = compiled(kinds)
        jacobian = near.jacobian()
        for height in (0.0, 0.45, 0.9):
            places = (np.eye(3), np.zeros(3), np.eye(3), np.array([0.0, 0.0, height]))
            assert all(np.isfinite(value.full()).all() for value in near(*places))
            nominal = near(*places)
            assert all(np.isfinite(np.array(value)).all() for value in jacobian(*places, *nominal))
