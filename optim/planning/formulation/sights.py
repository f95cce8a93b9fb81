"""Lines of sight: a mating frame stays inside a cone about the axis of a camera."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin

from optim.planning.formulation.names import find_frame, find_robot
from optim.planning.formulation.stage import Stage
from spacerobot.elements.instant import Row, unit
from spacerobot.errors import ScenarioError, near_names
from spacerobot.scenario.plan import Sight
from spacerobot.scene import Scene

NEAR = 1e-4
"""[m] Distance from the camera within which the direction loses its meaning smoothly."""


def sight_row(stage: Stage, name: str, sight: Sight) -> Row:
    """Cosine of the angle between a camera's axis and the direction to a mating frame.

    Raises
    ------
    ScenarioError
        If there is no such link or frame.
    """
    where = f"plan.sights.{name}"
    rotation, origin = stage.placement(_camera(stage.scene, sight.camera, where))
    away = stage.placement(find_frame(stage.scene, sight.frame, f"{where}.frame"))[1] - origin
    cosine = ca.dot(ca.mtimes(rotation, unit(sight.axis)), away) / ca.sqrt(ca.sumsqr(away) + NEAR**2)
    limit = np.radians(sight.half_angle_deg)
    return Row(
        f"{name}: off the camera's axis",
        "rad",
        cosine,
        lower=float(np.cos(limit)),
        last=sight.last,
        scale=float(1 / np.sin(limit)),
        form="cosine",
    )


def _camera(scene: Scene, label: str, where: str) -> int:
    """Id of the frame of a robot's link, by robot/link."""
    robot, _, link = label.partition("/")
    links = [one.name for one in find_robot(scene, robot, f"{where}.camera").description.links]
    if link not in links:
        raise ScenarioError(
            f"no link {link!r}; {near_names(link, links)}", source=scene.source, where=f"{where}.camera"
        )
    return int(scene.model.getFrameId(label, pin.FrameType.BODY))
