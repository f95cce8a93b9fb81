"""Actuators: those of joints that ship, and kinds of a user's own that issue orders to joints and bases."""

from __future__ import annotations

import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine import PinocchioLoop
from spacerobot.rollout import build_rollout
from tests import forks
from tests.oracles.small_scenes import PLANAR, SPATIAL, random_x, small_scene


def run(script):
    """A script in a process of its own, so that its kinds stay out of other tests."""
    done = forks.run(script)
    assert done.returncode == 0, done.stderr


def rate_of(scene, seed=1):
    loop = build_closed_loop(scene)
    x = random_x(scene, np.random.default_rng(seed), loop.nx)
    return loop.dynamics(0.3, x, loop.setup(loop.parameter_values)[1]).full().ravel()


@pytest.mark.parametrize("text", [PLANAR, SPATIAL], ids=["planar", "spatial"])
def test_torque_limits_are_an_actuator_of_all_joints(text):
    most = {"robots.*.joints.*.torque_limit": 1.5}
    old = rate_of(small_scene(text, most | {"robots.*.torque_limits": True}))
    assert np.abs(old - rate_of(small_scene(text, most))).max() > 1e-3
    for own in ({"limit": 1.5}, {}):
        actuators = {"robots.*.actuators": {"motors": {"kind": "torque_limit"} | own}}
        np.testing.assert_array_equal(rate_of(small_scene(text, most | actuators)), old)


def test_limits_of_some_joints_act_one_after_the_other():
    motors = {"all": {"kind": "torque_limit", "limit": 2}, "last": {"kind": "torque_limit", "limit": 0.5}}
    motors["last"]["joints"] = "joint_3"
    scene = small_scene(PLANAR, {"robots.one.actuators": motors})
    loop, engine = build_closed_loop(scene), PinocchioLoop(scene)
    x = random_x(scene, np.random.default_rng(3), loop.nx)
    c = loop.setup(loop.parameter_values)[1]
    named = dict(zip(loop.outputs.name_out(), loop.outputs(0.3, x, c), strict=True))
    assert (np.abs(named["joint_torque"].full().ravel()[:3]) <= [2, 2, 0.5]).all()
    second = engine.derivative(0.3, x)
    first = loop.dynamics(0.3, x, c).full().ravel()
    np.testing.assert_allclose(first, second, atol=1e-9 * np.abs(second).max())
    assert "robots.one.actuators.last.limit" in loop.parameter_paths


@pytest.mark.parametrize(
    ("motor", "told"),
    [
        ({"joints": "elbow"}, r"robots.one.actuators.motor.joints: no joint 'elbow'; .*joint_1"),
        ({"kind": "torque"}, "robots.one.actuators.motor.kind: .*did you mean torque_limit"),
        ({"limit": 0}, "robots.one.actuators.motor.limit: found 0, allowed: above 0"),
    ],
)
def test_what_an_actuator_cannot_do_is_told_at_its_place(motor, told):
    with pytest.raises(ScenarioError, match=told):
        small_scene(PLANAR, {"robots.one.actuators": {"motor": {"kind": "torque_limit"} | motor}})


def test_the_assumption_of_unlimited_torques_goes_with_any_limit():
    told = "robots.one: torques are not limited; an actuator of kind torque_limit limits them"
    assert told in small_scene(PLANAR).assumptions
    motors = {"robots.one.actuators": {"motors": {"kind": "torque_limit", "limit": 3}}}
    assert told not in small_scene(PLANAR, motors).assumptions


WHEEL = """
from pathlib import Path
import numpy as np
import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.pinocchio_engine import PinocchioLoop
from tests.oracles.small_scenes import PLANAR, SPATIAL, small_scene

sr.load_plugin(Path("examples/plugins/reaction_wheel.py"))
for text, axis in ((PLANAR, [0, 0, 1]), (SPATIAL, [0.6, 0, 0.8])):
    wheels = {"x": {"kind": "reaction_wheel", "axis": axis, "inertia": 0.3}}
    scene = small_scene(text, {"robots.one.actuators": wheels})
    loop = build_closed_loop(scene)
    assert not loop.outside
    path = "robots.one.actuators.x.inertia"
    assert path in loop.parameter_paths
    result = sr.simulate(scene, backend="interpreted")
    assert abs(result.data.wheel_speed.sel(body="one")).max() > 1e-3
    assert result.data.wheel_speed.attrs["units"] == "rad/s"
    assert result.summary["ledger"]["energy"]["relative_residual"] < 1e-7, result.summary["ledger"]
    for kind in ("linear", "angular"):
        momentum = result.data[f"momentum_{kind}"].values
        assert np.abs(momentum - momentum[0]).max() < 1e-9, kind
    rollout = sr.build_rollout(loop, duration_s=0.4, step_s=0.004, backend="interpreted")
    slope = rollout.jacobian(wrt=[path], outputs=["tip_position"]).outputs["tip_position"][..., 0]
    ends = [rollout.run({path: 0.3 + s * 1e-4}).outputs["tip_position"] for s in (1, -1)]
    assert np.abs(slope - (ends[0] - ends[1]) / 2e-4).max() < 1e-6 * max(1e-2, np.abs(slope).max())
    engine = PinocchioLoop(scene)
    x = engine.normalise(engine.x0 + 0.01)
    rate = loop.dynamics(0.3, x, loop.setup(loop.parameter_values)[1]).full().ravel()
    assert np.abs(rate - engine.derivative(0.3, x)).max() < 1e-10 * np.abs(rate).max()
"""


def test_a_wheel_of_ones_own_conserves_momentum_and_energy():
    run(WHEEL)


ALONE = """
import tempfile
from pathlib import Path
import numpy as np
import spacerobot as sr
from spacerobot.scenario.load import validate
from spacerobot.scene import build_scene

sr.load_plugin(Path("examples/plugins/reaction_wheel.py"))
with tempfile.TemporaryDirectory() as folder:
    urdf = Path(folder) / "bus.urdf"
    urdf.write_text('<robot name="bus"><link name="bus"><inertial><mass value="20"/>'
        '<inertia ixx="2" iyy="2" izz="2" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>')
    base = {"joint": "free_flyer", "spin_deg": [0, 0, 10]}
    wheel = {"kind": "reaction_wheel", "gain": 3.0, "inertia": 0.1}
    robots = {"bus": {"urdf": str(urdf), "base": base, "actuators": {"w": wheel}}}
    scene = build_scene(validate({"robots": robots, "simulation": {"duration": 2, "step": 0.01}}))
    loop = sr.build_closed_loop(scene)
    rollout = sr.build_rollout(loop, duration_s=2, step_s=0.01, backend="interpreted")
    run = rollout.run()
    spin = np.radians(10) * np.exp(-3.0 * run.time / 2.0)
    assert np.abs(run.state[:, 12] - spin).max() < 1e-9
    momentum = 0.1 * np.radians(10) + 2.0 * (np.radians(10) - spin)
    speed = run.outputs["wheel_speed"].ravel()
    assert np.abs(speed - (momentum / 0.1 - spin)).max() < 1e-8
"""


def test_a_wheel_stops_a_lone_body_as_the_closed_form_says():
    """I w' = -k w, so w = w0 exp(-k t / I); the wheel takes up what the body loses."""
    run(ALONE)


OWN = '''
from typing import Literal
import casadi as ca
import spacerobot as sr
from spacerobot.elements import Actuator, Contribution, ActuatorDrive, State
from spacerobot.common.section import quantity

@sr.register
class Lag(Actuator):
    """Motors that follow what is asked with a lag."""
    kind: Literal["lag"] = "lag"
    time: float = quantity("s", "time constant", default=0.1, gt=0)
    def build(self, actuator):
        columns = tuple(actuator.columns.values())
        held = ca.SX.sym("held", len(columns))
        time, name = actuator.context.number("time"), f"{actuator.robot}/lag"
        def follow(asked):
            return Contribution(states=(State(name, held, ca.SX.zeros(len(columns)), (asked - held) / time),))
        return Contribution(drives=(ActuatorDrive(columns, lambda asked: held, follow),))

@sr.register
class Spinner(Actuator):
    """A joint that is spun by a torque of its own."""
    kind: Literal["spinner"] = "spinner"
    joint: str = "wheel"
    torque: float = quantity("N m", "torque", default=0.2)
    def build(self, actuator):
        torque = actuator.context.number("torque")
        return Contribution(drives=(ActuatorDrive((actuator.columns[self.joint],), lambda asked: torque),))
    def owns(self, joints):
        return [self.joint]

@sr.register
class Jets(Actuator):
    """Jets that push the base along its own x axis."""
    kind: Literal["jets"] = "jets"
    thrust: float = quantity("N", "thrust", default=0.5)
    def build(self, actuator):
        thrust = actuator.context.number("thrust")
        return Contribution(drives=(ActuatorDrive(actuator.base_columns[:1], lambda asked: asked + thrust),))
'''

LAG = """
import numpy as np
from spacerobot.closedloop import build_closed_loop
from tests.oracles.small_scenes import PLANAR, random_x, small_scene

plain, own = (small_scene(PLANAR, {"robots.one.actuators": found}) for found in ({}, {"m": {"kind": "lag"}}))
loops = [build_closed_loop(scene) for scene in (plain, own)]
x = random_x(own, np.random.default_rng(2), loops[1].nx)
places = [i for i, name in enumerate(loops[1].state_names) if "/lag" in name]
assert len(places) == 3
states = [np.delete(x, places), x]
rates, torques = [], []
for loop, state in zip(loops, states):
    c = loop.setup(loop.parameter_values)[1]
    rates.append(loop.dynamics(0.3, state, c).full().ravel())
    named = dict(zip(loop.outputs.name_out(), loop.outputs(0.3, state, c)))
    torques.append(named["joint_torque"].full().ravel()[:3])
assert np.abs(torques[1] - x[places]).max() < 1e-15
assert np.abs(rates[1][places] - (torques[0] - x[places]) / 0.1).max() < 1e-9 * np.abs(rates[1]).max()
jets = small_scene(PLANAR, {"robots.one.actuators": {"j": {"kind": "jets"}}})
loop = build_closed_loop(jets)
assert not loop.outside  # its impulse is booked
c, start = loop.setup(loop.parameter_values)[1], loop.setup(loop.parameter_values)[0].full().ravel()
rate = loop.dynamics(0, start, c).full().ravel()
import casadi as ca
xs = ca.SX.sym("x", loop.nx)
named = dict(zip(loop.outputs.name_out(), loop.outputs(0.0, xs, c)))
flow = ca.Function("f", [xs], [ca.jtimes(named["momentum_linear"], xs, loop.dynamics(0.0, xs, c))])
turn = np.radians(10)
assert np.abs(flow(start).full().ravel() - [0.5 * np.cos(turn), 0.5 * np.sin(turn), 0]).max() < 1e-9
"""


def test_a_motor_of_ones_own_is_told_what_controllers_ask_for():
    run(OWN + LAG)


OWNED = """
import tempfile
from pathlib import Path
import numpy as np
from spacerobot.scenario.load import validate
from spacerobot.scene import build_scene
from spacerobot.common.errors import SpaceRobotError

LINK = ('<link name="{}"><inertial><mass value="2"/>'
    '<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>')
JOINT = ('<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><origin xyz=".4 0 0"/>'
    '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>')
chain = (("wheel", "bus", "disc"), ("one", "bus", "a"), ("two", "a", "tip"))
urdf = "".join(LINK.format(n) for n in ("bus", "disc", "a", "tip")) + "".join(JOINT.format(*j) for j in chain)
with tempfile.TemporaryDirectory() as folder:
    file = Path(folder) / "bus.urdf"
    file.write_text(f'<robot name="bus">{urdf}</robot>')
    robot = {"urdf": str(file), "base": {"joint": "planar"}, "joint_pd": {"kp": 5, "kd": 1},
        "joints": {"two": {"angle_deg": 40}},
        "tips": {"tip": {"pid": {"kp": 9, "kd": 1},
            "reference": {"kind": "line", "displacement": [.1, 0, 0]}}}}
    def built(**more):
        scenario = {"robots": {"bus": robot | more}, "simulation": {"duration": 1, "step": 0.01}}
        return build_scene(validate(scenario))
    scene = built(actuators={"w": {"kind": "spinner"}})
    body = scene.bodies[0]
    assert [body.joint_name(scene.model, j) for j in body.driven_joints] == ["one", "two"]
    result = sr.simulate(scene, backend="interpreted")
    assert list(result.data.joint.values) == ["bus/one", "bus/two"]
    spun = result.data.v.sel(velocity="v.bus/wheel")
    assert spun[-1] > 0.5
    assert result.summary["ledger"]["energy"]["relative_residual"] < 1e-8
    for kind in ("linear", "angular"):
        assert np.abs(result.data[f"momentum_{kind}"]).max() < 1e-9
    try:
        built(actuators={"w": {"kind": "spinner", "joint": "one"}})
    except SpaceRobotError as fault:
        assert "robots.bus.actuators: one carries bus/tip, so no actuator may own it" in str(fault)
    else:
        raise AssertionError("not refused")
"""


def test_a_joint_that_an_actuator_owns_is_none_of_the_arms():
    run(OWN + OWNED)


SATURATED = {
    "joint": (
        """
robots:
  one:
    urdf: arm.urdf
    base: {joint: fixed}
    joints: {joint_1: {angle_deg: 50}, joint_2: {angle_deg: -70}}
    joint_pd: {kp: 9, kd: 6}
    tips: {tip: {reference: {kind: line, displacement: [0.1, 0.1, 0], duration: 0.2}}}
    actuators: {motors: {kind: torque_limit, limit: 0.35}}
simulation: {duration: 2}
""",
        "robots.one.actuators.motors.limit",
        "tip_position",
    ),
    "base": (
        """
robots:
  one:
    urdf: plate.urdf
    base: {joint: planar}
    controllers: {turn: {kind: base_attitude, kp: 6, kd: 1, attitude_deg: [0, 0, 60]}}
    actuators: {ideal: {kind: base_wrench, torque: 1.1}}
simulation: {duration: 2}
""",
        "robots.one.actuators.ideal.torque",
        "base_attitude_error",
    ),
    "thrusters": (
        """
robots:
  one:
    urdf: plate.urdf
    base: {joint: planar}
    controllers: {turn: {kind: base_attitude, kp: 6, kd: 1, attitude_deg: [0, 0, 60]}}
    actuators:
      jets:
        kind: thrusters
        thrust: 2.0
        nozzles:
          left: {position: [0.3, 0, 0], direction: [0, 1, 0]}
          right: {position: [0.3, 0, 0], direction: [0, -1, 0]}
          other: {position: [-0.3, 0, 0], direction: [0, 1, 0]}
          last: {position: [-0.3, 0, 0], direction: [0, -1, 0]}
simulation: {duration: 2}
""",
        "robots.one.actuators.jets.thrust",
        "base_attitude_error",
    ),
}


@pytest.mark.parametrize("which", SATURATED)
def test_steps_end_where_actuators_saturate(which):
    """Derivatives by a limit do not depend on the step, and are those of finite differences."""
    text, path, output = SATURATED[which]
    loop = build_closed_loop(small_scene(text))
    value, found = loop.parameters()[loop.index(path)], []
    for step in (0.05, 0.0125):
        rollout = build_rollout(loop, duration_s=2.0, step_s=step, output_step_s=1.0, backend="interpreted")
        slopes = rollout.jacobian(wrt=[path], outputs=[output], accuracy=False)
        found.append(slopes.outputs[output][-1, ..., 0].ravel())
    assert {loop.events[fired.event].kind for fired in slopes.trajectory.events} == {"clipped", "unclipped"}
    ends = [rollout.run({path: value * (1 + sign * 1e-4)}).outputs[output][-1] for sign in (1, -1)]
    difference = (ends[0] - ends[1]).ravel() / (2e-4 * value)
    assert np.abs(difference).max() > 1e-2
    np.testing.assert_allclose(found[1], difference, atol=2e-5 * np.abs(difference).max())
    np.testing.assert_allclose(found[0], found[1], atol=1e-3 * np.abs(difference).max())
