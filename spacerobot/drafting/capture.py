"""Draft of a docking: an arm approaches an object, captures it and stops it.

The initial scene is that in which the arm holds the object (:mod:`spacerobot.drafting.held`), with the object
moved away along the direction of approach, so far that no joint needs to move by more than about 0.3 rad. At
the capture, the arm is therefore in an agile posture. The tip has its mated orientation from the start.

**Approach.** The effective inertia at a tip depends on the direction, most of all for arms with a light
wrist. The bandwidth of a PID with one gain for all directions and the Jacobian's transpose depends on the
direction in the same ratio: the tip of a UR3 rotated at 3 deg/s while it hardly tracked its reference.
Resolved rates by the generalised Jacobian with inverse dynamics
(:mod:`spacerobot.elements.controllers.resolved_rate`) have the poles -g and -k in every direction, with g =
``gain`` and k = ``rate_gain``.

**Stop.** The same law with the object as payload includes the object's inertia, so that the poles are
unchanged.

**Slowdown.** With a slowdown s, durations are s times longer, speeds and bandwidths s times lower and torques
s^2 times lower. :mod:`spacerobot.drafting.verified` increases s until the draft captures.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError
from spacerobot.common.files import StrPath
from spacerobot.description.parts import UrdfJoint, UrdfLink
from spacerobot.description.write import urdf_xml
from spacerobot.drafting.arms import DraftArm, as_name, read, scene_of
from spacerobot.drafting.held import held_scene, mating_frames
from spacerobot.drafting.numbers import SPAN, DraftNumbers, payload_of, short
from spacerobot.drafting.request import DraftRequest
from spacerobot.drafting.spacecraft import Spacecraft, spacecraft
from spacerobot.drafting.text import flow, guidance_lines, guidance_variables, joint_lines, target_lines
from spacerobot.scenario.document import parse_yaml
from spacerobot.scenario.paths import Document
from spacerobot.scene import Scene

POINT = "mate_point"
"""Name of the mating frame at a point of the object's surface."""
PEAK = 1.875
"""Ratio of peak to mean speed of a rendezvous' quintic blend."""
DRIFT, TURN_DEG = 0.1, 2.0
"""Drift of the object until the tip arrives, relative to the tip's initial distance, and rotation [deg]."""
ENVELOPE = 1.5
"""Allowed closing speed at the capture, relative to the peak closing speed of the approach. The tip enters
the envelope, at a fifth of the distance from the standoff, at 0.73 of the peak."""
TORQUE = 1e-3
"""Maximum weight of torques in a plan, relative to that of joint accelerations."""


def required_limits(arm: DraftArm, scene: Scene) -> Document:
    """Section ``limits`` of a plan: the limits that every joint of the chain has in the URDF."""
    joints = [joint for joint in arm.chain if joint.name in arm.joints]
    config = scene.bodies[0].config.joints
    limited = {
        "position": (j.kind == "continuous" or np.isfinite([j.lower, j.upper]).all() for j in joints),
        "rate": (np.isfinite(j.velocity) for j in joints),
        "torque": (config[j.name].torque_limit is not None for j in joints),
    }
    required = [quantity for quantity, each in limited.items() if all(each)]
    return {"urdf": required} if required else {}


def plan_costs(duration_s: float, dampings: Sequence[float]) -> Document:
    """Weights of torques and joint accelerations in a plan, relative to the base's rotation.

    A cubic blend over one radian or metre in a time T has rates up to 1.5/T and accelerations up to 6/T^2.
    Its acceleration costs as much as one radian of base rotation if the weight is w_a = (T^2/6)^2. With
    weights independent of T, a slow arm would move all joints to keep the base still, and collide with
    itself.

    The torque against a joint's damping d [N m s/rad or N s/m] costs w_u (d v)^2. The Euler-Lagrange equation
    of w_u (d v)^2 + w_a v'^2 has the time constant (w_a/w_u)^(1/2)/d, in which optimal rates change. For a
    torso of 1000 N s/m it was 0.03 s in a motion of a minute. Equal costs of damping and acceleration, with
    w_u = (T/1.5/d)^2, give T/4.

    Args:
        duration_s: Duration of the plan [s].
        dampings: Damping of each moving joint.

    Returns:
        dict: Weights of ``torque`` and ``joint_acceleration``.
    """
    acceleration = (duration_s**2 / 6) ** 2
    damped = (duration_s / 1.5 / max([*dampings, 1e-9])) ** 2
    torque = min(TORQUE * acceleration, damped)
    return {"torque": short(torque, 1), "joint_acceleration": short(acceleration, 1)}


def surface_point(request: DraftRequest, file: StrPath) -> tuple[DraftRequest, Path, str]:
    """Request for a URDF of the object that has a mating frame at the requested point of the surface.

    The frame's x axis points into the object: along that axis of the root link which is nearest to the
    direction from the point to the root link's centre of mass.

    Args:
        request: Request with a point of the object's surface.
        file: File of the scenario, in whose folder the caller writes the URDF.

    Returns:
        tuple: The request, and path and text of the URDF.

    Raises:
        ScenarioError, DescriptionError: If the point is no three numbers or the centre of mass, the request
            has mating frames too, or the URDF cannot be used.
    """
    point, file = request.point or (), Path(file).absolute()
    if len(point) != 3 or request.frames:
        place = ",".join(f"{x:g}" for x in point)
        raise ScenarioError(
            f"found {place or 'nothing'!r}, allowed: x,y,z [m] on the object's root link, without --frame",
            where="--point",
        )
    _, description = read(request.target, file.parent)
    root = next(link for link in description.links if link.name == description.root)
    inward = root.com - np.array(point)
    along = np.zeros(3)
    along[int(np.argmax(np.abs(inward)))] = np.sign(inward[int(np.argmax(np.abs(inward)))])
    if not along.any():
        raise ScenarioError(
            f"found the centre of mass of {root.name}, allowed: a point of the surface", where="--point"
        )
    across = np.eye(3)[(int(np.argmax(np.abs(along))) + 1) % 3]
    origin = np.eye(4)
    origin[:3, :3] = np.column_stack([along, across, np.cross(along, across)])
    origin[:3, 3] = point
    frame = UrdfLink(POINT, 0.0, np.zeros(3), np.zeros((3, 3)))
    mount = UrdfJoint(f"{POINT}_mount", "fixed", root.name, POINT, origin, np.array([1.0, 0, 0]))
    text = urdf_xml(description.path.stem, [*description.links, frame], [*description.joints, mount], "")
    urdf = file.with_name(f"{file.stem}_target.urdf")
    return replace(request, target=str(urdf), frames=[POINT], point=None), urdf, text


def draft_capture(order: DraftRequest, file: StrPath) -> tuple[str, Scene]:
    """Draft a scenario with approach, capture and stop, without simulating or writing it.

    Args:
        order: Request with one robot and an object.
        file: File of the scenario; paths of URDFs are relative to its folder.

    Returns:
        tuple: Text of the scenario, and its scene.

    Raises:
        ScenarioError, DescriptionError: If a URDF cannot be used, a link is missing, or the object has no
            mating frame.
    """
    return CaptureGeometry.of(order, file).scenario()


@dataclass(frozen=True)
class CaptureGeometry:
    """Poses of a capture, and parameters of its motion and controllers without slowdown.

    Attributes:
        file: File of the scenario.
        arm, bare, held: The robot, the scenario without gains, and its scene in which the arm holds the
            object.
        spacecraft: Sensors, controllers and actuators of the base.
        gain: Bandwidth of the tip [rad/s].
        payload: Keys that describe the object as payload.
        direction, axis, mated_deg: Direction of approach in world axes (3,) and in the mating frame (3,), and
            roll, pitch, yaw of the mated tip in the mating frame [deg].
        way: Initial distance of the tip from the mating frame [m].
        approach_time: Time to the standoff [s].
        place: Position of the object's root link when the arm holds it, world axes (3,) [m].
        lever: Distance of the mating frame from that position [m].
    """

    file: Path
    arm: DraftArm
    bare: Document
    held: Scene
    spacecraft: Spacecraft
    gain: float
    payload: Document
    direction: Array
    axis: Array
    mated_deg: Sequence[float]
    way: float
    approach_time: float
    place: Array
    lever: float

    @classmethod
    def of(
        cls, order: DraftRequest, file: StrPath, progress: Callable[[str], None] | None = None
    ) -> CaptureGeometry:
        """Compute the poses.

        Args:
            order: Request with one robot and an object.
            file: File of the scenario; paths of URDFs are relative to its folder.
            progress: As for :func:`spacerobot.drafting.held.held_scene`.

        Raises:
            ScenarioError, DescriptionError: As :func:`draft_capture`.
        """
        file = Path(file)
        count = len(order.robots)
        if count + (order.bus is not None) != 1:
            allowed = "one by --robot, or one with --bus and --mount"
            raise ScenarioError(
                f"found {count + (order.bus is not None)} robots, allowed with --capture: {allowed}",
                where="--robot",
            )
        _, description = read(order.target, file.absolute().parent)
        if mating_frames(order, description) == [description.root]:
            raise ScenarioError(
                f"{description.path.name} has no mating frame (an end link without mass); name a "
                "link of its surface by --frame, or a point by --point=x,y,z",
                where="--frame",
            )
        (arm,), bare, held = held_scene(order, file.absolute(), progress)
        grasp, target = held.grasps[0], held.bodies[-1]
        data = held.model.createData()
        pin.framesForwardKinematics(held.model, data, held.q)
        tip, mate = data.oMf[grasp.tip.frame], data.oMf[grasp.frame]
        # direction of approach: the axis of the mating frame nearest to the direction to the centre of mass
        masses = [held.model.inertias[joint].mass for joint in target.subtree]
        places = [data.oMi[joint].act(held.model.inertias[joint].lever) for joint in target.subtree]
        centre = np.average(places, axis=0, weights=masses)
        toward = mate.rotation.T @ (centre - mate.translation)
        toward = toward * np.isin(range(3), held.translation_axes) if held.planar else toward
        axis = np.zeros(3)
        axis[int(np.argmax(np.abs(toward)))] = 1.0 if toward[int(np.argmax(np.abs(toward)))] >= 0 else -1.0
        numbers = DraftNumbers(held, {arm.name: arm})
        gains = numbers.gains(held.tips[0])
        # the approach moves the arm without the object; with it, mainly a light base would move
        source = file.absolute()
        document = {"name": "draft", "robots": bare["robots"]}
        alone = DraftNumbers(scene_of(document, source), {arm.name: arm})
        move = alone.move(gains.bandwidth, mate.rotation @ axis)
        mated = np.degrees(pin.rpy.matrixToRpy(mate.rotation.T @ tip.rotation))
        place = data.oMf[target.root_frame].translation
        return cls(
            file,
            arm,
            bare,
            held,
            spacecraft(order.include, held, arm),
            gains.guidance,
            payload_of(held),
            mate.rotation @ axis,
            axis,
            [round(float(x), 3) + 0.0 for x in mated],
            float(np.linalg.norm(move.displacement)),
            move.duration,
            np.array(place),
            float(np.linalg.norm(mate.translation - place)),
        )

    def scenario(self, slowdown: float = 1.0) -> tuple[str, Scene]:
        """Text of the scenario with a slowdown, and its scene."""
        text, source = self._text(slowdown), self.file.absolute()
        return text, scene_of(parse_yaml(text, source=source), source)

    def _text(self, slowdown: float) -> str:
        arm, craft = self.arm, self.spacecraft
        ((name, bare_grasp),) = self.bare["grasps"].items()
        tip, link = f"{arm.name}/{arm.tip_name}", bare_grasp["frame"]
        gain = short(self.gain / slowdown, 2)
        # approach to a standoff at half the distance, then along the axis
        half, to_standoff = short(self.way / 2, 2), short(self.approach_time * slowdown, 3)
        speed = short(PEAK * half / to_standoff, 2)
        until = to_standoff + craft.wait_s + PEAK * half / speed
        latest = float(np.ceil(until + 10 * slowdown + 5))
        at: Document = {"axis": self.axis.tolist()}
        at |= {"mated_deg": list(self.mated_deg)} if arm.turns else {}
        reference = {"kind": "rendezvous", "frame": link, "standoff": half, **at}
        reference |= {"approach_time": to_standoff, "closing_speed": speed}
        reference |= {"wait": craft.wait_s} if craft.wait_s else {}
        capture: Document = {"distance": short(max(self.way / 10, craft.least_envelope_m), 2)}
        capture |= {"misalignment_deg": 5.0} if arm.turns else {}
        capture["closing_speed"] = short(max(ENVELOPE * speed, craft.least_speed_m_s), 2)
        capture["lateral_speed"] = short(max(speed / 2, craft.least_speed_m_s), 2)
        capture |= {"spin_deg": 2.0} if arm.turns else {}
        capture |= {"dwell": 0.1, **at}
        base = self._drifting(until)
        drift = float(np.linalg.norm(base["velocity"]))
        # an arm without control of its tip's orientation stops the object's translation, but not its rotation
        spin = base["spin_deg"][2]
        settled: Document = {"speed": short(max(drift, 1e-5) / 2, 1), "spin_deg": short(spin / 2, 1)}
        if not arm.turns:
            settled = {"speed": short(2 * (drift + np.radians(spin) * self.lever), 1)}
        settled["dwell"] = 0.5
        latest_stop = short(max(20.0, 20 / gain), 2)
        goal = {"tip": tip, "frame": link, **at, "orientation": arm.turns, "settled": True}
        floating = self.bare["robots"][arm.name]["base"]["joint"] != "fixed"
        costs = plan_costs(until, [joint.damping for joint in arm.chain if joint.name in arm.joints])
        costs |= {"base_rotation": 1} if floating else {}
        limits = required_limits(arm, self.held) | craft.plan_limits
        # from the closing speed the brake takes two time constants of the guidance, and at least 2 s: a pulse
        # of a higher deceleration would be shorter than the steps, and its loads would be missed
        deceleration = short(min(0.01, 1.5 * speed / max(2.0, 2 / gain)), 2)
        brake = {"kind": "brake", "deceleration": deceleration, "spin_deceleration_deg": 0.5}
        approach = {"tips": {arm.tip_name: {"reference": reference}}}
        stop: Document = {"controllers": {"guidance": {"payload_fraction": 1}}}
        stop |= {"tips": {arm.tip_name: {"reference": brake}}}
        lines = [
            "# Drafted by `spacerobot new --capture`: approach, capture, stop. Every number is a proposal.",
            "# Units are SI unless a name says otherwise; `spacerobot schema` exports every field.",
            f"name: {flow(as_name(self.file.stem))}",
            "",
            "robots:",
            *self._robot(gain),
            "",
            "target:",
            *target_lines(self.bare["target"]),
            "  # The pose at which the arm would hold the object, moved away along the axis of approach so",
            "  # far that no joint moves by more than about 0.3 rad. The object drifts by a tenth of this",
            "  # distance until the tip arrives.",
            f"  base: {flow(base)}",
            "",
            "grasps:",
            f"  {name}:",
            f"    tip: {flow(bare_grasp['tip'])}",
            f"    frame: {flow(link)}",
            "    kind: weld   # rigid; `compliant` has stiffness and damping",
            "    begins: open",
            "    # a tenth of the distance of the tip; twice the expected closing speed at the capture",
            f"    capture: {flow(capture)}",
            "",
            "phases:",
            "  approach:   # to a standoff at half of the distance, then along the axis of approach",
            f"    robots: {flow({arm.name: approach})}",
            f"    until: {{captured: [{name}]}}",
            f"    timeout: {latest:g}",
            "    on_timeout: end",
            "  stop:   # ends when speed and spin of the object are below half of their initial values",
            f"    robots: {flow({arm.name: stop})}",
            f"    until: {{settled: {flow(settled)}}}",
            f"    timeout: {latest_stop:g}",
            "",
            "# the step is chosen by an error estimate",
            f"simulation: {flow({'duration': latest + latest_stop, 'output_step': 0.05})}",
            "",
            "# Trajectory optimisation of the approach: `spacerobot plan` (docs/how_to/plan_and_follow.md)",
            "plan:",
            f"  duration: {until:.3g}",
            f"  goals: {{{name}: {flow(goal)}}}",
            f"  costs: {flow(costs)}",
            f"  limits: {flow(limits)}",
            "  intervals: 8",
            "",
            f"# Variables of tuning: {1 / SPAN:g} to {SPAN:g} the values above (docs/how_to/tune.md)",
            "tuning:",
            "  variables:",
            *guidance_variables(arm, gain),
            "  # integral of squared tip errors (minimax: the largest); 1 rad of the target counts as 0.3 m",
            "  objective: {kind: ise, object_rotation: 0.1}",
            "  # constraints: {max_joint_torque: 50, max_grip_force: 100}",
            "",
            *self._campaign(drift, latest),
        ]
        return "\n".join(lines) + "\n"

    def _drifting(self, until: float) -> dict[str, Any]:
        """Initial pose and velocity of the object.

        Args:
            until: Time at which the tip arrives [s]; until then, the drift is a fraction of the distance.
        """
        if self.held.planar:
            sideways = np.array([-self.direction[1], self.direction[0], 0.0])
        else:
            sideways = np.cross(self.direction, np.eye(3)[int(np.argmin(np.abs(self.direction)))])
            sideways /= np.linalg.norm(sideways)
        spin = min(TURN_DEG / until, np.degrees(DRIFT * self.way / max(self.lever, 1e-3) / until))
        held = self.bare["target"]["base"]
        base: dict[str, Any] = {"joint": held["joint"]}
        base["position"] = [round(float(x), 4) + 0.0 for x in self.place + self.way * self.direction]
        base["rotation_deg"] = held["rotation_deg"]
        base["velocity"] = [short(float(x), 2) + 0.0 for x in DRIFT * self.way / until * sideways]
        base["spin_deg"] = [0, 0, short(float(spin), 1)]
        return base

    def _robot(self, gain: float) -> list[str]:
        """Lines of the robot's section."""
        arm, craft, bare = self.arm, self.spacecraft, self.bare["robots"][self.arm.name]
        tip = bare["tips"][arm.tip_name]
        return [
            *joint_lines(arm, bare),
            "    controllers:",
            *guidance_lines(arm, gain, self.payload | {"payload_fraction": 0}),
            *craft.controllers,
            *craft.equipment,
            "    tips:",
            f"      {arm.tip_name}:",
            *([f"        frame: {flow(tip['frame'])}"] if "frame" in tip else []),
            "        reference: {kind: hold}",
        ]

    def _campaign(self, drift: float, latest: float) -> list[str]:
        """Lines of the campaign's section."""
        size, away, noise = short(drift, 1), short(self.way / 10, 1), self.spacecraft.noise
        axes = "xy" if self.held.planar else "xyz"
        return [
            "# Uncertain place, drift and masses: `spacerobot campaign` (docs/how_to/monte_carlo.md)",
            "campaign:",
            "  parameters:",
            "    object_mass: {paths: 'target.links.*.mass', apply: factor, lower: 0.8, upper: 1.2}",
            "    link_mass: {paths: 'robots.*.links.*.mass', apply: factor, lower: 0.95, upper: 1.05}",
            *(
                f"    {name}_{axis}: {{paths: target.base.{key}.{i}, apply: offset, "
                f"lower: {-half:g}, upper: {half:g}}}"
                for name, key, half in (("place", "position", away), ("drift", "velocity", size))
                for i, axis in enumerate(axes)
            ),
            *(["    noise: {paths: simulation.noise_draw, lower: 0, upper: 1.0e9}"] if noise else []),
            "  samples: 64",
            "  metrics: [capture_time, touchdown_speed, grip_force_peak, joint_torque_peak]",
            f"  limits: {{capture_time: {latest:g}}}   # a missed or later capture is a failure",
        ]
