"""Rates and accelerations of joints."""

from __future__ import annotations

from collections.abc import Callable

from spacerobot.quantities.quantity import MeasuredScene, PlanBound, Quantity

NO_JOINT = "no robot of this scene has a joint"


def joint_unit(revolute: str, prismatic: str) -> Callable[[MeasuredScene], str]:
    """Function of a scene for the unit of its joints' quantity.

    Args:
        revolute, prismatic: Units for revolute and for prismatic joints; both, joined by ``or``, if the scene
            has both kinds.
    """

    def unit(scene: MeasuredScene) -> str:
        kinds = {
            scene.model.joints[joint].shortname().startswith("JointModelP")
            for body in scene.bodies
            for joint in body.arm_joints
        }
        return {(False,): revolute, (True,): prismatic}.get(tuple(kinds), f"{revolute} or {prismatic}")

    return unit


QUANTITIES = (
    Quantity(
        name="joint_rate_rms",
        label="RMS joint rate",
        description="root mean square of the rate of a joint",
        unit="rad/s or m/s",
        reducer="rms",
        expression="joint_rate",
        total="norm",
        weight="joint_rate",
        cost="joint_rate",
        bounds=(
            PlanBound("joint_speed", "m/s", "maximum speed of any prismatic joint", joints=("prismatic",)),
            PlanBound(
                "joint_rate_deg",
                "deg/s",
                "maximum rate of any revolute or continuous joint",
                joints=("revolute", "continuous"),
            ),
        ),
        is_default=False,
        absent=NO_JOINT,
        scene_unit=joint_unit("rad/s", "m/s"),
    ),
    Quantity(
        name="joint_acceleration_rms",
        label="RMS joint acceleration",
        description="root mean square of the acceleration of a joint; a cost keeps arms of many "
        "links from whipping",
        unit="rad/s^2 or m/s^2",
        reducer="rms",
        expression="joint_acceleration",
        total="norm",
        cost="joint_acceleration",
        is_metric=False,
        is_default=False,
        absent=NO_JOINT,
        scene_unit=joint_unit("rad/s^2", "m/s^2"),
    ),
)
