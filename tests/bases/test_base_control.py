"""Controllers of bases: what they ask for, against closed forms, and what they refuse."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.errors import ScenarioError
from tests.oracles.small_scenes import PLANAR, random_x, small_scene

ALONE = """
robots:
  one:
    urdf: {urdf}
    base: {{joint: {base}, spin_deg: {spin}}}
    joints: {joints}
    tips: {{tip: {{pid: {{kp: 30, ki: 20, kd: 4}}, reference: {{kind: circle, radius: 0.08, duration: 2}}}}}}
    controllers: {{turn: {{kind: base_attitude, kp: 50, ki: 8, kd: 30}}}}
    actuators: {{ideal: {{kind: base_wrench}}}}
simulation: {{duration: 2, step: 0.004, output_step: 0.1}}
"""
"""One arm that moves its tip, with nothing in its hand."""

FLAT = ALONE.format(
    urdf="arm.urdf", base="planar", spin=[0, 0, 2], joints="{joint_1: {angle_deg: 50}, joint_2: {angle_deg: -70}}"
)
DEEP = ALONE.format(
    urdf="odd_arm.urdf", base="free_flyer", spin=[2, -1, 3], joints="{slant: {angle_deg: 20}, round: {angle_deg: -50}}"
)


def inertia_at_start(scene):
    """Of the robot about its centre of mass, axes of the base (3, 3), by Pinocchio."""
    q = np.array(scene.q)
    data = scene.model.createData()
    pin.ccrba(scene.model, data, q, np.zeros(scene.model.nv))
    rotation = pin.framesForwardKinematics(scene.model, data, q)
    rotation = data.oMf[scene.robots[0].root_frame].rotation
    return rotation.T @ data.Ig.inertia @ rotation


def motion_at(scene, loop, x, t=0.4):
    """Rates, and outputs by name, at a state."""
    c = loop.setup(loop.parameter_values)[1]
    found = loop.outputs(t, x, c)
    named = {name: value.full().ravel() for name, value in zip(loop.outputs.name_out(), found, strict=True)}
    return loop.dynamics(t, x, c).full().ravel(), named


@pytest.mark.parametrize("text", [FLAT, DEEP], ids=["planar", "spatial"])
def test_a_base_feels_its_pid_alone_whatever_the_arm_does(text):
    """J w' = K_p e + K_i int(e) - K_d w, and m a = the same of its position, at any state."""
    hold = {"kind": "base_position", "kp": 70, "ki": 5, "kd": 90}
    for controllers in ({}, {"robots.one.controllers.stay": hold}):
        scene = small_scene(text, controllers)
        loop, model = build_closed_loop(scene), scene.model
        flat = scene.planar
        inertia, mass = inertia_at_start(scene), pin.computeTotalMass(model)
        base = model.joints[1]
        for seed in range(2):
            x = random_x(scene, np.random.default_rng(seed), loop.nx)
            rate, named = motion_at(scene, loop, x)
            data = model.createData()
            q, v = pin.normalize(model, x[: model.nq]), x[model.nq : model.nq + model.nv]
            pin.forwardKinematics(model, data, q, v, rate[model.nq : model.nq + model.nv])
            rotation = data.oMi[1].rotation
            axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            moving = pin.getVelocity(model, data, 1, axes)
            going = pin.getClassicalAcceleration(model, data, 1, axes)
            integral = {n: x[i] for i, n in enumerate(loop.state_names) if ".integral" in n}
            own = [np.array([value for n, value in integral.items() if key in n]) for key in ("turn", "stay")]
            if flat:
                own = [np.r_[0, 0, own[0]], np.r_[own[1], 0] if len(own[1]) else own[1]]
            pid = 50 * named["base_attitude_error"][:3] + 8 * own[0] - 30 * moving.angular
            turned = rotation @ inertia @ rotation.T @ going.angular
            rows = [2] if flat else [0, 1, 2]
            scale = np.abs(turned).max() + np.abs(pid).max()
            np.testing.assert_allclose(turned[rows] / scale, pid[rows] / scale, atol=1e-10)
            if controllers:
                pid = 70 * named["base_position_error"][:3] + 5 * own[1] - 90 * moving.linear
                scale = mass * np.abs(going.linear).max() + np.abs(pid).max()
                np.testing.assert_allclose(mass * going.linear / scale, pid / scale, atol=1e-10)
        
