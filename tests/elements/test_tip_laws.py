"""Laws of tips and joints in space: commands and accelerations by hand from Pinocchio's motions of frames.

The robot floats, spins and holds a target by springs. Rates of errors are differences along the motion.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.pinocchio_engine.mechanical_state import MechanicalState
from tests.oracles.motions import DesiredMotions
from tests.oracles.small_scenes import ARM_SIGNALS, PLANAR, SPATIAL, random_x, small_scene

TIP = "robots.one.tips.tip"
TIMES = (0.3, 1.1)
SENSED = {
    f"robots.one.sensors.{signal}": {"offset": 0.01 * (i + 1), "scale": 1 + 0.03 * (i + 1)}
    for i, signal in enumerate(ARM_SIGNALS)
}


def read(scene, signal, value):
    """A signal with the errors of robot one's sensor."""
    sensors = scene.scenario.robots["one"].sensors
    return value if sensors is None else sensors[signal].offset + sensors[signal].scale * value


class Instant:
    """Robot one of a scene at one time and state; everything in world axes."""

    def __init__(self, desired, scene, t, x):
        self.scene, self.t, self.x = scene, t, x
        model, self.names = scene.model, list(desired.loop.state_names)
        self.rate, self.wanted = desired.rate(t, x), desired.at(t, x)["one/tip"]
        q, v = x[: model.nq], x[model.nq : model.nq + model.nv]
        self.state = MechanicalState(model, q, v)
        self.tip = self.state.frame(scene.tips[0].frame)
        self.columns = sorted(int(model.idx_vs[joint]) for joint in scene.bodies[0].arm_joints)
        self.acceleration = self.rate[model.nq : model.nq + model.nv]
        values = desired.outputs(t, x)
        self.outputs = {name: value.ravel() for name, value in values.items()}
        self.torque = self.outputs["joint_torque"][: len(self.columns)]
        self.turned = pin.log3(self.tip.rotation @ self.wanted.rotation.T)

    def part(self, name, values=None):
        """Entries of the state, or of its rate, under a name."""
        values = self.x if values is None else values
        return np.array([values[i] for i, own in enumerate(self.names) if own.startswith(f"one/{name}[")])


def instants(changes, text=SPATIAL):
    """The closed loop, and robot one at random states; each with a function to the states around it."""
    scene = small_scene(text, changes)
    desired, rng = DesiredMotions(scene), np.random.default_rng(4)
    for t in TIMES:
        x = random_x(scene, rng, len(desired.x0))
        now = Instant(desired, scene, t, x)

        def around(step, now=now, t=t, x=x):
            moved = desired.loop.normalise(x + step * now.rate).full().ravel()
            return Instant(desired, scene, t + step, moved)

        yield now, around


@pytest.mark.parametrize("feedback", ["base", "inertial"])
@pytest.mark.parametrize("derivative", ["ideal", "filtered"])
def test_pid_of_a_tip_and_its_orientation(feedback, derivative):
    """Eq. 35-38: e = x_ref' + G X - v, X' = -t_a X + x_ref - x, u = K_p e + K_i int(e) + K_d e'."""
    gains = {"pid": {"kp": 30, "ki": 20, "kd": 4}, "orientation_pid": {"kp": 3, "ki": 2, "kd": 0.7}}
    memories = {"amnesia": {"ge": 40, "ta": 2}, "orientation_amnesia": {"ge": 20, "ta": 3}}
    options = {"feedback": feedback, "derivative": derivative, "filter_time": 0.05}
    changes = {f"{TIP}.{key}": value | options for key, value in gains.items()}
    changes |= {f"{TIP}.{key}": value for key, value in memories.items()}
    for now, around in instants(changes | SENSED):
        before, after = around(-1e-5), around(1e-5)
        scene, expected = now.scene, np.zeros(len(now.columns))
        parts = zip(gains, memories, ("velocity", "angular_velocity"), strict=True)
        for turns, (key, memory, rate) in enumerate(parts):
            rows, pid = slice(3 * turns, 3 * turns + 3), gains[key]
            arm = now.tip.jacobian[rows][:, now.columns]
            gap = [now.wanted.position - read(scene, "tip_position", now.tip.position)]
            gap += [-read(scene, "tip_orientation", now.turned)]
            kept = now.part(f"tip/{memory}")
            np.testing.assert_allclose(
                now.part(f"tip/{memory}", now.rate), gap[turns] - memories[memory]["ta"] * kept, atol=1e-12
            )
            if feedback == "base":
                seen = arm @ read(scene, "joint_rate", now.state.v[now.columns])
            else:
                seen = read(scene, f"tip_{rate}", now.tip.velocity[rows])
            error = getattr(now.wanted, rate) + memories[memory]["ge"] * kept - seen
            np.testing.assert_allclose(now.part(f"tip/{key}.integral", now.rate), error, atol=1e-12)
            slope = [one.part(f"tip/{key}.integral", one.rate) for one in (before, after)]
            slope = (slope[1] - slope[0]) / 2e-5
            if derivative == "filtered":
                slope = (error - now.part(f"tip/{key}.filter")) / 0.05
            push = pid["kp"] * error + pid["ki"] * now.part(f"tip/{key}.integral") + pid["kd"] * slope
            expected += arm.T @ push
        np.testing.assert_allclose(now.torque, expected, atol=1e-7 * np.abs(expected).max())


def test_joint_pd_towards_the_inverse_kinematics_of_the_robot_as_it_began():
    """Eq. 34; ``theta_d' = J^T (J J^T + d^2)^-1 (x_ref' + k (x_ref - x))`` of translation and rotation."""
    gains = {"kp": 20, "kd": 3, "ik_rate": 7, "ik_damping": 0.1}
    changes = {f"{TIP}.pid": None, f"{TIP}.amnesia": None, f"{TIP}.orientation_pid": {"kp": 0}}
    for now, _ in instants(changes | SENSED | {"robots.one.joint_pd": gains}):
        scene, model, desired = now.scene, now.scene.model, now.part("joint_pd.theta_d")
        joints = [model.joints[joint] for joint in scene.bodies[0].driven_joints]
        q, found = np.array(scene.q), []
        for joint, angle in zip(joints, desired, strict=True):
            turns, own = joint.nq == 2, now.state.q[joint.idx_q : joint.idx_q + joint.nq]
            q[joint.idx_q : joint.idx_q + joint.nq] = [np.cos(angle), np.sin(angle)] if turns else angle
            position = np.arctan2(own[1], own[0]) if turns else own[0]
            found.append(position + turns * 2 * np.pi * np.round((angle - position) / (2 * np.pi)))
        columns = [joint.idx_v for joint in joints]
        imagined = MechanicalState(model, q, np.zeros(model.nv)).frame(scene.tips[0].frame)
        jacobian = imagined.jacobian[:, columns]
        gap = pin.log3(now.wanted.rotation @ imagined.rotation.T)
        missing = np.r_[
            now.wanted.velocity + 7 * (now.wanted.position - imagined.position),
            now.wanted.angular_velocity + 7 * gap,
        ]
        rate = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 0.01 * np.eye(6), missing)
        np.testing.assert_allclose(now.part("joint_pd.theta_d", now.rate), rate, atol=1e-10)
        torque = 20 * (desired - read(scene, "joint_position", np.array(found)))
        torque -= 3 * read(scene, "joint_rate", now.state.v[columns])
        np.testing.assert_allclose(now.torque, torque[np.argsort(columns)], atol=1e-10)


def test_payload_feed_forward_is_the_wrench_that_moves_a_body_along_the_reference():
    mass, com, moments = 6, [0.1, -0.05, 0.2], [0.5, 0.6, 0.7, 0.02, -0.03, 0.04]
    payload = {"kind": "payload_feed_forward", "mass": mass, "com": com, "inertia": moments}
    changes = {f"{TIP}.pid": None, f"{TIP}.amnesia": None, "gravity": [0.2, 0.5, -3]}
    changes |= {f"{TIP}.controllers": {"own": payload | {"feed_forward": 0.8}}}
    xx, yy, zz, xy, xz, yz = moments
    body = pin.Inertia(mass, np.array(com), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    for now, _ in instants(changes):
        axes, wanted = now.wanted.rotation, now.wanted
        twist = pin.Motion(axes.T @ wanted.velocity, axes.T @ wanted.angular_velocity)
        pull = axes.T @ (wanted.acceleration - [0.2, 0.5, -3])
        spatial = pin.Motion(
            pull - np.cross(twist.angular, twist.linear), axes.T @ wanted.angular_acceleration
        )
        wrench = body * spatial + twist.cross(body * twist)
        wrench = np.r_[axes @ wrench.linear, axes @ wrench.angular]
        expected = 0.8 * now.tip.jacobian[:, now.columns].T @ wrench
        np.testing.assert_allclose(now.torque, expected, atol=1e-11 * np.abs(expected).max())


INERTIA, DAMPING, STIFFNESS = (5.0, 4.0, 3.0), (6.0, 9.0, 4.0), (40.0, 25.0, 60.0)
SELECTION, FORCE = (1.0, 0.0, 0.5), (2.0, 1.0, -1.0)
SPRING = {"inertia": INERTIA, "damping": DAMPING, "stiffness": STIFFNESS}
LAWS = {
    "impedance": SPRING,
    "admittance": SPRING,
    "hybrid_force": {"selection": SELECTION, "force": FORCE, "force_integral": 0.3},
}


def desired_acceleration(kind, now, turns):
    """Acceleration (3,) of a law of force with gains along the reference's axes."""
    scene, wanted, rows = now.scene, now.wanted, slice(3 * turns, 3 * turns + 3)
    felt = -now.outputs["grasp_torque" if turns else "grasp_force"][:3]
    pose, rate = ("tip_orientation", "tip_angular_velocity") if turns else ("tip_position", "tip_velocity")
    gap = -read(scene, pose, now.turned) if turns else wanted.position - read(scene, pose, now.tip.position)
    ahead = wanted.angular_acceleration if turns else wanted.acceleration
    speed = wanted.angular_velocity if turns else wanted.velocity
    gap_rate = speed - read(scene, rate, now.tip.velocity[rows])

    def along(values):
        return wanted.rotation @ np.diag(values) @ wanted.rotation.T

    name = "tip/controllers." + ("orientation_own" if turns else "own")
    if kind == "impedance":
        spring = along(STIFFNESS) @ gap
        if turns:  # the gradient of the energy by the rotation vector
            spring = np.linalg.solve(pin.Jexp3(-gap), spring)
        return ahead + np.linalg.solve(along(INERTIA), spring + along(DAMPING) @ gap_rate + felt)
    if kind == "hybrid_force":
        by_force = along(SELECTION)
        error = by_force @ (wanted.rotation @ FORCE + felt)
        np.testing.assert_allclose(now.part(f"{name}.integral", now.rate), error, atol=1e-10)
        push = 0.1 * error + 0.3 * by_force @ now.part(f"{name}.integral") + 20 * by_force @ gap_rate
        return ahead + push + (np.eye(3) - by_force) @ (20 * gap_rate + 100 * gap)
    offset, moving = (now.part(f"{name}.{part}") for part in ("offset", "rate"))
    load = felt - along(DAMPING) @ moving - along(STIFFNESS) @ offset
    acceleration = np.linalg.solve(along(INERTIA), load)
    np.testing.assert_allclose(now.part(f"{name}.rate", now.rate), acceleration, atol=1e-10)
    if turns:  # of the compliant frame, which the offset turns out of the reference
        turn = pin.exp3(offset)
        gap_rate = gap_rate - speed + pin.Jexp3(-offset) @ moving + turn @ speed
        gap = pin.log3(turn @ pin.exp3(gap))
    else:
        gap, gap_rate = gap + offset, gap_rate + moving
    return ahead + acceleration + 20 * gap_rate + 100 * gap


def law_of(kind):
    return {"kind": kind, "axes": "reference"} | LAWS[kind]


CONTROLLED = {
    **{f"{kind} of the translation": {"own": law_of(kind)} for kind in LAWS},
    **{f"{kind} of the rotation": {"orientation_own": law_of(kind)} for kind in LAWS},
    "both in a plane": {"own": law_of("impedance"), "orientation_own": law_of("impedance")},
}


@pytest.mark.parametrize("controllers", CONTROLLED.values(), ids=CONTROLLED)
def test_a_tip_accelerates_as_its_laws_of_force_say_though_base_and_target_react(controllers):
    """Laws of translation and rotation do not disturb each other, although the same joints move both."""
    changes = {f"{TIP}.pid": None, f"{TIP}.amnesia": None, f"{TIP}.controllers": controllers}
    turned = {"grasps.left.rotational_stiffness": 4, "grasps.left.rotational_damping": 0.6}
    text, sensed = PLANAR, {}  # a plane has fewer components than its sensors have errors
    if len(controllers) == 1:
        text, sensed = SPATIAL, {path: one for path, one in SENSED.items() if "tip_" in path}
    for now, _ in instants(changes | turned | sensed, text):
        found = now.tip.jacobian @ now.acceleration + now.tip.drift
        for key, law in controllers.items():
            turns = key == "orientation_own"
            axes = list(now.scene.rotation_axes if turns else now.scene.translation_axes)
            expected = desired_acceleration(law["kind"], now, turns)[axes]
            part = found[3 * turns : 3 * turns + 3][axes]
            np.testing.assert_allclose(part, expected, atol=1e-8 * np.abs(expected).max())
