"""Transmissions: two-inertia resonance, rigid limit on a floating base, balances, gradients, faults."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.linear import linearise
from spacerobot.pinocchio_engine import simulate as checked_by
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


@pytest.mark.parametrize("speed", [-9.0, 0.3, 4.0, 40.0])
def test_friction_of_a_motor_is_that_of_stribeck(speed):
    """Of a motor without torque whose gear is not deflected; it has the least friction where it slides."""
    friction = {"viscous": 1e-3, "coulomb": 0.02, "coulomb_speed": 0.5, "stribeck": 0.01, "stribeck_speed": 5}
    scene = geared("fixed", hold={"kp": 0.0, "kd": 0.0}, **friction)
    loop = build_closed_loop(scene)
    x, c = (part.full().ravel() for part in loop.setup(loop.parameter_values))
    names = list(loop.state_names)
    x[names.index("v.arm/joint_1")] = speed / GEAR["ratio"]
    place = names.index("arm/gears.momentum[0]")
    x[place] = GEAR["inertia"] * speed
    slow = 0.02 + 0.01 * np.exp(-((speed / 5) ** 2))
    expected = -1e-3 * speed - slow * speed / np.hypot(speed, 0.5)
    assert loop.dynamics(0, x, c).full().ravel()[place] == pytest.approx(expected, rel=1e-12)


def test_a_pattern_that_no_joint_matches():
    with pytest.raises(ScenarioError, match="no joint 'elbow'"):
        geared("fixed", joints="elbow")


PLAY, PUSH = 0.02, 1.0
"""Play of the gear [rad], and the torque that its motor is asked for, at the joint [N m]."""


def pushed(play=PLAY, push=PUSH, **gear):
    """An arm at rest whose motor begins in the middle of the play, with a constant torque."""
    blind = {
        "joint_position": {"scale": 0, "offset": float(np.radians(40) - push / KP)},
        "joint_rate": {"scale": 0},
    }
    robot = {"actuators": {"gears": GEAR | {"backlash": play} | gear}, "sensors": blind}
    return arm_scene(1, "fixed", robot=robot)


OPTIONS = {"duration_s": 0.6, "step_s": 0.005, "output_step_s": 0.1}


def test_backlash_is_free_flight_and_half_a_period_of_the_spring():
    """At rest in the middle: p = a t^2 / 2 up to b; then w^2 d = a (1 - cos w t) + v w sin w t, back to 0."""
    scene = pushed()
    run = build_rollout(build_closed_loop(scene), backend="interpreted", **OPTIONS).run()
    reflected = GEAR["ratio"] ** 2 * GEAR["inertia"]
    a = PUSH / reflected
    w = np.sqrt(GEAR["stiffness"] * (1 / inertia_of(scene)[0, 0] + 1 / reflected))
    flight = np.sqrt(PLAY / a)
    touching = 2 * (np.pi - np.arctan2(a * flight / w, a / w**2)) / w
    # undamped, it comes back as fast as it came: up to the middle of the play, and again
    expected = np.cumsum([flight, touching, 2 * flight, touching])
    loop = build_closed_loop(scene)
    assert [loop.events[one.event].name for one in run.events] == [
        "arm/joint_1.meshed.forward",
        "arm/joint_1.separated.forward",
    ] * 2
    np.testing.assert_allclose([one.time_s for one in run.events], expected, atol=1e-8)
    stored = sum(run.outputs[f"energy_{kind}"][:, 0] for kind in ("kinetic", "spring"))
    np.testing.assert_allclose(stored, run.outputs["work_actuator"][:, 0], atol=1e-9)
    assert np.abs(run.outputs["work_transmission"]).max() < 1e-12
    checked = checked_by(scene, output_step_s=0.1, duration_s=0.6)
    np.testing.assert_allclose([one.time_s for one in checked.happened], expected, atol=1e-8)


DAMPED = {"damping": 2.0, "viscous": 1e-4}


def test_teeth_press_and_never_pull():
    """Against two bodies by an integrator of its own, whose torque knows no switches."""
    scene = pushed(push=-PUSH, **DAMPED)
    loop = build_closed_loop(scene)
    run = build_rollout(loop, backend="interpreted", **OPTIONS).run()
    inertia, ratio, half = inertia_of(scene)[0, 0], GEAR["ratio"], PLAY / 2

    def law(p, rate):
        press = GEAR["stiffness"] * (np.abs(p) - half) + DAMPED["damping"] * np.sign(p) * rate
        return np.sign(p) * max(press, 0.0) if abs(p) > half else 0.0

    def slope(_, y):
        speed, rate, p = y
        t = law(p, speed / ratio - rate)
        net = -PUSH / ratio - t / ratio - DAMPED["viscous"] * speed
        return [net / GEAR["inertia"], t / inertia, speed / ratio - rate]

    found = solve_ivp(slope, (0, 0.6), [0, 0, 0], rtol=1e-9, atol=1e-12, max_step=1e-3)
    kinds = {loop.events[one.event].name.partition(".")[2] for one in run.events}
    assert kinds == {"meshed.backward", "separated.backward", "eased.backward"}
    np.testing.assert_allclose(run.outputs["motor_speed"][-1], found.y[0, -1], rtol=1e-6)
    stored = sum(run.outputs[f"energy_{kind}"][:, 0] for kind in ("kinetic", "spring"))
    booked = sum(sign * run.outputs[f"work_{name}"][:, 0] for name, sign in loop.works.items())
    np.testing.assert_allclose(stored, booked, atol=1e-8)
    assert run.outputs["work_transmission"][-1, 0] > 1e-3


def test_gradients_through_the_edges_of_backlash():
    """The torque jumps where teeth with a damper meet, and its events move with the parameters."""
    paths = [f"robots.arm.actuators.gears.{key}" for key in ("stiffness", "damping", "backlash", "inertia")]
    loop = build_closed_loop(pushed(**DAMPED))
    signals = Signals.of(loop)
    measures = Measures(signals, {"end": final(signals["motor_speed"])}, lambda r, p: {"x": r["end"][0]})
    rollout = build_rollout(loop, **OPTIONS, backend="interpreted", measures=measures)
    base = rollout.values()[rollout.indices(paths)]
    moved = 1e-5 * np.diag(base)
    ends = rollout.batch(paths, np.concatenate([base + moved, base - moved])).costs["x"]
    differences = (ends[:4] - ends[4:]) / (2e-5 * base)
    assert np.abs(differences * base).min() > 1e-2
    exact = rollout.value_and_gradient(wrt=paths)
    np.testing.assert_allclose(exact.gradients["x"], differences, rtol=1e-5)
    forward = rollout.jacobian(wrt=paths, outputs=["motor_speed"], accuracy=False).outputs["motor_speed"]
    np.testing.assert_allclose(np.array(forward)[-1].ravel(), differences, rtol=1e-5)


@pytest.mark.compiler
def test_backlash_in_lanes():
    """Each lane has events of its own, as the interpreted rollout has them."""
    loop = build_closed_loop(pushed(**DAMPED))
    path = "robots.arm.actuators.gears.backlash"
    rows = np.linspace(0.005, 0.05, 5)[:, None]
    batch = build_rollout(loop, **OPTIONS).batch([path], rows)
    single = build_rollout(loop, backend="interpreted", **OPTIONS)
    for i, row in enumerate(rows):
        run = single.run({path: row[0]})
        count = batch.events.count[i]
        assert count == len(run.events) > 0
        times = [one.time_s for one in run.events]
        np.testing.assert_allclose(batch.events.time_s[i, :count], times, atol=1e-9)
    assert len(set(batch.events.count)) > 1


def test_the_line_of_torque_over_speed():
    """The motor delivers what is asked until ``M (1 - s / W)`` is less; then it approaches W, not beyond."""
    stall, most = 0.03, 20.0
    limits = {"no_load_speed": most, "stall_torque": stall, "torque_limit": 0.025}
    scene = pushed(play=0.0, stiffness=1e4, damping=20.0, **limits)
    loop = build_closed_loop(scene)
    run = build_rollout(loop, **OPTIONS | {"duration_s": 4.0}, backend="interpreted").run()
    wanted = PUSH / GEAR["ratio"]
    (clipped,) = run.events
    assert loop.events[clipped.event].name == "arm/joint_1.clipped.forward"
    speeds, torques = run.outputs["motor_speed"][:, 0], run.outputs["motor_torque"][:, 0]
    at = clipped.before[list(loop.state_names).index("arm/gears.momentum[0]")] / GEAR["inertia"]
    assert at == pytest.approx(most * (1 - wanted / stall), rel=1e-9)
    np.testing.assert_allclose(torques, np.minimum(wanted, stall * (1 - speeds / most)), atol=1e-12)
    # I q'' + N J s'... as one body: dq'/dt = M N (1 - s / W) / (I + N^2 J)
    whole = inertia_of(scene)[0, 0] + GEAR["ratio"] ** 2 * GEAR["inertia"]
    constant = whole * most / (stall * GEAR["ratio"] ** 2)
    late = run.time > clipped.time_s + 1
    slope = np.polyfit(run.time[late], np.log(most - speeds[late]), 1)[0]
    assert slope == pytest.approx(-1 / constant, rel=1e-3)


def test_a_motor_driven_beyond_its_speed_brakes_up_to_its_torque_limit():
    limits = {"no_load_speed": 1.0, "stall_torque": 0.03, "torque_limit": 0.025}
    scene = geared_motion(geared("fixed", hold={"kp": 0.0, "kd": 0.0}, **limits))
    run = build_rollout(build_closed_loop(scene), backend="interpreted", **OPTIONS).run()
    speeds, torques = run.outputs["motor_speed"][:, 0], run.outputs["motor_torque"][:, 0]
    assert speeds[0] > 17
    assert torques[0] == -0.025  # 0.03 (1 - s) is far below
    line = np.clip(0, -0.03 * (1 + speeds), 0.03 * (1 - speeds))
    np.testing.assert_allclose(torques, np.clip(line, -0.025, 0.025), atol=1e-12)


@pytest.mark.parametrize("side", ["link", "motor"])
def test_encoders_on_both_sides_of_the_transmission(side):
    """Poles of two bodies under PD: stable with collocated sensor and actuator, unstable without.

    ``J' th'' = -K (th - q) - PD(y)``, ``I q'' = K (th - q)`` with J' = N^2 J; the polynomial of y = q lacks
    s^3, so that it has roots on the right (Routh); y = th is passive.
    """
    encoder = {"kind": "joint_encoder", "errors": None, "side": side}
    sensors = {"joint_position": encoder, "joint_rate": encoder}
    scene = arm_scene(1, "fixed", robot={"actuators": {"gears": GEAR}, "sensors": sensors})
    (found,) = linearise(scene, backend="interpreted")
    inertia, k = inertia_of(scene)[0, 0], GEAR["stiffness"]
    reflected = GEAR["ratio"] ** 2 * GEAR["inertia"]
    link, motor = np.polymul([reflected, 0, k], [inertia, 0, k]), np.array([KD, KP])
    seen = [k] if side == "link" else [inertia, 0, k]
    exact = np.roots(np.polyadd(np.polysub(link, [k * k]), np.polymul(motor, seen)))
    poles = np.array([pole for pole in found.poles if abs(pole) > 1e-6])
    np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex(exact), rtol=1e-8)
    assert (poles.real.max() > 0) == (side == "link")


def test_a_sampled_encoder_on_the_motor():
    """It holds the motor's angle by the ratio; the controller's torque is that of what it holds."""
    encoder = {"kind": "joint_encoder", "errors": {"period": 0.05}, "side": "motor"}
    sensors = {"joint_position": encoder, "joint_rate": {"kind": "linear", "scale": 0}}
    soft = GEAR | {"stiffness": 20.0}
    scene = arm_scene(1, "fixed", 20.0, robot={"actuators": {"gears": soft}, "sensors": sensors})
    loop = build_closed_loop(scene)
    options = {"duration_s": 0.3, "step_s": 0.005, "output_step_s": 0.05, "backend": "interpreted"}
    run = build_rollout(loop, **options).run()
    names = list(loop.state_names)
    bent = run.state[:, names.index("arm/gears.deflection[0]")]
    angle = run.state[:, 0] + bent
    asked = KP * (np.radians(40) - angle) / soft["ratio"]
    assert np.abs(bent[2:]).min() > 1e-4
    np.testing.assert_allclose(run.outputs["motor_torque"][1:-1, 0], asked[1:-1], atol=1e-12)


@pytest.mark.parametrize(
    ("robot", "message"),
    [
        ({"sensors": {"joint_rate": {"kind": "joint_encoder", "side": "motor"}}}, "without a transmission"),
        (
            {
                "actuators": {"gears": GEAR},
                "sensors": {"base_spin": {"kind": "joint_encoder", "side": "motor"}},
            },
            "what is no joint",
        ),
        ({"actuators": {"gears": GEAR | {"no_load_speed": 1}}}, "give `stall_torque` or `torque_limit` too"),
        ({"actuators": {"gears": GEAR | {"stall_torque": 1}}}, "give that too"),
        (
            {
                "actuators": {"gears": GEAR},
                "sensors": {"joint_rate": {"kind": "joint_encoder", "side": "motor"}},
                "tips": {"tip": {"pid": {"kp": 1, "kd": 1, "feedback": "base"}}},
            },
            "derivative: found ideal",
        ),
    ],
)
def test_faults_of_motors_and_encoders(robot, message):
    with pytest.raises(ScenarioError, match=message):
        arm_scene(1, "fixed", robot=robot)
