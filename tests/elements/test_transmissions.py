"""Transmissions: two-inertia resonance, rigid limit on a floating base, balances, gradients, faults."""

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.errors import ScenarioError
from spacerobot.linear import linearise
from spacerobot.rollout import Measures, Signals, build_rollout, final
from tests.linear.scenes import KD, KP, arm_scene

GEAR = {"kind": "transmission", "ratio": 50.0, "inertia": 2e-4, "stiffness": 300.0}


def geared(base, *, links=1, hold=None, **gear):
    robot = {"actuators": {"gears": GEAR | gear}}
    return arm_scene(links, base, robot=robot, **(hold or {}))


def inertia_of(scene):
    mass = pin.crba(scene.model, scene.model.createData(), scene.q)
    return np.triu(mass) + np.triu(mass, 1).T


def with_rotors(scene, base):
    """Mass matrix with the rotor of one joint, T = J (N q' + w)^2 / 2, w the base's spin."""
    seen = np.zeros(scene.model.nv)
    seen[-1] = GEAR["ratio"]
    if base == "planar":
        seen[2] = 1
    return inertia_of(scene) + GEAR["inertia"] * np.outer(seen, seen)


def test_resonance_of_two_inertias():
    """On a fixed base: w^2 = K (1 / I + 1 / (N^2 J)), damped by D as a rate at the joint."""
    damping = 0.7
    scene = geared("fixed", hold={"kp": 0.0, "kd": 0.0}, damping=damping)
    (found,) = linearise(scene, backend="interpreted")
    inverse = 1 / inertia_of(scene)[0, 0] + 1 / (GEAR["ratio"] ** 2 * GEAR["inertia"])
    natural = np.sqrt(GEAR["stiffness"] * inverse)
    (mode,) = [mode for mode in found.modes if mode.pole.imag > 0]
    np.testing.assert_allclose(mode.frequency_hz * 2 * np.pi, natural, rtol=1e-9)
    np.testing.assert_allclose(mode.damping, damping * inverse / (2 * natural), rtol=1e-9)


@pytest.mark.parametrize("base", ["fixed", "planar"])
def test_the_rigid_limit_has_the_reflected_inertia(base):
    """Poles under PD approach those of the mass matrix with rotors, with an error of first order in 1 / K."""
    inertia = 1 / np.linalg.inv(with_rotors(geared(base), base))[-1, -1]
    exact = np.roots([inertia, KD, KP])
    exact = exact[exact.imag > 0][0]
    errors = []
    for stiffness in (1e4, 1e5, 1e6):
        (found,) = linearise(
            geared(base, stiffness=stiffness, damping=stiffness / 1e3), backend="interpreted"
        )
        errors.append(min(abs(mode.pole - exact) for mode in found.modes))
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 10, rtol=0.05)
    assert errors[-1] < 1e-3 * abs(exact)


def test_momentum_is_conserved_and_the_ledger_is_closed():
    scene = geared("planar", links=2, coulomb=0.02, viscous=1e-3, stribeck=0.01, torque_limit=0.1)
    loop = build_closed_loop(geared_motion(scene))
    options = {"duration_s": 1.0, "step_s": 0.002, "output_step_s": 0.1, "backend": "interpreted"}
    run = build_rollout(loop, **options).run()
    for kind in ("linear", "angular"):
        values = run.outputs[f"momentum_{kind}"]
        np.testing.assert_allclose(values, values[:1].repeat(len(values), axis=0), atol=1e-13)
    first = GEAR["ratio"] * np.radians([20, 0])  # nothing is deflected yet
    np.testing.assert_allclose(run.outputs["motor_speed"][0], first, atol=1e-12)
    stored = sum(run.outputs[f"energy_{kind}"][:, 0] for kind in ("kinetic", "spring"))
    booked = sum(sign * run.outputs[f"work_{name}"][:, 0] for name, sign in loop.works.items())
    np.testing.assert_allclose(stored - stored[0], booked, atol=1e-8)


def geared_motion(scene):
    """The same scene; its joints begin to move."""
    from spacerobot.scene import build_scene

    return build_scene(scene.scenario, {"robots.arm.joints.joint_1.rate_deg": 20}, source=scene.source)


def test_gradients_by_the_gear():
    paths = tuple(f"robots.arm.actuators.gears.{key}" for key in ("stiffness", "inertia", "ratio"))
    loop = build_closed_loop(geared_motion(geared("planar")))
    signals = Signals.of(loop)
    measures = Measures(
        signals, {"end": final(signals["body_position"][:2])}, lambda r, p: {"x": r["end"][0] + r["end"][1]}
    )
    options = {"duration_s": 0.1, "step_s": 0.01, "backend": "interpreted", "measures": measures}
    rollout = build_rollout(loop, **options)
    exact = rollout.value_and_gradient(wrt=paths)
    base = rollout.values()[rollout.indices(paths)]
    moved = 1e-4 * np.diag(base)
    ends = rollout.batch(paths, np.concatenate([base + moved, base - moved])).costs["x"]
    np.testing.assert_allclose(exact.gradients["x"], (ends[:3] - ends[3:]) / (2e-4 * base), rtol=1e-5)


def test_a_pattern_that_no_joint_matches():
    with pytest.raises(ScenarioError, match="no joint 'elbow'"):
        geared("fixed", joints="elbow")
