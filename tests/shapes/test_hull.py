"""Hulls of points: distances beside coal's of the same corners, and beside the second engine's."""

from __future__ import annotations

import coal
import numpy as np
import pytest
from pydantic import ValidationError

from spacerobot.elements import create
from spacerobot.elements.shapes.hull import POWER
from spacerobot.pinocchio_engine.crowned_distance import crowned_distance
from spacerobot.scene.scene import SceneShape
from tests.shapes.test_against_coal import CONFIGS, poses

TETRAHEDRON = ((0.5, 0, -0.3), (-0.4, 0.4, -0.3), (-0.4, -0.4, -0.3), (0, 0, 0.6))
PRISM = tuple(
    (x, y, z) for z in (-0.2, 0.2) for x, y in ((0.1, 0.2), (-0.1, 0.2), (0.7, 0), (-0.7, 0), (0, -0.6))
)


def hull(points):
    return create("shape", "hull", link="a/b", points=points)


@pytest.fixture(scope="module")
def near():
    """Function of two shapes that gives the function of their poses."""
    import casadi as ca

    from spacerobot.shapes import Shape, proximity

    def of(*configs):
        places = [ca.SX.sym("R1", 3, 3), ca.SX.sym("p1", 3), ca.SX.sym("R2", 3, 3), ca.SX.sym("p2", 3)]
        shapes = [
            Shape(type(c), places[2 * i], places[2 * i + 1], c.measures()) for i, c in enumerate(configs)
        ]
        found = proximity(*shapes, 1e-4)
        return ca.Function("near", places, [found.gap, found.normal, found.point])

    return of


def test_distance_is_at_most_that_of_the_corners_and_short_of_it_by_no_more_than_the_domes(near):
    function, shapes = near(hull(TETRAHEDRON), hull(PRISM)), []
    for points in (TETRAHEDRON, PRISM):
        corners = coal.StdVec_Vec3s()
        corners.extend([np.array(point) for point in points])
        shapes.append(coal.Convex.convexHull(corners, False, ""))
    domes = sum(
        (len(points) ** (1 / POWER) - 1) * np.linalg.norm(points, axis=1).max()
        for points in (TETRAHEDRON, PRISM)
    )
    apart, short = 0, []
    for one, other in poses(3, 200, 1.5):
        result = coal.DistanceResult()
        placed = [coal.Transform3s(place.rotation, place.translation) for place in (one, other)]
        coal.distance(shapes[0], placed[0], shapes[1], placed[1], coal.DistanceRequest(), result)
        if result.min_distance < domes:
            continue
        apart += 1
        gap = float(function(one.rotation, one.translation, other.rotation, other.translation)[0])
        short.append(result.min_distance - gap)
    assert apart > 80
    assert min(short) > -1e-6
    assert 0.01 < max(short) < domes


@pytest.mark.parametrize("kind", ["hull", "box", "capsule", "plane"])
def test_distance_is_that_of_the_second_engine(near, kind):
    configs = hull(TETRAHEDRON), hull(PRISM) if kind == "hull" else CONFIGS[kind]
    function = near(*configs)
    pair = tuple(SceneShape("", None, config, 0, 0, np.eye(4)) for config in configs)
    compared = 0
    for one, other in poses(7, 60, 1.5):
        gap, normal, point = (
            x.full().ravel()
            for x in function(one.rotation, one.translation, other.rotation, other.translation)
        )
        if gap < 0.05:
            continue
        compared += 1
        again = crowned_distance(pair, (one, other), 1e-4, other.translation - one.translation)
        assert gap[0] == pytest.approx(again[0], abs=1e-9)
        np.testing.assert_allclose(normal, again[1], atol=1e-6)
        np.testing.assert_allclose(point, again[2], atol=1e-5)
    assert compared > 15


def test_corners_that_enclose_no_origin_are_refused():
    with pytest.raises(ValidationError, match="the origin is outside"):
        hull(tuple((x + 2, y, z) for x, y, z in TETRAHEDRON))
    with pytest.raises(ValidationError, match="points of one plane"):
        hull(((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)))
