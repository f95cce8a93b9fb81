"""Following a planned motion: what is read of its file, and how it is followed."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import CubicHermiteSpline, KroghInterpolator

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.description.planar import PlanarBase, PlanarLink, planar_arm_urdf
from spacerobot.elements import SectionContext
from spacerobot.elements.references.knot_motion import Knots
from spacerobot.result import Result
from spacerobot.rollout.tables import fill
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from spacerobot.symbolic import Constants, Parameters
from tests.oracles.motions import DesiredMotions
from tests.oracles.plans import plan_of, write_plan
from tests.oracles.small_scenes import ONE_SPATIAL_ARM, PLANAR, random_x, small_scene
from tests.oracles.two_engines import Numeric, Symbolic
from viz.studio.parameters import find_leaves

DURATION, KNOTS = 2.0, 21
TURNS = {"arm/joint_1": 0.9, "arm/joint_2": -0.6}
TEXT = """
robots:
  arm:
    urdf: arm.urdf
    base: {joint: planar}
    joints: {joint_1: {angle_deg: 40}, joint_2: {angle_deg: -50}}
    tips: {tip: {reference: {kind: REFERENCE}}}
    controllers: {follow: FOLLOW}
simulation: {duration: 2, output_step: 0.1, step: 0.01}
"""
FOLLOW = "{kind: joint_tracking, file: plan.nc, kp: 200, kd: 100}"


def text(reference="plan, file: plan.nc", follow=FOLLOW):
    return TEXT.replace("REFERENCE", reference).replace("FOLLOW", follow)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder with an arm of two links on a floating base, its plan, and a scenario that follows it."""
    place = tmp_path_factory.mktemp("planned")
    link = PlanarLink(length_m=0.5, mass_kg=5.0, inertia_kg_m2=(0.1, 0.1))
    base = PlanarBase(mass_kg=30.0, inertia_kg_m2=4.0, radius_m=0.3)
    (place / "arm.urdf").write_text(planar_arm_urdf(links=2, link=link, base=base, damping=0.3))
    (place / "still.yaml").write_text(text("hold", "{kind: joint_pd}"))
    write_plan(plan_of(load_scene(place / "still.yaml"), TURNS, DURATION, KNOTS), place / "plan.nc")
    (place / "follow.yaml").write_text(text())
    return place


def scene_with(folder, name, **changes):
    file = folder / name
    file.write_text(text(**changes))
    return load_scene(file)


@pytest.mark.parametrize("parted", [False, True])
@pytest.mark.parametrize("points", [2, 4])
@pytest.mark.parametrize("when", [0.0, 0.2, 0.35, 0.5, 1.1, 1.5, 2.0])
def test_knots_are_joined_as_scipy_joins_them(when, points, parted):
    knots = np.array([0.0, 0.35, 0.5, 1.5])
    nodes = np.array([0, (1 - 5**-0.5) / 2, (1 + 5**-0.5) / 2]) if points == 4 else np.zeros(1)
    times = np.array([*(a + nodes * (b - a) for a, b in pairwise(knots)), knots[-1:]], dtype=object)
    times = np.concatenate(times).astype(float)
    if parted:  # each interval has rows of its own at both ends
        times = np.concatenate([times[k : k + points] for k in range(0, len(times) - 1, points - 1)])
    rng = np.random.default_rng(1)
    values, rates = rng.normal(size=(2, len(times), 3))
    context = SectionContext("own", ca.SX.sym("t"), Parameters({}), Constants())
    found, given = Knots.at(context, times, points), ca.SX(ca.DM(values))
    motion = found.motion("motion", given, ca.SX(ca.DM(rates)))
    constants, outputs = context.constants, [motion.value, motion.rate, motion.acceleration]
    outputs.append(found.force("force", given))
    inputs = [context.time, constants.symbols]
    c = ca.DM(ca.evalf(constants.expressions)).full().ravel()
    rows = ca.Function("rows", inputs, [constants.cursors])(when, c).full().ravel()
    fill(constants.tables, rows, c)
    seen = [each.full().ravel() for each in ca.Function("at", inputs, outputs)(when, c)]
    if when >= knots[-1]:
        np.testing.assert_allclose(seen, [values[-1], *np.zeros((3, 3))], atol=1e-12)
        return
    first = (points if parted else points - 1) * (np.searchsorted(knots, when, side="right") - 1)
    piece = slice(first, first + points)
    both = np.stack([values[piece], rates[piece]], axis=1).reshape(-1, 3)
    curve = KroghInterpolator(np.repeat(times[piece], 2), both)
    wanted = [*curve.derivatives(when, 3), KroghInterpolator(times[piece], values[piece])(when)]
    for one, other in zip(seen, wanted, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9 * (1 + np.abs(other).max()))


def test_a_plan_is_followed(folder):
    result = simulate(load_scene(folder / "follow.yaml"))
    error = np.linalg.norm(result.data.tip_error.sel(tip="arm/tip"), axis=1)
    assert error.max() < 2e-4  # what the torque's being linear between knots leaves to the feedback
    assert result.summary["status"]["trusted"]
    turned = result.data.joint_position.isel(time=-1) - result.data.joint_position.isel(time=0)
    np.testing.assert_allclose(turned, list(TURNS.values()), atol=1e-4)


def test_the_torque_alone_leads_there_as_knots_grow_closer(folder):
    errors = []
    for count in (6, 11, 21):
        still = load_scene(folder / "still.yaml")
        write_plan(plan_of(still, TURNS, DURATION, count), folder / f"plan_{count}.nc")
        name = f"plan_{count}.nc"
        open_loop = f"{{kind: joint_tracking, file: {name}}}"
        scene = scene_with(folder, f"open_{count}.yaml", reference=f"plan, file: {name}", follow=open_loop)
        run = Symbolic(scene).run(DURATION, DURATION, 0.01)
        errors.append(np.linalg.norm(run.outputs["tip_error"][-1]))
    assert np.log2(errors[0] / errors[1]) > 1.8
    assert np.log2(errors[1] / errors[2]) > 1.8


@pytest.mark.parametrize("phases", ["", "phases: {wait: {until: {time: 0.13}}, go: {}}\n"])
def test_the_method_keeps_its_order_across_knots(folder, phases):
    write_plan(plan_of(load_scene(folder / "still.yaml"), TURNS, DURATION, 6), folder / "six.nc")
    follow = "{kind: joint_tracking, file: six.nc}"
    (folder / "six.yaml").write_text(text(reference="hold", follow=follow) + phases)
    loop = Symbolic(load_scene(folder / "six.yaml"))
    ends = [loop.run(1.2, 0.2, step).state[-1] for step in (0.2, 0.1, 0.025)]
    coarse, fine = (np.abs(end - ends[2]).max() for end in ends[:2])
    assert np.log2(coarse / fine) > 5


def test_more_knots_take_no_more_operations(folder):
    counts = []
    for name, knots in (("few", 4), ("many", 40)):
        write_plan(plan_of(load_scene(folder / "still.yaml"), TURNS, DURATION, knots), folder / f"{name}.nc")
        follow = FOLLOW.replace("plan.nc", f"{name}.nc")
        scene = scene_with(folder, "count.yaml", reference=f"plan, file: {name}.nc", follow=follow)
        counts.append(build_closed_loop(scene).dynamics.n_instructions())
    assert counts[0] == counts[1]


def test_a_result_needs_the_file_no_more(folder, tmp_path):
    result = simulate(load_scene(folder / "follow.yaml"))
    result.save(tmp_path / "out")
    again = simulate(load_scene(tmp_path / "out" / "scenario.yaml"))
    np.testing.assert_array_equal(again.data.q, Result.load(tmp_path / "out").data.q)


def test_another_file_takes_the_place_of_what_was_read(folder, tmp_path):
    first = load_scene(folder / "follow.yaml")
    write_plan(plan_of(load_scene(folder / "still.yaml"), TURNS, 3.0, 7), folder / "slow.nc")
    changed = load_scene(folder / "follow.yaml", {"robots.arm.controllers.follow.file": "slow.nc"})
    times = [scene.scenario.robots["arm"].controllers["follow"].knots.times[-1] for scene in (first, changed)]
    assert times == [2.0, 3.0]


def test_time_counts_from_the_beginning_of_the_phase(folder):
    file = folder / "phased.yaml"
    file.write_text(text("hold") + "phases: {wait: {until: {time: 0.05}}, go: {}}\n")
    scene = load_scene(file)
    ends = [engine(scene).run(0.1, 0.1).state[-1] for engine in (Symbolic, Numeric)]
    np.testing.assert_allclose(ends[0][:10], ends[1][:10], atol=1e-6)
    end = Symbolic(scene).run(2.2, 2.2, 0.01).state[-1]  # a plan that began at 0 was at its end for 0.2 s
    began = Symbolic(load_scene(folder / "follow.yaml")).run(2.15, 2.15, 0.01).state[-1]
    np.testing.assert_allclose(end[[4, 5]], began[[4, 5]], atol=1e-3)


def test_phases_of_the_plan_are_followed_by_name(folder):
    plan = plan_of(load_scene(folder / "still.yaml"), TURNS, DURATION, KNOTS)
    plan["phase"] = "time", ["near"] * 2 + ["far"] * 19
    write_plan(plan, folder / "two.nc")
    follow = "{kind: joint_tracking, file: two.nc, kp: 400, kd: 60}"
    file = folder / "two.yaml"
    reference = "{kind: plan, file: two.nc}"
    far = f"{{robots: {{arm: {{tips: {{tip: {{reference: {reference}}}}}}}}}}}"
    file.write_text(text("hold", follow) + f"phases: {{near: {{until: {{time: 0.25}}}}, far: {far}}}\n")
    scene = load_scene(file)
    lead = scene.scenario.phases["far"].changes["robots"]["arm"]["tips"]["tip"]["reference"]
    assert lead["knots"]["times"][-1] == pytest.approx(1.8)
    ends = [engine(scene).run(0.28, 0.14).state[-1] for engine in (Symbolic, Numeric)]
    np.testing.assert_allclose(ends[0][:10], ends[1][:10], atol=1e-6)
    end = Symbolic(scene).run(1.25, 1.25, 0.01)  # the second phase begins at 0.2 s of the plan
    wanted = CubicHermiteSpline(plan.time, plan.joint_position, plan.joint_rate)(1.2)
    np.testing.assert_allclose(end.state[-1][[4, 5]], wanted, atol=5e-3)
    np.testing.assert_allclose(end.outputs["tip_error"][-1], 0, atol=5e-3)


JOINTS = {
    "times": [0, 0.2, 0.4, 0.8, 1.2],
    "points": 3,
    "joints": ["joint_3", "joint_1", "joint_2"],
    "position": [[0.6, 0.8, -1.2], [0.5, 0.9, -1.1], [0.7, 0.7, -1], [0.6, 0.7, -1], [0.8, 0.8, -1.2]],
    "rate": [[0, 0, 0], [0.1, 0.2, 0.1], [0.2, -0.1, 0.3], [0.1, 0, 0], [0, 0, 0]],
    "effort": [[1, 2, 3], [0.5, -1, 2], [1, 1, -2], [1, 2, 0], [1, 0.5, 0.5]],
}
BASE = {
    "times": JOINTS["times"],
    "points": 3,
    "axes": ["tz", "fx"],
    "wrench": [[1, 2], [0.5, -1], [1, 1], [1, 2], [1, 0.5]],
    "rate": [[0, 0], [0.1, 0.2], [0.2, -0.1], [0.1, 0], [0, 0]],
}
TRACKING = {
    "two controllers": {
        "arm": {"kind": "joint_tracking", "kp": 20, "kd": 3, "feed_forward": 0.8, "knots": JOINTS},
        "base": {
            "kind": "base_tracking",
            "kd_linear": 20,
            "kd_angular": 4,
            "feed_forward": 0.8,
            "knots": BASE,
        },
    },
    "mpc": {
        "own": {"kind": "mpc", "begin": 0.1, "kp": 20, "kd": 3, "knots": JOINTS, "base_knots": BASE}
        | {"kd_linear": 20, "kd_angular": 4, "feed_forward": 0.8}
    },
}


@pytest.mark.parametrize("t", [0.15, 0.7, 1.6])
@pytest.mark.parametrize("controllers", TRACKING.values(), ids=TRACKING)
def test_joints_and_base_track_the_polynomials_of_their_plan(controllers, t):
    """Joints and axes of the base by their names; after the plan's end the last position and no force."""
    alone = {f"robots.one.tips.tip.{key}": None for key in ("pid", "amnesia")}
    actuators = {"ideal": {"kind": "base_wrench"}}
    scene = small_scene(
        PLANAR, alone | {"robots.one.controllers": controllers, "robots.one.actuators": actuators}
    )
    own = Symbolic(scene)
    x = random_x(scene, np.random.default_rng(1), len(own.x0))
    elapsed = t - 0.1 * ("own" in controllers)
    last = elapsed > JOINTS["times"][-1]
    rows = slice(0, 3) if elapsed < 0.4 else slice(2, 5)
    times = np.array(JOINTS["times"][rows])
    points = [np.array(JOINTS[key][rows]) for key in ("position", "rate")]
    track = KroghInterpolator(np.repeat(times, 2), np.stack(points, axis=1).reshape(6, 3))
    position, rate = track.derivatives(elapsed, 2)
    effort = KroghInterpolator(times, np.array(JOINTS["effort"][rows]))(elapsed)
    if last:
        position, rate, effort = np.array(JOINTS["position"][-1]), np.zeros(3), np.zeros(3)
    outputs, q, v = own.outputs(t, x), x[: scene.model.nq], x[scene.model.nq :]
    for k, name in enumerate(JOINTS["joints"]):
        joint = scene.model.joints[scene.model.getJointId(f"one/{name}")]
        torque = 0.8 * effort[k] + 20 * (position[k] - q[joint.idx_q]) + 3 * (rate[k] - v[joint.idx_v])
        assert outputs["joint_torque"][int(name[-1]) - 1] == pytest.approx(torque, rel=1e-9)
    wrench, rate = (
        KroghInterpolator(times, np.array(BASE[key][rows]))(elapsed) for key in ("wrench", "rate")
    )
    if last:
        wrench, rate = np.zeros(2), np.zeros(2)
    force = 0.8 * wrench[1] + 20 * (rate[1] - v[0])
    torque = 0.8 * wrench[0] + 4 * (rate[0] - v[2])
    np.testing.assert_allclose(outputs["base_force"][:3], [force, 0, 0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(outputs["base_torque"][:3], [0, 0, torque], rtol=1e-9, atol=1e-12)


def test_a_planned_tip_has_the_poses_and_velocities_of_its_points():
    """Of three points an interval, whose rotations are large."""
    rng, times = np.random.default_rng(2), [0, 0.5, 1.0, 1.3, 1.6]
    rows = {key: rng.normal(size=(5, 3)) for key in ("position", "velocity", "rotation", "spin")}
    knots = {"times": times, "points": 3} | {key: value.tolist() for key, value in rows.items()}
    desired = DesiredMotions(
        small_scene(ONE_SPATIAL_ARM, {"robots.one.tips.tip.reference": {"kind": "plan", "knots": knots}})
    )
    for k, t in enumerate(times[:-1]):
        found = desired.at(t + 1e-13, desired.x0)["one/tip"]
        np.testing.assert_allclose(found.position, rows["position"][k], atol=1e-10)
        np.testing.assert_allclose(found.velocity, rows["velocity"][k], atol=1e-10)
        np.testing.assert_allclose(found.rotation, pin.exp3(rows["rotation"][k]), atol=1e-10)
        np.testing.assert_allclose(found.angular_velocity, rows["spin"][k], atol=1e-10)


def damaged(kind, folder):
    """File, and what is told of it."""
    plan = plan_of(load_scene(folder / "still.yaml"), TURNS, DURATION, 5)
    if kind == "missing":
        return "none.nc", "no such file: 'none.nc' in the scenario's folder"
    if kind == "outside":
        return "../plan.nc", "leads out of the scenario's folder"
    if kind == "absolute":
        return str(folder.parent / "plan.nc"), "leads out of the scenario's folder"
    if kind == "linked":
        (folder.parent / "secret.nc").write_bytes((folder / "plan.nc").read_bytes())
        (folder / "link.nc").symlink_to(folder.parent / "secret.nc")
        return "link.nc", "leads out of the scenario's folder"
    if kind == "cut":
        (folder / "cut.nc").write_bytes((folder / "plan.nc").read_bytes()[:2000])
        return "cut.nc", "cannot be read as netCDF"
    if kind == "text":
        (folder / "text.nc").write_text("no plan")
        return "text.nc", "cannot be read as netCDF"
    if kind == "another":
        plan = plan.drop_vars("torque")
        told = "no torque"
    elif kind == "robot":
        plan, told = (
            plan.assign_coords(joint=["other/joint_1", "other/joint_2"]),
            "a plan without robot 'arm'",
        )
    elif kind == "joint":
        plan, told = plan.isel(joint=[0]), "no motion of joint joint_2; arm has joint_1, joint_2"
    elif kind == "number":
        plan.torque[2, 1], told = np.nan, "torque: holds what is no number"
    elif kind == "order":
        plan, told = plan.isel(time=[0, 2, 1, 3, 4]), "times: must rise strictly"
    elif kind == "vast":
        packed = {"more": {"zlib": True}}
        plan["more"] = ("time", "many"), np.zeros((5, 4_000_000))
        plan.to_netcdf(folder / "vast.nc", engine="netcdf4", encoding=packed)
        return "vast.nc", "unfolds to 160 MB, so not a plan"
    elif kind == "dimensions":
        plan["joint_rate"] = plan.joint_rate.isel(joint=0)
        told = "joint_rate: found dimensions time, allowed: time, joint"
    write_plan(plan, folder / f"{kind}.nc")
    return f"{kind}.nc", told


KINDS = ("missing", "outside", "absolute", "linked", "cut", "text", "another", "robot", "joint", "number")


@pytest.mark.parametrize("kind", [*KINDS, "order", "dimensions", "vast"])
def test_a_file_that_cannot_be_followed_is_one_clear_line(folder, kind):
    name, told = damaged(kind, folder)
    with pytest.raises(ScenarioError) as fault:
        scene_with(folder, "bad.yaml", reference="hold", follow=f"{{kind: joint_tracking, file: {name}}}")
    assert told in str(fault.value)
    assert "robots.arm.controllers.follow" in str(fault.value)
    assert "bad.yaml" in str(fault.value)
    assert "\n" not in str(fault.value)


def test_neither_file_nor_motion_is_refused(folder):
    with pytest.raises(ScenarioError, match="which plan"):
        scene_with(folder, "bad.yaml", reference="plan")


def test_a_plan_that_begins_elsewhere_is_warned_of(folder):
    scene = load_scene(folder / "follow.yaml", {"robots.arm.joints.joint_2.angle_deg": -45})
    assert any("the plan begins 0.08727 rad" in warning for warning in scene.warnings)


def test_the_studio_offers_gains_and_not_the_points_of_a_plan(folder):
    leaves = find_leaves(load_scene(folder / "follow.yaml"))
    assert "robots.arm.controllers.follow.kp" in leaves
    assert not [path for path in leaves if "knots" in path]
