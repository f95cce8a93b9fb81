"""Laws that every kind of element must keep, whoever wrote it: the kinds come from the registry."""

from __future__ import annotations

import copy
import functools
import itertools

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

import spacerobot.elements as elements
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.elements.grasps.point import Point
from spacerobot.elements.references.rendezvous import Rendezvous
from spacerobot.pinocchio_engine import PinocchioLoop
from tests.oracles.motions import DesiredMotions
from tests.oracles.small_scenes import ONE_SPATIAL_ARM as SPATIAL
from tests.oracles.small_scenes import PLANAR, random_x, small_scene
from tests.oracles.small_scenes import SPATIAL as WITH_TWO


def network(*sizes):
    """Layers of a network with as many inputs and outputs as these, no weight of it near zero."""
    rng = np.random.default_rng(7)

    def weights(*shape):
        return (rng.uniform(0.3, 1, shape) * rng.choice([-1, 1], shape)).tolist()

    return [
        {"weights": weights(after, before), "biases": weights(after)}
        for before, after in itertools.pairwise(sizes)
    ]


NEEDS: dict[tuple[str, str], dict[str, object]] = {
    ("reference", "spline"): {
        "times": [0, 0.7, 1.5],
        "displacements": [[0, 0, 0], [0.1, 0, 0], [0, 0.05, 0]],
    },
    ("reference", "circle"): {"duration": 1.5, "rotation_deg": [0, 0, 20]},
    ("reference", "brake"): {"deceleration": 0.02, "spin_deceleration_deg": 2.0},
    ("reference", "rendezvous"): {
        "frame": "mate_2",
        "standoff": 0.3,
        "mated_deg": [0, 0, 15],
        "axis": [0.8, 0.6, 0],
        "approach_time": 0.7,
        "wait": 0.4,
        "closing_speed": 1.0,
        "end_distance": 0.02,
    },
    ("reference", "line"): {"duration": 1.5, "displacement": [0.1, -0.05, 0]},
    ("contact", "hunt_crossley"): {
        "stiffness": 300,
        "restitution": 0.6,
        "restitution_speed": 0.2,
        "friction": 0.4,
        "slip_velocity": 0.05,
    },
    ("tip_controller", "pid"): {"kp": 20, "ki": 5, "kd": 3},
    ("tip_controller", "impedance"): {
        "stiffness": [40, 25, 60],
        "damping": [6, 9, 4],
        "axes": "reference",
    },
    ("tip_controller", "admittance"): {
        "inertia": [5, 4, 3],
        "stiffness": [40, 25, 60],
        "damping": [6, 9, 4],
        "axes": "reference",
    },
    ("tip_controller", "hybrid_force"): {
        "selection": [1, 0, 0.5],
        "force": [2, 1, -1],
        "axes": "reference",
        "force_integral": 0.3,
    },
    ("tip_controller", "payload_feed_forward"): {
        "mass": 6,
        "com": [0.1, -0.05, 0.2],
        "inertia": [0.5, 0.6, 0.7, 0.02, -0.03, 0.04],
    },
    ("reference", "plan"): {
        "knots": {
            "times": [0, 0.4, 1, 1.6],
            "position": [[1.2, 0.1, 0], [1.21, 0.12, 0], [1.3, 0, 0], [1.2, 0.1, 0]],
            "velocity": [[0, 0, 0], [0.05, 0.02, 0], [0, -0.1, 0], [0, 0, 0]],
            "rotation": [[0, 0, 0.1], [0, 0, 0.2], [0, 0, 0], [0, 0, -0.1]],
            "spin": [[0, 0, 0], [0, 0, 0.1], [0, 0, -0.2], [0, 0, 0]],
        }
    },
    ("robot_controller", "joint_pd"): {"kp": 20, "kd": 3},
    ("robot_controller", "base_attitude"): {"kp": 40, "ki": 5, "kd": 20, "attitude_deg": [0, 0, 8]},
    ("robot_controller", "base_position"): {
        "kp": 30,
        "ki": 4,
        "kd": 25,
        "feed_forward": 0.8,
        "derivative": "filtered",
    },
    ("robot_controller", "resolved_rate"): {
        "gain": 3,
        "rate_gain": 12,
        "damping": 0.1,
        "keeps": "attitude",
        "payload_mass": 5,
        "payload_com": [0.1, -0.05, 0.2],
        "payload_inertia": [0.5, 0.6, 0.7, 0.02, -0.03, 0.04],
        "payload_fraction": 0.8,
    },
    ("robot_controller", "joint_tracking"): {
        "kp": 20,
        "kd": 3,
        "knots": {
            "times": [0, 0.2, 0.4, 0.8, 1.2],
            "points": 3,
            "joints": ["joint_3", "joint_1", "joint_2"],
            "position": [
                [0.6, 0.8, -1.2],
                [0.5, 0.9, -1.1],
                [0.7, 0.7, -1],
                [0.6, 0.7, -1],
                [0.8, 0.8, -1.2],
            ],
            "rate": [[0, 0, 0], [0.1, 0.2, 0.1], [0.2, -0.1, 0.3], [0.1, 0, 0], [0, 0, 0]],
            "effort": [[1, 2, 3], [0.5, -1, 2], [1, 1, -2], [1, 2, 0], [1, 0.5, 0.5]],
        },
    },
    ("robot_controller", "mpc"): {
        "kp": 20,
        "kd": 3,
        "begin": 0.1,
        "knots": {
            "times": [0, 0.8, 1.6],
            "points": 3,
            "joints": ["joint_3", "joint_1", "joint_2"],
            "position": [[0.6, 0.8, -1.2], [0.7, 0.7, -1], [0.8, 0.8, -1.2]],
            "rate": [[0, 0, 0], [0.2, -0.1, 0.3], [0, 0, 0]],
            "effort": [[1, 2, 3], [0.5, -1, 2], [1, 0.5, 0.5]],
        },
        "kd_linear": 20,
        "kd_angular": 3,
        "base_knots": {
            "times": [0, 0.8, 1.6],
            "points": 3,
            "axes": ["tz", "fx"],
            "wrench": [[1, 2], [0.5, -1], [1, 0.5]],
            "rate": [[0, 0], [0.1, 0.2], [0, 0]],
        },
    },
    # what it refuses and what its actions do is in tests/learning
    ("robot_controller", "policy"): {"held": True},
    ("robot_controller", "base_tracking"): {
        "kd_linear": 20,
        "kd_angular": 3,
        "knots": {
            "times": [0, 0.2, 0.4, 0.8, 1.2],
            "points": 3,
            "axes": ["tz", "fx"],
            "wrench": [[1, 2], [0.5, -1], [1, 1], [1, 2], [1, 0.5]],
            "rate": [[0, 0], [0.1, 0.2], [0.2, -0.1], [0.1, 0], [0, 0]],
        },
    },
    ("robot_controller", "neural"): {
        "inputs": [
            "joint_rate",
            "joint_position",
            "base_orientation",
            "target_orientation",
            "target_position",
        ],
        "outputs": ["joint_torque", "tip_force"],
        "scales": [3, 2],
        "frame": "mate_2",
        "layers": network(15, 3, 6),
    },
    ("actuator", "torque_limit"): {"limit": 2.5},
    ("actuator", "base_wrench"): {"force": 3, "torque": 2},
    # what a failed joint does is held to closed forms in test_joint_failure
    ("actuator", "joint_failure"): {"joint": "joint_2", "at": 5},
    # what it detects is held to closed forms in test_momentum_observer
    ("actuator", "momentum_observer"): {"allowance": 1e6},
    ("actuator", "thrusters"): {
        "thrust": 4,
        "nozzles": {
            "a": {"position": [0.3, 0.2, 0.1], "direction": [-1, 0, 0]},
            "b": {"position": [-0.3, 0.2, 0], "direction": [2, 1, 0], "thrust": 5},
            "c": {"position": [0.1, -0.2, 0.1], "direction": [0, -1, 0]},
        },
    },
    ("actuator", "reaction_wheels"): {
        "axes": [[0, 0, 1]],
        "inertia": 0.05,
        "torque_limit": 2,
        "speed_limit": 80,
        "viscous": 0.01,
        "coulomb": 0.02,
        "speeds": [3],
    },
    ("actuator", "transmission"): {
        "ratio": 5,
        "inertia": 0.01,
        "stiffness": 40,
        "damping": 0.3,
        "viscous": 0.02,
        "coulomb": 0.05,
        "stribeck": 0.03,
        "torque_limit": 1.5,
    },
    ("actuator", "wheel_joints"): {"joints": "rotor*", "torque_limit": 2, "speed_limit": 80, "coulomb": 0.02},
    ("sensor", "linear"): {"offset": 0.01, "scale": 1.1},
    # what errors do at instants is held to closed forms in test_sensor_errors
    ("sensor", "gyro"): {"offset": 0.01, "scale": 1.1, "errors": None},
    **{
        ("sensor", kind): {"offset": 0.01, "scale": 1.1, "errors": None}
        for kind in ("star_tracker", "joint_encoder", "camera_position", "camera_orientation", "force_torque")
    },
    ("estimator", "target_filter"): {"tip": "tip", "frame": "mate_2"},
    ("estimator", "inertia_filter"): {"tip": "tip", "frame": "mate_1"},
    ("estimator", "innovation_monitor"): {"filter": "known", "signal": "base_orientation"},
    ("environment", "orbit"): {
        "semi_major_axis": 8.0,
        "planet_radius": 0.5,
        "eccentricity": 0.3,
        "true_anomaly_deg": 40,
        "gravitational_parameter": 300,
    },
    ("flexible_link", "modes"): {
        "link": "base",
        "frequencies": [0.7, 1.1],
        "damping": [0.01, 0.02],
        "participation": [[0.9, 1.2, 0, 0, 0, 0.8], [0, 0, 0, 0, 0, 0.5]],
    },
    ("flexible_link", "beam"): {
        "link": "link_2",
        "end": [0.4, 0, 0],
        "segments": 2,
        "normal": [0, 0, 1],
        "bending_stiffness": 25,
        "damping_time": 0.02,
        "mass_per_length": 4,
    },
}
"""Values without which a section is not valid or does nothing."""

SECTIONS = [(family, kind) for family in elements.FAMILIES for kind in elements.kinds(family)]
KINDS = [(family, kind) for family, kind in SECTIONS if family not in ("shape", "estimator")]
"""Kinds with a law in continuous time; shapes have tests of their own in ``tests/shapes`` and
``tests/contacts``, estimators one file each."""
SCENES = {"planar": PLANAR, "spatial": SPATIAL}


PADS = {
    "ball": {"link": "two/tip", "kind": "sphere", "radius": 0.35, "position": [0.05, 0.02, 0]},
    "block": {"link": "one/tip", "kind": "box", "size": [0.5, 0.4, 0.6], "rotation_deg": [0, 0, 20]},
}
"""Shapes so large that they overlap in every random state."""


def changes(family, kind):
    """A scene in which one element is of this kind."""
    section = {"kind": kind} | NEEDS.get((family, kind), {})
    if family == "contact":
        touching = {"between": ["ball", "block"], "may_overlap": True}
        return {"pads": PADS, "contacts": {"own": section | touching}}
    if family == "shape":
        sizes = {"radius": 0.2, "length": 0.3}
        fields = elements.kinds(family)[kind].model_fields
        own = {"link": "one/tip"} | {key: value for key, value in sizes.items() if key in fields}
        return {"pads.own": section | own}
    if family == "reference":
        return {"robots.one.tips.tip.reference": section}
    if family == "tip_controller":
        return {"robots.one.tips.tip.controllers": {"own": section}}
    if family == "sensor":
        held = elements.kinds("sensor")[kind].holds
        if kind == "force_torque":
            soft = {"kind": "impedance", "stiffness": [40, 25, 60], "inertia": [5, 4, 3]}
            return {"robots.one.sensors.tip_force": section, "robots.one.tips.tip.controllers.soft": soft}
        return {f"robots.one.sensors.{'target_position' if held else 'joint_rate'}": section}
    if family == "estimator":
        return {"robots.one.estimators": {"own": section}}
    if family == "robot_controller":
        ideal = {"robots.one.actuators": {"ideal": {"kind": "base_wrench"}}}
        drives_base = kind.startswith("base_") or kind == "mpc"
        return {"robots.one.controllers": {"own": section}} | (ideal if drives_base else {})
    if family == "actuator":
        held = {"turn": {"kind": "base_attitude", "kp": 40, "kd": 20}}
        holds = {"robots.one.controllers": held} if elements.kinds(family)[kind].base_wrench else {}
        return {"robots.one.actuators": {"own": section}} | holds
    if family == "environment":
        return {"environment": {"own": section}}
    if family == "flexible_link":
        return {"robots.one.flexible": {"own": section}}
    still = {"robots.*.base.velocity": [0, 0, 0], "robots.*.base.spin_deg": [0, 0, 0]}
    still |= {"target.base.spin_deg": [0, 0, 0]}
    return still | {"grasps.left": {"tip": "one/tip", "frame": "mate_1"} | section}


def scene_of(family, kind, text=PLANAR):
    found = copy.deepcopy(changes(family, kind))
    if text is SPATIAL and kind == "rendezvous":
        found["robots.one.tips.tip.reference"] |= {"frame": "right", "mated_deg": [10, -20, 30]}
        found |= {"robots.one.sensors.target_position": {"offset": 0.01, "scale": 1.02}}
        found |= {"robots.one.sensors.target_spin": {"offset": 0.01, "scale": 0.9}}
    if text is SPATIAL and kind == "plan":
        turned = [[0.1, 0.2, 0.1], [0.5, -0.2, 0.2], [0.3, 0.2, 0.0], [0.1, 0.1, -0.1]]
        found["robots.one.tips.tip.reference"]["knots"] |= {"rotation": turned, "spin": turned[::-1]}
    if text is SPATIAL and kind in ("joint_tracking", "mpc"):
        knots = found["robots.one.controllers"]["own"]["knots"] | {
            "joints": ["slide", "round", "slant", "wrist"]
        }
        rows = {key: [[*row, 0.3] for row in knots[key]] for key in ("position", "rate", "effort")}
        found["robots.one.controllers"]["own"]["knots"] = knots | rows
    if text is SPATIAL and kind == "neural":
        found["robots.one.controllers"]["own"] |= {"layers": network(17, 3, 7), "frame": "right"}
    if text is SPATIAL and kind == "reaction_wheels":
        own = found["robots.one.actuators"]["own"]
        own |= {"axes": [[1, 0, 0.5], [0, 1, 0], [0.2, 0.3, 2], [1, 1, 1]], "speeds": [3, -2, 1, 0]}
    if text is SPATIAL and kind == "joint_failure":
        found["robots.one.actuators"]["own"]["joint"] = "slide"
    if kind == "wheel_joints":
        found["robots.one.urdf"] = "rotors.urdf" if text is PLANAR else "odd_rotors.urdf"
    if text is SPATIAL and kind == "modes":
        rows = [[0.9, 0.5, -1.2, 0.3, 0.4, 0.7], [0, 0, 0, 0.2, 0.3, 0.5]]
        found["robots.one.flexible"]["own"] |= {"position": [0.1, 0.2, 0.3], "participation": rows}
    if text is SPATIAL and kind == "beam":
        boom = {
            "link": "a",
            "end": [0.3, 0, 0],
            "normal": None,
            "mass_per_length": 1,
        }
        found["robots.one.flexible"]["own"] |= boom
    if text is SPATIAL and family == "grasp":
        found["grasps.left"]["frame"] = "left"
    if family == "grasp" and elements.kinds("grasp")[kind].fixes_position:
        rates = ["joint_1.rate_deg"] if text is PLANAR else ["slant.rate_deg", "slide.speed"]
        found |= {f"robots.one.joints.{rate}": 0 for rate in rates}
        if text is SPATIAL:
            found["target.joints.hinge.rate_deg"] = 0
    return small_scene(WITH_TWO if text is SPATIAL and family == "contact" else text, found)


@functools.cache
def built(family, kind, text):
    """Scene and closed loop, which no test changes."""
    scene = scene_of(family, kind, text)
    return scene, build_closed_loop(scene)


def state_of(scene, loop, seed):
    return random_x(scene, np.random.default_rng(seed), loop.nx)


@pytest.mark.parametrize("text", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize(("family", "kind"), KINDS)
def test_the_engines_agree(family, kind, text):
    """Mechanics and unknowns of the loop; the laws have tests of their own, one file each."""
    scene, loop = built(family, kind, text)
    engine = PinocchioLoop(scene)
    _, c = loop.setup(loop.parameter_values)
    assert engine.state_names == loop.state_names[scene.model.nq + scene.model.nv :]
    for seed in range(3):
        x, t = state_of(scene, loop, seed), 0.3 + 0.5 * seed
        rate = loop.dynamics(t, x, loop.at(t, x, c)).full().ravel()
        near = {"rtol": 1e-8, "atol": 1e-8 * np.abs(rate).max()}
        np.testing.assert_allclose(rate, engine.derivative(t, x), **near)


@pytest.mark.parametrize("text", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize(("family", "kind"), KINDS)
def test_momentum_and_energy_are_accounted_for_at_every_instant(family, kind, text):
    scene, loop = built(family, kind, text)
    _, c = loop.setup(loop.parameter_values)
    t, x = ca.SX.sym("t"), ca.SX.sym("x", loop.nx)
    c = loop.at(t, x, c)
    named = dict(zip(loop.outputs.name_out(), loop.outputs(t, x, c), strict=True))
    stored = named["energy_kinetic"] + named["energy_spring"] + named["energy_potential"]
    booked = sum(sign * named[f"work_{name}"] for name, sign in loop.works.items())
    kept = [named[f"momentum_{k}"] - named.get(f"impulse_{k}", ca.SX(3, 1)) for k in ("linear", "angular")]
    kept = ca.vertcat(stored - booked, *kept)
    flow = ca.jtimes(kept, x, loop.dynamics(t, x, c))
    powers = ca.vertcat(*(ca.jtimes(named[f"work_{n}"], x, loop.dynamics(t, x, c)) for n in loop.works))
    evaluate = ca.Function("kept", [t, x], [flow, powers])
    assert not loop.outside
    for seed in range(3):
        # springs hold their rest in c, so t enters only through references, which do no work by themselves
        found, works = (value.full().ravel() for value in evaluate(0.4, state_of(scene, loop, seed)))
        scale = 1 + np.abs(works).max()
        np.testing.assert_allclose(found / scale, 0, atol=1e-9)


OF_TIME = [kind for kind, one in elements.kinds("reference").items() if not issubclass(one, Rendezvous)]
"""References that follow nothing; ``test_approach`` differentiates one that follows the target."""


def carried(text):
    """A scene in which the target's reference, which turns, carries the tips."""
    turn = [0, 0, 40] if text is PLANAR else [20, -10, 40]
    way = {"kind": "circle", "duration": 1.5, "rotation_deg": turn}
    return small_scene(text, {"robots.*.tips.tip.reference": None, "target.reference": way})


@pytest.mark.parametrize("text", SCENES.values(), ids=SCENES)
@pytest.mark.parametrize("kind", [*OF_TIME, "of the target"])
def test_velocities_and_accelerations_of_a_reference_are_the_rates_of_its_pose(kind, text):
    scene = carried(text) if kind == "of the target" else scene_of("reference", kind, text)
    desired, h = DesiredMotions(scene), 1e-5
    for t in (0.33, 0.85, 1.25, 1.8):
        before, now, after = (desired.at(t + s * h, desired.x0)["one/tip"] for s in (-1, 0, 1))
        turn = pin.log3(after.rotation @ before.rotation.T) / (2 * h)
        np.testing.assert_allclose(now.velocity, (after.position - before.position) / (2 * h), atol=1e-8)
        np.testing.assert_allclose(now.acceleration, (after.velocity - before.velocity) / (2 * h), atol=1e-8)
        np.testing.assert_allclose(now.angular_velocity, turn, atol=1e-8)
        bend = (after.angular_velocity - before.angular_velocity) / (2 * h)
        np.testing.assert_allclose(now.angular_acceleration, bend, atol=1e-8)


@pytest.mark.parametrize(("family", "kind"), KINDS)
def test_derivatives_are_exact(family, kind):
    scene, loop = built(family, kind, PLANAR)
    x = state_of(scene, loop, 5)
    own = [
        i
        for i, path in enumerate(loop.parameter_paths)
        if path.startswith(tuple(changes(family, kind))) and loop.parameter_values[i] != 0
    ]
    values = np.array(loop.parameter_values)[own]
    p, varied = ca.SX(loop.parameter_values), ca.SX.sym("p", len(own))
    p[own] = varied
    _, c = loop.setup(p)
    rate = ca.Function("rate", [varied], [loop.dynamics(0.45, x, loop.at(0.45, x, c))])
    jacobian = ca.Function("jacobian", [varied], [ca.jacobian(rate(varied), varied)])(values).full()
    for k, step in enumerate(1e-5 * np.abs(values)):
        moved = step * np.eye(len(own))[k]
        difference = (rate(values + moved) - rate(values - moved)).full().ravel() / (2 * step)
        scale = 1 + np.abs(difference).max()
        np.testing.assert_allclose(jacobian[:, k] / scale, difference / scale, atol=1e-6)


def bounded_fields():
    """Numbers of every kind with one that is not allowed."""
    for family, kind in SECTIONS:
        for name, field in elements.kinds(family)[kind].model_fields.items():
            for rule in field.metadata:
                if hasattr(rule, "gt"):
                    yield family, kind, name, rule.gt
                elif hasattr(rule, "ge"):
                    yield family, kind, name, rule.ge - 1


@pytest.mark.parametrize(("family", "kind", "key", "bad"), list(bounded_fields()))
def test_a_number_out_of_range_is_refused_by_its_path(family, kind, key, bad):
    found = copy.deepcopy(changes(family, kind))
    place = next(path for path in found if "base" not in path and path != "pads")
    section = found[place].get("own", found[place])
    section[key] = bad
    inside = ".own" if "own" in found[place] else ""
    with pytest.raises(ScenarioError) as fault:
        small_scene(PLANAR, found)
    assert f"{place}{inside}.{key}" in str(fault.value)
    assert "allowed" in fault.value.message


@pytest.mark.parametrize(("family", "kind"), SECTIONS)
def test_every_field_has_a_description(family, kind):
    for name, field in elements.kinds(family)[kind].model_fields.items():
        assert field.description or name == "kind", name


def test_rigid_grasps_take_away_what_they_say():
    assert Point.fixes_position
    assert not Point.fixes_orientation
