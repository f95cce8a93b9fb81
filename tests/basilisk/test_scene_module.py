"""A scene among Basilisk's modules; skipped without the package bsk.

Oracles: Basilisk's own spacecraft for a rigid base in the same environment, and impulses that follow from the
messages alone while an arm captures.
"""

import functools
import runpy
from pathlib import Path

import numpy as np
import pytest

import spacerobot as sr
from spacerobot.common.errors import ScenarioError

pytest.importorskip("Basilisk")

from Basilisk.architecture import messaging
from Basilisk.simulation import (
    extForceTorque,
    reactionWheelStateEffector,
    spacecraft,
    svIntegrators,
    thrusterDynamicEffector,
)
from Basilisk.utilities import simIncludeRW

from benchmarks.peers import basilisk as peer
from tests.basilisk.earth import START, with_earth
from tests.basilisk.flight_software import simulated, with_attitude_control

WHEELS = {
    "kind": "reaction_wheels",
    "axes": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "inertia": 0.5,
    "torque_limit": 20.0,
    "speeds": [5.0, -10.0, 3.0],
}
EXAMPLES = Path(__file__).parents[2] / "examples" / "basilisk"
PERIOD, DURATION = 0.05, 14.0


def state(message):
    payload = message.read()
    return np.concatenate([payload.r_BN_N, payload.v_BN_N, payload.sigma_BN, payload.omega_BN_B])


def rigid(duration=20.0):
    return peer.rigid_hub({}, duration)


def in_our_scene(period, *, extrapolated=True, duration=20.0):
    """Final state of a rigid base that Basilisk's environment moves."""
    craft = spacecraft.Spacecraft()
    effectors = with_earth(craft)
    options = {"period": period, "extrapolated": extrapolated, "backend": "interpreted"}
    module = sr.make_basilisk_scene(rigid(duration), spacecraft=craft, **options)
    simulated(period, duration, module, craft, *effectors)
    return state(module.scStateOutMsg)


@functools.cache
def in_basilisk(duration=20.0):
    """The same by Basilisk alone.

    Its environment modules run once a step, so that it converges in first order: two steps are extrapolated.
    """
    ends = []
    for period in (0.05, 0.025):
        craft = peer.spacecraft(rigid(duration))
        place, speed = np.ravel(craft.hub.r_CN_NInit), np.ravel(craft.hub.v_CN_NInit)
        effectors = with_earth(craft)
        craft.hub.r_CN_NInit = (START[0] + place).tolist()
        craft.hub.v_CN_NInit = (START[1] + speed).tolist()
        craft.setIntegrator(svIntegrators.svIntegratorRK4(craft))
        simulated(period, duration, craft, *effectors)
        ends.append(state(craft.scStateOutMsg))
    return 2 * ends[1] - ends[0]


def distances(one, other):
    return [np.linalg.norm(one[k : k + 3] - other[k : k + 3]) for k in (0, 3, 6, 9)]


def test_the_environment_moves_a_rigid_base_as_in_basilisk():
    """J2, drag, solar pressure and magnetic torque: position, velocity, attitude, spin after 20 s."""
    coarse, fine = in_our_scene(0.1), in_our_scene(0.05)
    ours, theirs = (4 * fine - coarse) / 3, in_basilisk()  # converges in second order
    quiet = rigid()
    drift = START[0] + 20.0 * START[1] + np.array(quiet.q[:3])
    assert np.linalg.norm(ours[:3] - drift) > 1000  # gravity
    assert max(distances(ours, theirs)) < 1e-7


@pytest.mark.parametrize(("extrapolated", "order"), [(True, 2), (False, 1)])
def test_order_of_the_coupling(extrapolated, order):
    ends = [in_our_scene(period, extrapolated=extrapolated) for period in (0.8, 0.4, 0.2)]
    for fine, coarse in zip(distances(ends[1], ends[2]), distances(ends[0], ends[1]), strict=True):
        assert 2**order * 0.9 < coarse / fine < 2**order * 1.15


@pytest.fixture(scope="module")
def capture():
    """A capture by the left arm while Basilisk's wheels hold the base and a force of Basilisk pushes it."""
    changes = {"robots.servicer.actuators": {"wheels": WHEELS}}
    craft, push = spacecraft.Spacecraft(), extForceTorque.ExtForceTorque()
    push.extForce_N = [[0.3], [-0.2], [0.1]]
    craft.addDynamicEffector(push)
    module = sr.make_basilisk_scene(
        sr.load_scene("capture", changes), spacecraft=craft, period=PERIOD, backend="interpreted"
    )
    chain = with_attitude_control(module)
    logs = [module.rwSpeedOutMsg.recorder(), module.scStateOutMsg.recorder()]
    logs += [chain[-1].rwMotorTorqueOutMsg.recorder(), module.scStateOutMsgs["target"].recorder()]
    simulated(PERIOD, DURATION, module, craft, push, *chain, *logs)
    return module.result(), logs


def test_the_arm_captures_under_basilisks_flight_software(capture):
    result, (_, states, *_) = capture
    assert [event["who"] for event in result.summary["events"] if event["kind"] == "captured"] == ["left"]
    assert result.summary["status"]["trusted"]
    assert np.abs(states.sigma_BN).max() < 0.1
    assert np.abs(states.sigma_BN[-1]).max() < 0.02


def test_messages_are_the_states_of_the_scene(capture):
    result, (_, states, _, target) = capture
    for log, body in ((states, "servicer"), (target, "target")):
        positions = result.data.body_position.sel(body=body)
        mine = positions.interp(time=log.times() * 1e-9).values
        np.testing.assert_allclose(log.r_BN_N, mine, atol=1e-9)


def test_linear_momentum_is_the_impulse_of_basilisks_force(capture):
    result, _ = capture
    data = result.data
    change = data.momentum_linear.values - data.momentum_linear.values[0]
    impulse = data.time.values[:, None] * np.array([0.3, -0.2, 0.1])
    np.testing.assert_allclose(change, impulse, atol=1e-9)


def test_angular_momentum_of_wheels_is_that_of_basilisks_motor_torques(capture):
    """J (Omega + a omega) from the messages of speeds and states; the torques that Basilisk commanded."""
    _, (speeds, states, torques, _) = capture
    momentum = WHEELS["inertia"] * (speeds.wheelSpeeds[:, :3] + states.omega_BN_B)
    impulse = np.cumsum(torques.motorTorque[:-1, :3], axis=0) * PERIOD
    assert np.abs(impulse).max() > 1
    np.testing.assert_allclose(momentum[1:] - momentum[0], impulse, atol=1e-8)


def test_angular_momentum_of_the_scene_is_the_moment_of_basilisks_force(capture):
    """Wheels are inside the scene: what they give the base they lose, also through the impact."""
    result, (_, states, *_) = capture
    data = result.data
    times = states.times() * 1e-9
    moments = np.cross(states.r_BN_N, [0.3, -0.2, 0.1])
    steps = (moments[1:] + moments[:-1]) / 2 * np.diff(times)[:, None]
    change = (data.momentum_angular - data.momentum_angular[0]).interp(time=times[1:]).values
    np.testing.assert_allclose(change, np.cumsum(steps, axis=0), atol=1e-6)


def test_joint_torques_and_forces_of_messages_act():
    """A joint torque is internal; a body force accelerates the whole mass along the base's axis."""
    changes = {
        "grasps": {},
        "target": None,
        "robots.servicer.tips": {},
        "robots.servicer.base": {"joint": "free_flyer", "rotation_deg": [0, 0, 90]},
        "robots.servicer.actuators": {"base": {"kind": "base_wrench"}},
        "simulation.duration": 2.0,
    }
    module = sr.make_basilisk_scene(sr.load_scene("servicer", changes), period=0.1, backend="interpreted")
    force = messaging.CmdForceBodyMsg().write(messaging.CmdForceBodyMsgPayload(forceRequestBody=[5.0, 0, 0]))
    torque = messaging.SingleActuatorMsg().write(messaging.SingleActuatorMsgPayload(input=0.4))
    module.cmdForceInMsg.subscribeTo(force)
    module.jointTorqueInMsgs["left_joint_1"].subscribeTo(torque)
    angle = module.jointStateOutMsgs["left_joint_1"].recorder()
    simulated(0.1, 2.0, module, angle)
    momentum = module.result().data.momentum_linear.values[-1]
    assert momentum[1] == pytest.approx(10.0, rel=2e-3)
    assert angle.state[-1] > angle.state[0] + 0.05


def test_state_effectors_are_refused(capfd):
    craft, wheels = spacecraft.Spacecraft(), simIncludeRW.rwFactory()
    wheels.create("Honeywell_HR16", [1, 0, 0], maxMomentum=50.0)
    effector = reactionWheelStateEffector.ReactionWheelStateEffector()
    wheels.addToSpacecraft("wheels", effector, craft)
    module = sr.make_basilisk_scene(rigid(), spacecraft=craft, backend="interpreted")
    with pytest.raises(RuntimeError):
        simulated(0.1, 0.2, module, craft, effector)
    assert "found state effectors" in capfd.readouterr().err


def test_wrong_names_are_named():
    with pytest.raises(ScenarioError, match="found 'x', allowed: servicer"):
        sr.make_basilisk_scene("capture", "x")
    with pytest.raises(ScenarioError, match="no floating base"):
        sr.make_basilisk_scene(sr.load_scene("capture", {"robots.servicer.base": {"joint": "fixed"}}))


def test_the_example_runs(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("SPACEROBOT_COMPILER", "none")
    example = runpy.run_path(str(EXAMPLES / "capture_in_orbit.py"))
    result = example["main"](duration_s=0.5, folder=tmp_path)
    assert result.summary["status"]["trusted"]
    assert "flew 3.8 km" in capsys.readouterr().out
    assert (tmp_path / "capture.html").exists()


def test_steps_repeat_to_the_bit():
    ends = [in_our_scene(0.4, duration=2.0) for _ in range(2)]
    assert ends[0].tobytes() == ends[1].tobytes()


def test_thrusters_of_basilisk_push_for_their_on_time():
    """Impulse of a thruster of 2 N that fires for 0.6 s of 2 s, along x."""
    changes = {"robots.servicer.base": {"joint": "free_flyer"}}
    craft, jets = spacecraft.Spacecraft(), thrusterDynamicEffector.ThrusterDynamicEffector()
    jet = thrusterDynamicEffector.THRSimConfig()
    jet.thrLoc_B, jet.thrDir_B, jet.MaxThrust, jet.updateOnly = (
        [[-1.0], [0], [0]],
        [[1.0], [0], [0]],
        2.0,
        True,
    )
    jets.addThruster(jet)
    command = messaging.THRArrayOnTimeCmdMsgPayload()
    command.OnTimeRequest = [0.6]
    message = messaging.THRArrayOnTimeCmdMsg().write(command)
    jets.cmdsInMsg.subscribeTo(message)
    craft.addDynamicEffector(jets)
    module = sr.make_basilisk_scene(
        peer.rigid_hub(changes, 2.0), spacecraft=craft, period=0.05, extrapolated=False, backend="interpreted"
    )
    simulated(0.05, 2.0, module, craft, jets)
    momentum = module.result().data.momentum_linear.values
    assert momentum[-1] - momentum[0] == pytest.approx([1.2, 0, 0], abs=1e-12)


@pytest.mark.parametrize(("side", "light"), [(1, 1.0), (-1, 0.0)])
def test_sunlight_ends_in_the_shadow_of_the_earth(side, light):
    """The Sun is on the x axis; the pressure is that of 4.56e-6 Pa at 1 AU on 5 m^2, reflected by 1.3."""
    craft = spacecraft.Spacecraft()
    effectors = with_earth(craft)
    craft.hub.r_CN_NInit, craft.hub.v_CN_NInit = [side * 6.758e6, 0.0, 0.0], [0.0, side * 7.68e3, 0.0]
    module = sr.make_basilisk_scene(rigid(), spacecraft=craft, period=0.1, backend="interpreted")
    simulated(0.1, 0.5, module, craft, *effectors)
    _, shadow, _, _, pressure, _ = effectors
    assert shadow.eclipseOutMsgs[0].read().shadowFactor == pytest.approx(light)
    force = np.ravel(pressure.forceExternal_N)
    assert force == pytest.approx([-light * 4.56e-6 * 5.0 * 1.3, 0, 0], abs=2e-7)
