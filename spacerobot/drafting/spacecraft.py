"""Equipment of a drafted spacecraft: reaction wheels, thrusters, sensors with errors, and filters.

It is sized by the mass m and the mean moment of inertia J of the robot in its initial state. The control
loops of the base are slow compared with those of the arm, so that they hardly interact: the attitude has K_p
= J w^2 and K_d = 1.4 J w (w = 0.1 rad/s, damping ratio 0.7), the position K_p = m w^2 and K_d = 1.4 m w (w =
0.05 rad/s).
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.drafting.arms import DraftArm
from spacerobot.drafting.numbers import short
from spacerobot.drafting.text import flow
from spacerobot.scenario.paths import Document
from spacerobot.scene import Scene

EQUIPMENT = ("wheels", "thrusters", "filters")
"""Equipment of a spacecraft."""
SECTIONS = ("plan", "campaign")
"""Sections of a scenario that ``--with`` accepts too; every drafted capture has them."""
ATTITUDE_BANDWIDTH, POSITION_BANDWIDTH, DAMPING = 0.1, 0.05, 0.7
WHEEL_ACCELERATION, WHEEL_RATE, WHEEL_SPEED = 5e-3, 0.03, 628.3
"""Angular acceleration [rad/s^2] and rate [rad/s] of the robot caused by one wheel; wheel speed [rad/s]."""
THRUST_ACCELERATION = 2e-3
"""Acceleration of the robot that one nozzle causes [m/s^2]."""


@dataclass(frozen=True)
class Spacecraft:
    """Equipment of the robot's base, and its consequences for the capture.

    Attributes:
        controllers, equipment: Lines of the section ``controllers``, and of actuators, sensors and
            estimators.
        wait_s: Time at the standoff in which filters converge [s].
        least_envelope_m, least_speed_m_s: Minimum capture distance [m] and speed limits [m/s] of the capture
            envelope, with regard to sensor errors.
        plan_limits: Additional limits of plans.
        noise: Whether sensors have noise.
    """

    controllers: tuple[str, ...] = ()
    equipment: tuple[str, ...] = ()
    wait_s: float = 0.0
    least_envelope_m: float = 2e-3
    least_speed_m_s: float = 0.0
    plan_limits: Document = field(default_factory=dict)
    noise: bool = False


def check_include(include: Collection[str]) -> None:
    """Check the names in ``--with``.

    Raises:
        ScenarioError: If a name is unknown; the message has similar names.
    """
    for name in include:
        if name not in (*EQUIPMENT, *SECTIONS):
            raise ScenarioError(
                f"found {name!r}; {near_names(name, (*EQUIPMENT, *SECTIONS))}", where="--with"
            )


def spacecraft(include: Collection[str], scene: Scene, arm: DraftArm) -> Spacecraft:
    """Equipment for the base of a robot.

    Args:
        include: Names from :data:`EQUIPMENT` and :data:`SECTIONS`; the latter have no effect here.
        scene: Scene in which the robot holds the object.
        arm: The robot.

    Raises:
        ScenarioError: If a name is unknown, or wheels or thrusters are requested for a fixed base.
    """
    check_include(include)
    robot = scene.robots[0]
    mount = scene.model.joints[robot.root_joint] if robot.root_joint else None
    if mount is None and {"wheels", "thrusters"} & {*include}:
        raise ScenarioError("found a fixed base, allowed: free_flyer, planar", where="--with")
    controllers, actuators, sensors, estimators = (list[str]() for _ in range(4))
    limits: Document = {}
    if mount is not None:
        upper = np.triu(pin.crba(scene.model, scene.model.createData(), scene.q))
        block = slice(mount.idx_v, mount.idx_v + mount.nv)
        inertia = (upper + np.triu(upper, 1).T)[block, block]
        mass, moment = (
            float(inertia[0, 0]),
            float(np.diag(inertia)[3:].mean() if mount.nv == 6 else inertia[2, 2]),
        )
    if mount is not None and {"wheels", "thrusters"} & {*include}:
        w = ATTITUDE_BANDWIDTH
        attitude = {
            "kind": "base_attitude",
            "kp": short(moment * w**2),
            "kd": short(2 * DAMPING * moment * w),
        }
        controllers += [
            f"      # attitude: {short(moment):g} kg m^2 at {w:g} rad/s, damping ratio {DAMPING:g}",
            f"      attitude: {flow(attitude | {'feed_forward': 0})}",
        ]
    if mount is not None and "wheels" in include:
        place = {"axes": [[0, 0, 1]]} if mount.nv == 3 else {"pyramid": {"wheels": 4, "tilt_deg": 35.26}}
        torque = short(moment * WHEEL_ACCELERATION, 2)
        wheels = {"kind": "reaction_wheels", **place, "inertia": short(moment * WHEEL_RATE / WHEEL_SPEED, 2)}
        wheels |= {"torque_limit": torque, "speed_limit": WHEEL_SPEED}
        actuators += [
            f"      # each accelerates the robot by {WHEEL_ACCELERATION:g} rad/s^2, and stores the momentum "
            f"of {WHEEL_RATE:g} rad/s",
            f"      wheels: {flow(wheels)}",
        ]
    if mount is not None and "thrusters" in include:
        w = POSITION_BANDWIDTH
        position = {"kind": "base_position", "kp": short(mass * w**2), "kd": short(2 * DAMPING * mass * w)}
        controllers += [
            f"      # position of the robot's centre of mass: {short(mass):g} kg at {w:g} rad/s",
            f"      position: {flow(position | {'feed_forward': 0})}",
        ]
        actuators += _nozzles(mass, moment, mount.nv == 3)
    if "filters" in include:
        camera = {"period": 0.5, "delay": 0.2, "noise_growth": 0.5}
        sensors += [
            "      # camera on the tip's link, with 1 mm and 1.7 mrad per sample near the mating frame",
            f"      target_position: {{errors: {flow(camera | {'noise': 7e-4})}}}",
            f"      target_orientation: {{errors: {flow(camera | {'noise': 1.2e-3})}}}",
        ]
        frame = scene.grasps[0].config.frame
        filtered: Document = {"kind": "target_filter", "tip": arm.tip_name, "frame": frame}
        filtered |= {
            "position": 5e-3,
            "velocity": 1e-3,
            "attitude_deg": 0.5,
            "spin_deg": 0.05,
            "inertia": 0.05,
        }
        estimators += [f"      object: {flow(filtered)}"]
        if controllers and mount is not None and mount.nv == 6:
            sensors += ["      base_orientation: {kind: star_tracker}", "      base_spin: {kind: gyro}"]
            estimators += ["      attitude: {kind: attitude_filter, attitude_deg: 0.05}"]
    equipment = [
        *(["    actuators:", *actuators] if actuators else []),
        *(["    sensors:", *sensors] if sensors else []),
        *(["    estimators:", *estimators] if estimators else []),
    ]
    noisy = "filters" in include
    return Spacecraft(
        tuple(controllers),
        tuple(equipment),
        wait_s=10.0 if noisy else 0.0,
        least_envelope_m=1e-2 if noisy else 2e-3,
        least_speed_m_s=5e-3 if noisy else 0.0,
        plan_limits=limits,
        noise=noisy,
    )


def _nozzles(mass: float, moment: float, planar: bool) -> list[str]:
    """Lines of twelve nozzles (eight in a planar scene) that span all forces and torques.

    Two nozzles push along each axis in each direction, at a distance along the next axis, so that two
    opposite ones form a couple. They are on the surface of a uniform cube with the robot's mass and inertia,
    whose edge is sqrt(6 J / m).
    """
    half = short(float(np.sqrt(6 * moment / mass)) / 2, 2)
    lines = [
        f"      # each accelerates the robot by {THRUST_ACCELERATION:g} m/s^2; a pair makes a couple",
        "      jets:",
        "        kind: thrusters",
        f"        thrust: {short(mass * THRUST_ACCELERATION, 2):g}",
        "        specific_impulse: 220",
        "        nozzles:",
    ]
    for k in range(2 if planar else 3):
        apart = (1 - k) if planar else (k + 1) % 3
        for sense in (1, -1):
            for side in (1, -1):
                position, direction = [0.0, 0.0, 0.0], [0, 0, 0]
                direction[k], position[k], position[apart] = sense, -sense * half, side * half
                name = f"{'xyz'[k]}{'+' if sense > 0 else '-'}".replace("+", "_up").replace("-", "_down")
                lines.append(
                    f"          {name}_{'a' if side > 0 else 'b'}: "
                    f"{flow({'position': position, 'direction': direction})}"
                )
    return lines
