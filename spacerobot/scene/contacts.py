"""Contacts of a scene: pairs of shapes that may touch, their poses and distances."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import coal
import numpy as np
import pinocchio as pin

from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.common.section import matching
from spacerobot.elements.shapes.collision_shape import Wrap, wrapping_shapes
from spacerobot.scenario import Scenario
from spacerobot.scene.bounding_primitives import shape_of, wrapped, wraps_around
from spacerobot.scene.scene import Scene, SceneBody, SceneContact, SceneShape
from spacerobot.shapes import Shape, have_distance, proximity

TOUCHING = 1e-9
"""Overlap [m] at the start below which shapes only touch."""


def find_contacts(
    model: Any, bodies: Sequence[SceneBody], scenario: Scenario, source: Path | None
) -> tuple[SceneContact, ...]:
    """Contacts of a scenario with every pair of shapes that may touch.

    Raises:
        ScenarioError: If a contact names an unknown pad or link, or shapes that have no distance.
    """
    finder = _Finder(model, {body.name: body for body in bodies}, scenario, source)
    return tuple(
        SceneContact(name, f"contacts.{name}", one, finder.pairs(one.between, one.wrap, f"contacts.{name}"))
        for name, one in scenario.contacts.items()
    )


def find_pairs(
    scene: Scene, between: tuple[str, str], wrap: Wrap | None, where: str
) -> tuple[tuple[SceneShape, SceneShape], ...]:
    """All pairs of a shape of one side with a shape of the other.

    Args:
        scene: The scene.
        between: Two sides, as a contact names them.
        wrap: Shape that replaces meshes and cylinders.
        where: Dotted path of the section that names them.

    Raises:
        ScenarioError: See :func:`find_contacts`.
    """
    bodies = {body.name: body for body in scene.bodies}
    return _Finder(scene.model, bodies, scene.scenario, scene.source).pairs(between, wrap, where)


class _Finder:
    def __init__(
        self, model: Any, bodies: dict[str, SceneBody], scenario: Scenario, source: Path | None
    ) -> None:
        self.model, self.bodies, self.scenario, self.source = model, bodies, scenario, source

    def pairs(
        self, between: tuple[str, str], wrap: Wrap | None, path: str
    ) -> tuple[tuple[SceneShape, SceneShape], ...]:
        """All pairs of a shape of one side with a shape of the other, each with a defined distance."""
        ones, others = (list(self._side(side, wrap, f"{path}.between.{i}")) for i, side in enumerate(between))
        pairs = tuple(itertools.product(ones, others))
        for first, second in pairs:
            # refuse a pair that has no distance, or cannot move
            named = f"{first.label} and {second.label}"
            if first.joint == second.joint:
                raise self._fault(f"{named} are fixed to each other and cannot touch", f"{path}.between")
            if not have_distance(type(first.config), type(second.config)):
                raise self._fault(
                    f"{named} are two half-spaces, which have no distance; put another shape on one",
                    f"{path}.between",
                )
        return pairs

    def _fault(self, message: str, where: str) -> ScenarioError:
        return ScenarioError(message, source=self.source, where=where)

    def _side(self, side: str, wrap: Wrap | None, where: str) -> Iterator[SceneShape]:
        """Collision shapes of a side of a contact: a pad, or the links that its pattern matches."""
        if side in self.scenario.pads:
            pad, path = self.scenario.pads[side], f"pads.{side}"
            body = self._body(pad.link, f"no body for {pad.link!r}", [], f"{path}.link")
            name, names = pad.link.partition("/")[2], [link.name for link in body.description.links]
            if name not in names:
                hint = near_names(name, names)
                raise self._fault(f"no link {name!r} in {body.description.path.name}; {hint}", f"{path}.link")
            turn = pin.rpy.rpyToMatrix(np.radians(pad.rotation_deg))
            placed = pin.SE3(turn, np.array(pad.position)).homogeneous
            yield SceneShape(side, path, pad, *self._frame(body, name), placed)
            return
        body = self._body(side, f"no pad nor body/link {side!r}", [*self.scenario.pads], where)
        pattern = side.partition("/")[2]
        names = [link.name for link in body.description.links]
        matching_links = set(matching(names, pattern))
        # all pieces of a flexible link
        links = [
            link
            for link in body.description.links
            if link.name in matching_links
            or (link.borrowed is not None and link.borrowed[0] in matching_links)
        ]
        if not links:
            hint = near_names(pattern, names)
            raise self._fault(f"no link {pattern!r} in {body.description.path.name}; {hint}", where)
        if not any(link.collisions for link in links):
            raise self._fault(f"{side} has no collision shape; name a pad on it under `pads`", where)
        for link in links:
            for shape in link.collisions:
                label, geometry, placement = f"{body.name}/{link.name}", shape.geometry, np.eye(4)
                if wraps_around(geometry) and wrap is not None:
                    config, placement = wrapped(geometry, wrap, label)
                elif geometry.mesh is not None:
                    wraps = " or ".join(f"`wrap: {name}`" for name in sorted(wrapping_shapes()))
                    raise self._fault(
                        f"{label} collides by a mesh, which has no contact law; give {wraps} to use a shape "
                        "around it, or name a pad",
                        where,
                    )
                else:
                    config = shape_of(geometry, label)
                yield SceneShape(
                    label, None, config, *self._frame(body, link.name), shape.placement @ placement
                )

    def _body(self, side: str, fault: str, others: list[str], where: str) -> SceneBody:
        """Body whose name precedes the slash."""
        name, slash, _ = side.partition("/")
        if not slash or name not in self.bodies:
            allowed = [*others, *(f"{body}/" for body in self.bodies)]
            raise self._fault(f"{fault}; {near_names(side, allowed)}", where)
        return self.bodies[name]

    def _frame(self, body: SceneBody, link: str) -> tuple[int, int]:
        frame = int(self.model.getFrameId(f"{body.name}/{link}", pin.FrameType.BODY))
        return frame, int(self.model.frames[frame].parentJoint)


def coal_distance(first: SceneShape, second: SceneShape, places: Sequence[Any]) -> Any:
    """Coal's ``DistanceResult`` of two shapes with given link placements (``pin.SE3``)."""
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = request.epa_tolerance = 1e-13
    request.gjk_max_iterations = request.epa_max_iterations = 1000
    parts: list[Any] = []
    for shape, place in zip((first, second), places, strict=True):
        at = place * pin.SE3(shape.placement)
        parts += [shape.config.coal(), coal.Transform3s(at.rotation, at.translation)]
    coal.distance(*parts, request, result)
    return result


def gaps(scene: Scene, contact: SceneContact) -> list[float]:
    """Signed distances [m] of a contact's pairs of shapes at the start."""
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)
    return [
        float(coal_distance(*pair, [data.oMf[shape.frame] for shape in pair]).min_distance)
        for pair in contact.pairs
    ]


def check_overlap(scene: Scene) -> None:
    """Check that contact shapes do not overlap at the start, unless allowed.

    Raises:
        ScenarioError: If they do; names the contact, the shapes and the depth.
    """
    for contact in scene.contacts:
        for gap, (first, second) in zip(gaps(scene, contact), contact.pairs, strict=True):
            if gap < -TOUCHING and not contact.config.may_overlap:
                raise ScenarioError(
                    f"{first.label} and {second.label} overlap by {-gap:.3g} m at the start; move a base, "
                    "change the posture, or give `may_overlap: true`",
                    source=scene.source,
                    where=contact.path,
                )


def dome_warnings(scene: Scene) -> list[str]:
    """Warnings of pairs that overlap at the start only by the domes of their crowned faces and edges."""
    warnings = []
    for contact in scene.contacts:
        if contact.config.may_overlap:
            continue
        for gap, pair in zip(gaps(scene, contact), contact.pairs, strict=True):
            crown = contact.config.crown
            # no domes of two shapes are higher [m]
            extents = (shape.config.extent()[1] for shape in pair if not shape.config.is_halfspace)
            near = gap < 3**0.5 * crown * sum(extents)
            depth = _within_domes(scene, pair, crown) if near else 0.0
            if depth > TOUCHING:
                warnings.append(
                    f"{contact.path}: {pair[0].label} and {pair[1].label} begin {depth:.2g} m inside the "
                    "domes of their faces and edges, so they push at once; move them apart by that, or lower "
                    "`crown`"
                )
    return warnings


def _within_domes(scene: Scene, pair: tuple[SceneShape, SceneShape], crown: float) -> float:
    """Penetration [m] of two crowned shapes at the start, negative if they are separate."""
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)

    def placed(shape: SceneShape) -> Shape:
        at = data.oMf[shape.frame] * pin.SE3(shape.placement)
        place = ca.SX(ca.DM(at.rotation)), ca.SX(ca.DM(at.translation))
        return Shape(type(shape.config), *place, shape.config.measures())

    one, other = (placed(shape) for shape in pair)
    return -float(ca.evalf(proximity(one, other, crown).gap))
