"""Laws with a measured wrench: closed forms, passivity, margins, gradients, coupling, sampling."""

from __future__ import annotations

import functools

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.linear import margins
from spacerobot.pinocchio_engine.mechanical_state import MechanicalState
from tests.oracles.gantry import (
    CONTROLLERS,
    SPRING,
    gantry_scene,
    masses_in_line,
)
from tests.oracles.motions import DesiredMotions
from tests.oracles.small_scenes import random_x

INERTIA, DAMPING, STIFFNESS = 2.0, 5.0, 40.0
VIRTUAL = {"inertia": [INERTIA, 3, 1], "damping": [DAMPING, 1, 1], "stiffness": [STIFFNESS, 60, 1]}
KINDS = ("impedance", "admittance")
FORCE = {"kind": "hybrid_force", "selection": [1, 0, 0], "force": [3, 0, 0]}
PUSH = FORCE | {"force_gain": 0.3, "force_integral": 0.4, "force_damping": 4}
WALL = {
    "target.base.joint": "fixed",
    "target.base.close_grasp": None,
    "target.base.position": [0.4, 0.3, 0],
    "target.base.velocity": [0, 0, 0],
}
"""The target, held where the tip begins."""
SOFT = f"{CONTROLLERS}.soft"


def displacement(scene):
    tip = sr.simulate(scene, backend="interpreted").data.tip_position
    return tip.time.values, tip.values[:, 0, 0] - tip.values[0, 0, 0]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("base", ["planar", "fixed"])
def test_a_tip_that_is_struck_moves_as_the_desired_mass_spring_and_damper(kind, base):
    """Gantry, bridge and base take no part: the tip is a mass of 2 kg wherever the base goes."""
    times, moved = displacement(gantry_scene({"kind": kind} | VIRTUAL, {"robots.arm.base.joint": base}))
    expected = masses_in_line(INERTIA, DAMPING, STIFFNESS, times)[:, 0]
    assert np.abs(expected).max() > 0.05
    np.testing.assert_allclose(moved, expected, atol=1e-9)


def test_a_force_is_reached_and_kept_on_a_body_that_is_held():
    """``x''' = -k_v x'' + k_f f' + k_i (f_set + f)`` with ``f = -k x - d x'``: f becomes -f_set."""
    data = sr.simulate(gantry_scene(PUSH, WALL | {"simulation.duration": 12}), backend="interpreted").data
    rate = np.array(  # of x, x' and the integral
        [[0, 1, 0], [-0.3 * SPRING, -4 - 0.3 * 3, 0.4], [-SPRING, -3, 0]]
    )
    push, x = np.array([0, 0.3 * 3, 3]), np.zeros(3)
    steady = np.linalg.solve(rate, -push)
    values, vectors = np.linalg.eig(rate)
    parts = np.linalg.solve(vectors, x - steady)
    times = data.time.values
    expected = steady[0] + (np.exp(np.outer(times, values)) * parts) @ vectors[0]
    moved = data.tip_position.values[:, 0, 0] - data.tip_position.values[0, 0, 0]
    np.testing.assert_allclose(moved, expected.real, atol=1e-8)
    assert SPRING * moved[-1] == pytest.approx(3, abs=0.01)
    assert np.abs(np.diff(data.tip_position.values[:, 0, 1])).max() < 1e-12  # position across


@functools.cache
def port_rollout(kind):
    """Rollout of a gantry and a body that it holds; the test varies all numbers."""
    vary = ["target.base.velocity.1", "target.base.spin_deg.2"]
    loop = build_closed_loop(gantry_scene({"kind": kind} | VIRTUAL), vary)
    return sr.build_rollout(loop, duration_s=1.0, step_s=0.002, output_step_s=0.02, backend="interpreted")


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    masses=st.tuples(st.floats(0.5, 40), st.floats(0.2, 9)),
    grasp=st.tuples(st.floats(1, 900), st.floats(0, 30)),
    law=st.tuples(st.floats(0.5, 9), st.floats(0.1, 30), st.floats(0.1, 90)),
    kind=st.sampled_from(KINDS),
    velocity=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)),
    spin=st.floats(-20, 20),
)
def test_the_port_of_a_tip_is_passive_whatever_it_holds(masses, grasp, law, kind, velocity, spin):
    """Energy of the virtual mass and spring, of the grasp and the target together never grows."""
    inertia, damping, stiffness = law
    values = {
        "target.links.body.mass": masses[0],
        "target.links.body.inertia.2": masses[1],
        "target.links.body.inertia_at_mass": masses[0],  # so that the inertia is the drawn one
        "target.base.velocity.0": velocity[0],
        "target.base.velocity.1": velocity[1],
        "target.base.spin_deg.2": spin,
        "grasps.hold.stiffness": grasp[0],
        "grasps.hold.damping": grasp[1],
    }
    for i in range(2):
        values |= {f"{SOFT}.inertia.{i}": inertia, f"{SOFT}.damping.{i}": damping}
        values |= {f"{SOFT}.stiffness.{i}": stiffness}
    outputs = port_rollout(kind).run(values).outputs
    named = {name: value.reshape(len(value), -1) for name, value in outputs.items()}
    virtual = inertia * (named["tip_velocity"] ** 2).sum(axis=1)
    virtual += stiffness * (named["tip_error"] ** 2).sum(axis=1)
    momentum, place = named["body_momentum_linear"][:, 3:], named["body_position"][:, 3:]
    about_centre = named["body_momentum_angular"][:, 5] - (
        place[:, 0] * momentum[:, 1] - place[:, 1] * momentum[:, 0]
    )
    target = (momentum**2).sum(axis=1) / masses[0] + about_centre**2 / masses[1]
    energy = (virtual + target) / 2 + named["energy_spring"][:, 0]
    # where all but stands still, what is left of positions near 1 m is their rounding
    assert np.diff(energy).max() <= max(1e-7 * energy[0], 1e-28)


def test_two_arms_on_one_base_do_not_disturb_each_other():
    """Each tip accelerates by its impedance, less what the wrenches that sensors report would have done."""
    felt = np.r_[0.4, 0.4, 0.4, 0.1, 0.1, 0.1]  # without contact
    sensors = {"tip_force": {"offset": felt[0]}, "tip_torque": {"offset": felt[-1]}}
    alone = {"phases": {}, "grasps": {}, "contacts": {}, "robots.chaser.controllers": {}}
    scene = sr.load_scene("touch", alone | {"robots.chaser.sensors": sensors})
    desired, model = DesiredMotions(scene), scene.model
    x = random_x(scene, np.random.default_rng(1), len(desired.x0))
    state = MechanicalState(model, x[: model.nq], x[model.nq : model.nq + model.nv])
    acceleration = desired.rate(0.3, x)[model.nq : model.nq + model.nv]
    tips, rows = [state.frame(tip.frame) for tip in scene.tips], [0, 1, 5]  # of a plane
    reported = np.linalg.solve(state.inertia, sum(tip.jacobian.T @ felt for tip in tips))
    for tip, wanted in zip(tips, desired.at(0.3, x).values(), strict=True):
        gap = pin.log3(wanted.rotation @ tip.rotation.T)
        spring = np.r_[60 * (wanted.position - tip.position), 20 * np.linalg.solve(pin.Jexp3(-gap), gap)]
        damping = np.repeat([40, 6], 3) * (np.r_[wanted.velocity, wanted.angular_velocity] - tip.velocity)
        expected = (spring + damping + felt) / np.repeat([4, 0.5], 3) - tip.jacobian @ reported
        found = tip.jacobian @ acceleration + tip.drift
        np.testing.assert_allclose(found[rows], expected[rows], atol=1e-8 * np.abs(expected).max())


@pytest.mark.parametrize("inertia", [1.0, 30.0])
def test_margins_of_the_force_loop_are_those_of_its_transfer_function(inertia):
    """Target held: broken at the measured force, ``L = c k (m / M - 1) / (m s^2 + (m / M) (D s + K) + k)``.

    Of a fixed base: the moved mass m = 5.5 kg, and the grasp's ``k = k_g + d_g s``.
    """
    law = {"kind": "impedance", "inertia": [inertia] * 3, "damping": [9] * 3, "stiffness": [20] * 3}
    changes = WALL | {"robots.arm.base.joint": "fixed", "grasps.hold.damping": 0.5}
    found = margins(gantry_scene(law, changes), backend="interpreted")
    loop = next(one for one in found.loops[0] if one.name.startswith("measurement/arm/tip.tip_force"))
    mass, omega = 1.5 + 3.3 + 0.7, np.geomspace(1e-2, 1e3, 2000001)
    s = 1j * omega
    contact = SPRING + 0.5 * s
    transfer = contact * (mass / inertia - 1) / (mass * s**2 + mass / inertia * (9 * s + 20) + contact)
    crossings = np.flatnonzero(np.diff(np.sign(np.abs(transfer) - 1)))
    phases = np.pi + np.unwrap(np.angle(transfer))[crossings]
    delays = np.mod(phases, 2 * np.pi) / omega[crossings]
    np.testing.assert_allclose(loop.delay, delays.min() if len(delays) else np.inf, rtol=1e-4)


@pytest.mark.parametrize("section", [{"kind": kind} | VIRTUAL for kind in KINDS] + [PUSH])
@pytest.mark.parametrize("sampled", [None, {"period": 0.01, "delay": 0.004}], ids=["continuous", "sampled"])
def test_gradients_are_exact(section, sampled):
    changes = {f"{SOFT}.sampled": sampled, "simulation.duration": 0.4}
    loop = build_closed_loop(gantry_scene(section, changes))
    rollout = sr.build_rollout(loop, duration_s=0.4, step_s=0.005, backend="interpreted")
    keys = (
        ("force_gain", "force_integral", "force.0")
        if section is PUSH
        else ("inertia.0", "damping.0", "stiffness.0")
    )
    paths = [f"{SOFT}.{key}" for key in keys]
    jacobian = rollout.jacobian(wrt=paths, outputs=["tip_position"]).outputs["tip_position"]
    for k, path in enumerate(paths):
        value, step = loop.parameters()[loop.index(path)], 1e-4
        ends = [rollout.run({path: value * (1 + s * step)}).outputs["tip_position"] for s in (1, -1)]
        difference = (ends[0] - ends[1]) / (2 * step * value)
        scale = np.abs(difference).max()
        assert scale > 1e-7
        np.testing.assert_allclose(jacobian[..., k] / scale, difference / scale, atol=1e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_a_periodic_law_with_a_sampled_sensor_approaches_the_continuous_one(kind):
    errors = []
    for period in (0.004, 0.002):
        sensor = {"kind": "force_torque", "errors": {"period": period}}
        changes = {f"{SOFT}.sampled": {"period": period}, "robots.arm.sensors.tip_force": sensor}
        times, moved = displacement(gantry_scene({"kind": kind} | VIRTUAL, changes))
        errors.append(np.abs(moved - masses_in_line(INERTIA, DAMPING, STIFFNESS, times)[:, 0]).max())
    assert errors[0] < 2e-3
    assert errors[1] == pytest.approx(errors[0] / 2, rel=0.15)


def test_an_arm_with_too_few_joints_is_refused():
    changes = {"robots.arm.joints.across.locked": True}
    with pytest.raises(ScenarioError, match=r"controllers\.soft.*found 1 joints.*at least 2"):
        build_closed_loop(gantry_scene({"kind": "impedance"} | VIRTUAL, changes))
