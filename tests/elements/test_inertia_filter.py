"""Inertia filter: against one batch of weighted least squares, consistency, both engines, errors."""

import functools
import itertools
import tempfile
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import chi2

import spacerobot as sr
from optim.evaluation import build_quantity_rollout
from optim.identification import momentum_regressor
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine import simulate
from spacerobot.quantities import find_quantity
from spacerobot.rollout import build_rollout
from tests.oracles import one_arm
from tests.oracles.small_scenes import SPATIAL, small_scene

PERIOD, DRAW = 0.05, "simulation.noise_draw"
NOISE = {"velocity_noise": 1e-4, "spin_noise": 2e-5, "rate_noise": 1e-4}
ASSUMED = {"mass": 8, "com": [0, 0, 0], "inertia": [0.5, 0.7, 1.2, 0, 0, 0]}
FILTER = {"kind": "inertia_filter", "period": PERIOD, "com_deviation": 0.2} | ASSUMED


@functools.cache
def folder():
    keep = tempfile.TemporaryDirectory(prefix="inertia_filter_")
    weld = {"tip": "arm/tip", "frame": "mate_1", "kind": "weld"}
    one_arm.write(Path(keep.name), grasps={"left": weld})
    return keep


def sampled(noise, period=PERIOD):
    return {"errors": {"period": period, "noise": noise * period**0.5}}


SENSORS = {
    "base_velocity": sampled(1e-4),
    "base_spin": sampled(2e-5),
    "joint_rate": sampled(1e-4),
    "joint_position": sampled(1e-6),
    "base_orientation": sampled(1e-6),
    "base_position": sampled(1e-6),
}


def flat(changes=None, *, sensors=None, **section):
    """An arm that carries an object on a circle, which is heavier than assumed and out of balance."""
    own = FILTER | {"tip": "tip", "frame": "mate_1"} | section
    heavier = {"target.links.body.mass": 12, "target.links.body.com": [0.03, -0.02, 0]}
    held = {"robots.arm.estimators": {"held": own}, "robots.arm.sensors": sensors or {}}
    return sr.load_scene(Path(folder().name) / "small.yaml", heavier | held | (changes or {}))


def deep():
    """An arm of four odd joints that carries a box in space."""
    box = SPATIAL[: SPATIAL.index("  two:")] + SPATIAL[SPATIAL.index("target:") :]
    box = box[: box.index("  right:")] + box[box.index("simulation:") :]
    return small_scene(
        box.replace("compliant, stiffness: 90, damping: 7", "weld").replace(", rate_deg: 2", ""),
        {
            "target.joints.hinge": {"angle_deg": 15, "locked": True},
            "robots.one.joints.slide.speed": 0,
            "target.base.spin_deg": [0, 0, 0],
            "robots.one.estimators": {"held": FILTER | NOISE | {"tip": "tip", "frame": "left"}},
        },
    )


def rolled(scene, duration_s, **options):
    steps = {"step_s": 0.01, "output_step_s": PERIOD, "backend": "interpreted"} | options
    return build_rollout(build_closed_loop(scene), duration_s=duration_s, **steps)


def jacobian_of_parameters(named):
    """Derivative of Pinocchio's ten parameters by mass, centre and inertia: exact for cubic polynomials."""

    def parameters(x):
        xx, yy, zz, xy, xz, yz = x[4:]
        about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        c = x[1:4]
        about = about + x[0] * (c @ c * np.eye(3) - np.outer(c, c))
        return np.array([x[0], *(x[0] * c), *about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])

    def slope(step):
        ends = [(parameters(named + d) - parameters(named - d)) / (2 * step) for d in step * np.eye(10)]
        return np.array(ends).T

    return parameters(named), (4 * slope(0.05) - slope(0.1)) / 3


def batch_estimate(scene, q, v, means, tip, base, columns, rows):
    """All instants at once: weighted normal equations by Pinocchio, weights of the estimates so far."""
    model = scene.model.copy()
    target = scene.target.root_joint
    mate = model.frames[scene.grasps[0].frame].placement
    model.inertias[target] = pin.Inertia.Zero()
    data = model.createData()
    place, axes = -mate.rotation.T @ mate.translation, mate.rotation.T
    inertia = np.array([[0.5, 0, 0], [0, 0.7, 0], [0, 0, 1.2]])
    named = np.zeros(10)
    named[0], named[1:4] = 8, place
    turned = axes @ inertia @ axes.T
    named[4:] = turned[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    assumed, slope = jacobian_of_parameters(named)
    mean_moment = 1.2 if len(columns) == 4 else 0.8
    deviation = np.array([4, 0.2, 0.2, 0.2, *[0.5 * mean_moment] * 6])
    places = {4: [0, 1, 2, 6], 10: range(10)}[len(columns)]
    own = slope[np.ix_(columns, list(places))]
    prior = np.linalg.inv(own @ np.diag(deviation[list(places)] ** 2) @ own.T)
    count, size = len(columns), len(columns) + len(rows)
    information, vector = np.zeros((size, size)), np.zeros(size)
    information[:count, :count] = prior
    variances = np.full(model.nv, NOISE["rate_noise"] ** 2)
    linear = 2 if len(rows) == 3 else 3
    variances[base] = [NOISE["velocity_noise"] ** 2] * linear + [NOISE["spin_noise"] ** 2] * (
        3 if linear == 3 else 1
    )
    hidden = [i for i in range(model.nv) if model.joints[target].idx_v <= i]
    variances[hidden] = 0
    for k, (position, velocity) in enumerate(zip(q, v, strict=True)):
        pin.crba(model, data, position)
        pin.forwardKinematics(model, data, position)
        matrix = np.triu(data.M) + np.triu(data.M, 1).T
        robot = matrix[base].copy()
        robot[:, hidden] = 0
        jacobian = pin.computeFrameJacobian(model, data, position, tip, pin.ReferenceFrame.LOCAL)
        twist, back = jacobian @ velocity, jacobian[:, base].T
        regressor = back @ momentum_regressor(twist[:3], twist[3:])[:, columns]
        total = data.oMi[1].inverse().toDualActionMatrix()[np.ix_(rows, rows)]
        body = assumed.copy()
        body[columns] = assumed[columns] if k == 0 else means[k]
        momenta = pin.Inertia.FromDynamicParameters(body).matrix()
        whole = robot + back @ momenta @ jacobian
        weight = np.linalg.inv(whole @ np.diag(variances) @ whole.T)
        row = np.hstack([regressor, -total])
        left = -robot @ velocity - regressor @ assumed[columns]
        bias = sum(
            variances[j]
            * (back @ momentum_regressor(*np.split(jacobian[:, j], 2))[:, columns]).T
            @ weight
            @ whole[:, j]
            for j in range(model.nv)
        )
        information += row.T @ weight @ row
        vector += row.T @ weight @ left + np.append(bias, np.zeros(len(rows)))
    covariance = np.linalg.inv(information)
    return assumed[columns] + (covariance @ vector)[:count], covariance[:count, :count]


@pytest.mark.parametrize("where", ["plane", "space"])
def test_it_is_the_batch_estimate_of_all_instants_so_far(where):
    if where == "plane":
        scene, columns, rows = flat(**NOISE), [0, 1, 2, 9], [0, 1, 5]
        robot, base = "arm", [0, 1, 2]
    else:
        scene, columns, rows = deep(), list(range(10)), list(range(6))
        robot, base = "one", list(range(6))
    rollout = rolled(scene, 0.6, output_step_s=PERIOD / 2)
    run = rollout.run()
    names, model = rollout.loop.state_names, scene.model
    label = f"{robot}/held"

    def state(name):
        """After the event of each instant."""
        return run.state[1::2, [i for i, own in enumerate(names) if own.startswith(f"{label}.{name}[")]]

    q, v = run.state[:-1:2, : model.nq], run.state[:-1:2, model.nq : model.nq + model.nv]
    tip = scene.tips[0].frame
    means = [None, *state("mean")[:-1]]
    for count in (len(q) // 2, len(q)):
        found, covariance = batch_estimate(
            scene, q[:count], v[:count], means[:count], tip, base, columns, rows
        )
        np.testing.assert_allclose(state("mean")[count - 1], found, rtol=1e-7, atol=1e-7)
        own = state("covariance")[count - 1]
        wanted = covariance[np.triu_indices(len(columns))]
        np.testing.assert_allclose(own, wanted, rtol=1e-5, atol=1e-7)


def test_without_noise_it_finds_the_object():
    result = sr.simulate(
        flat({"simulation.step": 0.05}, **{key: 1e-2 * noise for key, noise in NOISE.items()}),
        backend="interpreted",
    )
    assert np.nanmax(np.abs(result.array("held_mass_error")[-1])) < 1e-3 * 12
    assert np.nanmax(np.abs(result.array("held_com_error")[-1])) < 1e-4
    assert np.nanmax(np.abs(result.array("held_moments_error")[-1])) < 1e-2
    assert np.nanmax(np.abs(result.array("held_mass_error")[0])) == 4


@pytest.mark.compiler
def test_errors_are_as_large_as_the_covariance_says():
    """NEES inside its 95 % bounds over 300 draws, from an assumption that is right and hardly trusted."""
    scene = flat(sensors=SENSORS, mass=None, com=None, inertia=None)
    found = sr.batch(scene, ["held_nees"], {DRAW: np.arange(300.0)}).data
    values = found["held_nees"].values.ravel()
    low, high = chi2.ppf([0.025, 0.975], 4 * len(values)) / len(values)
    assert low < values.mean() < high


def test_both_engines_estimate_the_same():
    """Velocities that differ by a 1e-4 of the noise move estimates by no more of their deviation."""
    scene = flat(sensors=SENSORS)
    rollout = rolled(scene, 0.4, output_step_s=0.2)
    run, other = rollout.run(), simulate(scene, duration_s=0.4, output_step_s=0.2)
    own = [i for i, name in enumerate(rollout.loop.state_names) if name.startswith("arm/held.")]
    rest = np.setdiff1d(np.arange(run.state.shape[1]), own)
    np.testing.assert_allclose(run.state[:, rest], other.state[:, rest], rtol=1e-6, atol=1e-7)
    mean, spread = own[:4], [own[4 + i] for i in (0, 4, 7, 9)]
    away = np.abs(run.state[-1, mean] - other.state[-1, mean]) / np.sqrt(run.state[-1, spread])
    assert away.max() < 1e-3
    assert np.abs(run.state[-1, mean] - run.state[0, mean]).max() > 1


def test_feed_forward_commands_what_the_estimate_takes():
    """As of an object that is given: the numbers of the assumption, moved to the axes of the tip."""
    payload = {"kind": "payload_feed_forward"}
    scene = flat(**NOISE)
    mate = scene.model.frames[scene.grasps[0].frame].placement
    place = -mate.rotation.T @ mate.translation
    given = payload | {"mass": 8, "com": place.tolist(), "inertia": [0.5, 0.7, 1.2, 0, 0, 0]}
    rates = []
    for own in (payload, given, payload | {"feed_forward": 0}):
        loop = build_closed_loop(flat({"robots.arm.tips.tip.controllers": {"own": own}}, **NOISE))
        x, c = loop.setup(loop.parameter_values)
        rates.append(loop.dynamics(0.3, x, loop.at(0.3, x, c)).full().ravel())
    np.testing.assert_allclose(rates[0], rates[1], rtol=1e-12, atol=1e-12)
    assert np.abs(rates[0] - rates[2]).max() > 1e-3


TURNS = {
    name: {
        "robots": {"servicer": {"tips": {"left_tip": {"reference": {
            "kind": "line", "rotation_deg": turn, "displacement": way, "duration": duration}}}}},
        "until": {"time": duration},
    }
    for name, turn, way, duration in (
        ("roll", [8, 0, 0], [0, 0.05, 0.05], 2.0),
        ("pitch", [0, 8, 0], [0.05, 0, -0.05], 2.0),
        ("yaw", [0, 0, 8], [-0.05, -0.05, 0], 2.0),
        ("carry", [-4, -6, 5], [-0.05, 0.05, 0.05], 3.0),
    )
}  # fmt: skip


def carrying(**section):
    """Rollout in which a satellite 40 % heavier than assumed is carried."""
    held = {"kind": "inertia_filter", "tip": "left_tip", "frame": "mate_left", "period": 0.25, "mass": 100}
    held |= {"com": [0, 0, 0], "inertia": [20.33, 20.33, 16.67, 0, 0, 0]} | NOISE | section
    changes = {
        "grasps.left.begins": "closed",
        "target.base": {"joint": "free_flyer", "close_grasp": "left", "align": True},
        "robots.servicer.sensors": None,
        "robots.servicer.estimators": {"held": held},
        "phases": TURNS,
        "simulation": {"duration": 9.0, "step": 0.05, "output_step": 0.25},
    }
    scene = sr.load_scene("caught-unknown", changes)
    return rolled(scene, 9.0, step_s=0.05, output_step_s=0.25)


def carried(rollout, **values):
    """Greatest error of orientation and of mass, with other numbers of the filter."""
    run = rollout.run({f"robots.servicer.estimators.held.{key}": value for key, value in values.items()})
    error = np.linalg.norm(run.outputs["tip_orientation_error"].reshape(len(run.time), -1)[:, :3], axis=1)
    mass = run.outputs["held_mass_error"].reshape(len(run.time), -1)
    return error[run.time > 6].max(), np.nanmin(np.abs(mass[-1]))


def test_an_unknown_object_is_carried_as_a_known_one_once_it_is_identified():
    # a deviation so small that the assumption stays
    sure = {"mass_deviation": 1e-6, "com_deviation": 1e-7, "inertia_deviation": 1e-6}
    rollout = carrying()
    identified, left = carried(rollout)
    assumed, wrong = carried(rollout, **sure)
    known, _ = carried(carrying(**sure, mass=None, com=None, inertia=None))
    assert wrong == pytest.approx(40, abs=0.1)
    assert left < 2.0
    assert assumed > 3 * known
    assert identified < 1.3 * known


@pytest.mark.parametrize(
    ("path", "step"),
    [("robots.arm.tips.tip.reference.radius", 1e-5), ("robots.arm.estimators.held.rate_noise", 1e-8)],
)
def test_gradients_of_the_information_are_exact(path, step):
    """By a number of the motion, so that excitation can be planned, and by one of the filter."""
    scene = flat({"simulation": {"duration": 0.4, "step": 0.02, "output_step": 0.1}}, **NOISE)
    paths = [path]
    rollout, _ = build_quantity_rollout(
        scene, [find_quantity("held_deviation")], paths, "interpreted", many=False
    )
    found = rollout.value_and_gradient(wrt=paths)
    (name,) = found.gradients
    nominal = rollout.values()[rollout.indices(paths)][0]
    ends = [
        rollout.value_and_gradient({path: nominal + sign * step}, wrt=paths).costs[name] for sign in (1, -1)
    ]
    wanted = (ends[0] - ends[1]) / (2 * step)
    assert abs(wanted) > 1e-3
    np.testing.assert_allclose(found.gradients[name][0], wanted, rtol=1e-5)


@pytest.mark.parametrize(
    ("changes", "section", "message"),
    [
        ({"robots.arm.base": {"joint": "fixed"}}, NOISE, "the base of arm is fixed"),
        ({}, {}, "base_velocity has no `noise`"),
        ({}, NOISE | {"frame": "mate_2"}, "no grasp of tip and mate_2"),
        ({}, NOISE | {"tip": "tap"}, "found 'tap'"),
        (
            {"robots.arm.sensors.base_spin": sampled(1e-5, 0.04)},
            NOISE,
            "whole multiples of the period of base_spin",
        ),
    ],
)
def test_what_it_cannot_use_is_refused(changes, section, message):
    with pytest.raises(ScenarioError, match=message):
        flat(changes, **section)


def test_feed_forward_without_an_object_is_refused():
    payload = {"payload": {"kind": "payload_feed_forward"}}
    scene = sr.load_scene(Path(folder().name) / "small.yaml", {"robots.arm.tips.tip.controllers": payload})
    with pytest.raises(ScenarioError, match="nor an estimator of kind inertia_filter of arm/tip"):
        build_closed_loop(scene)
    late = {"errors": SENSORS["base_spin"]["errors"] | {"delay": 0.05}}
    with pytest.raises(ScenarioError, match=r"found base_spin 0\.05 s late"):
        build_closed_loop(flat(sensors=SENSORS | {"base_spin": late}))


def test_a_motion_that_shows_most_within_a_limit_of_torque_is_planned(interpreted):
    """It shows more than any motion of a grid that keeps the limit, and keeps it too."""
    path, most_nm = "robots.arm.tips.tip.reference", 5.0
    bounds = {f"{path}.radius": (0.02, 0.15), f"{path}.end_deg": (30.0, 180.0)}
    tuning = {
        "variables": {
            key.rpartition(".")[2]: {"paths": key, "lower": low, "upper": high}
            for key, (low, high) in bounds.items()
        },
        "objective": {"weight": 0, "held_deviation": 1},
        "constraints": {"max_joint_torque": most_nm},
        "starts": 2,
        "step": 0.02,
    }
    short = {"duration": 0.4, "step": 0.02, "output_step": 0.1}
    scene = flat({"simulation": short, "tuning": tuning}, **NOISE)
    measured = ["held_deviation", "joint_torque_peak"]
    grid = np.array(list(itertools.product(*(np.linspace(*ends, 7) for ends in bounds.values()))))
    many = sr.batch(scene, measured, dict(zip(bounds, grid.T.tolist(), strict=True))).data
    deviations, torques = (many[key].values for key in measured)
    keeps = torques <= most_nm
    assert 5 < keeps.sum() < keeps.size - 5
    tuned = sr.simulate(sr.tune(scene).scene)
    assert np.abs(tuned.array("joint_torque")).max() <= most_nm * 1.001
    assert tuned.array("held_deviation")[-1, 0] < deviations[keeps].min()


def test_the_momentum_of_wheels_is_counted():
    """Wheels hold the base against the arm, so that their momentum is as large as that of the object."""
    wheels = {"wheels": {"kind": "reaction_wheels", "axes": [[0, 0, 1]], "inertia": 0.05}}
    held = {"turn": {"kind": "base_attitude", "kp": 40, "kd": 20}}
    short = {"duration": 0.8, "step": 0.01, "output_step": 0.1}
    scene = flat(
        {"simulation": short, "robots.arm.actuators": wheels, "robots.arm.controllers": held}, **NOISE
    )
    result = sr.simulate(scene, backend="interpreted")
    assert np.abs(result.array("wheel_momentum")[-1, 0]).max() > 1
    assert result.array("held_nees")[-1, 0] < 0.1


@pytest.mark.parametrize("kind", ["proportional", "pulsed", "base_wrench"])
def test_the_impulse_of_the_bases_actuators_is_counted(kind):
    """They hold the base against the arm, so that the momentum changes by as much as the object has."""
    square = {
        f"{name}_{sign}": {"position": place, "direction": way}
        for name, place, way in (("x", [0, 0.3, 0], [1, 0, 0]), ("y", [0.3, 0, 0], [0, 1, 0]))
        for sign, place, way in (
            ("a", place, way),
            ("b", place, [-c for c in way]),
            ("c", [-c for c in place], way),
            ("d", [-c for c in place], [-c for c in way]),
        )
    }
    jets = {"kind": "thrusters", "nozzles": square, "thrust": 20}
    jets |= {"mode": "pulsed", "period": 0.1} if kind == "pulsed" else {}
    gains = {"kp": 40, "kd": 20}
    changes = {
        "simulation": {"duration": 0.8, "step": 0.01, "output_step": 0.1},
        "robots.arm.actuators": {"jets": {"kind": "base_wrench"} if kind == "base_wrench" else jets},
        "robots.arm.controllers": {
            "turn": {"kind": "base_attitude"} | gains,
            "stay": {"kind": "base_position"} | gains,
        },
        "robots.arm.base.position": [3, -2, 0],
    }
    result = sr.simulate(flat(changes, **NOISE), backend="interpreted")
    assert np.abs(result.array("impulse_linear")).max() > 0.5
    assert np.abs(result.array("impulse_angular")).max() > 0.5
    np.testing.assert_allclose(
        result.data.z.sel(controller=[f"arm.pushed[{i}]" for i in range(3)]).values,
        np.column_stack([result.array("impulse_linear")[:, :2], result.array("impulse_angular")[:, 2:]]),
        atol=1e-12,
    )
    assert result.array("held_nees")[-1, 0] < 0.1
