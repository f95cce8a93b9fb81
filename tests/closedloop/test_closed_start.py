"""Gripped scenes begin closed at any parameter values; a sample that cannot fails by the grasp's name."""

from __future__ import annotations

import dataclasses
import functools
import re

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import DivergedError, ScenarioError
from spacerobot.pinocchio_engine import PinocchioLoop
from spacerobot.rollout import Measures, Signals, build_rollout, integral
from spacerobot.scene import load_scene
from spacerobot.scene.configure import initial_state, relative_jacobian
from spacerobot.scene.grasp_closing import find_closings
from tests.oracles.small_scenes import PLANAR, SPATIAL, small_scene


def held(text: str, left: str, right: str) -> dict[str, object]:
    frames = ("mate_1", "mate_2") if text is PLANAR else ("left", "right")
    return {
        "grasps.left": {"kind": left, "tip": "one/tip", "frame": frames[0]},
        "grasps.right": {"kind": right, "tip": "two/tip", "frame": frames[1]},
    }


def loose(text: str) -> dict[str, object]:
    """Bases without `close_grasp`, at places where nothing meets."""
    joint = "planar" if text is PLANAR else "free_flyer"
    return {
        "robots.two.base": {"joint": joint, "position": [3, 2, 0], "rotation_deg": [0, 0, 160]},
        "target.base": {"joint": joint, "position": [-1, 0.5, 0], "rotation_deg": [0, 0, 20]},
    }


SCENES = {
    f"{name}, {left} and {right}": (text, held(text, left, right) | extra)
    for name, text in (("planar", PLANAR), ("spatial", SPATIAL))
    for left, right, extra in (("weld", "point", {}), ("point", "weld", loose(text)))
}
SCENES["robot one follows the target"] = (
    SPATIAL,
    held(SPATIAL, "weld", "point")
    | {
        "robots.one.base": {"joint": "free_flyer", "close_grasp": "left", "rotation_deg": [20, -30, 40]},
        "target.base": {"joint": "free_flyer", "position": [1, 2, 3], "spin_deg": [3, 4, -5]},
    },
)


def aligned(text: str, kind: str) -> dict[str, object]:
    """The target follows robot one, and robot two the target, turned so that their axes agree."""
    joint, turn = ("planar", [0, 0, 15]) if text is PLANAR else ("free_flyer", [10, -20, 30])
    base = {"joint": joint, "align": True}
    return held(text, kind, kind) | {
        "target.base": base | {"close_grasp": "left", "align_rotation_deg": turn},
        "robots.two.base": base | {"close_grasp": "right"},
    }


for name, text in (("planar", PLANAR), ("spatial", SPATIAL)):
    for kind in ("weld", "point"):
        SCENES[f"{name}, aligned, {kind}"] = (text, aligned(text, kind))


def looped(joint_rate: float = 0.0) -> dict[str, object]:
    """Two arms on fixed bases hold the plate: a loop, of which no base can close one grasp."""
    still = {"velocity": [0, 0, 0], "spin_deg": [0, 0, 0]}
    changes = held(PLANAR, "point", "point") | {
        "robots.one.base": {"joint": "fixed", "rotation_deg": [0, 0, 10]}
    }
    scene = small_scene(
        PLANAR, changes | {"target.base": {"joint": "planar", "rotation_deg": [0, 0, 20]} | still}
    )
    place = scene.model.joints[scene.body("two").root_joint].idx_q
    x, y = map(float, scene.q[place : place + 2])
    fixed = {"joint": "fixed", "position": [x, y, 0], "rotation_deg": [0, 0, 180]}
    return changes | {"robots.two.base": fixed, "robots.one.joints.joint_1.rate_deg": joint_rate}


SCENES["loop"] = (PLANAR, looped(3.0))
BEND = "robots.two.joints.joint_2.angle_deg"


@functools.cache
def built(case):
    """Scene and closed loop, which no test changes."""
    scene = small_scene(*SCENES[case])
    return scene, build_closed_loop(scene)


def startable(loop) -> dict[str, float]:
    """Parameters that the start depends on."""
    kinds = ("angle_deg", "rate_deg", "offset", "speed", "position", "rotation_deg", "velocity", "spin_deg")
    values = dict(zip(loop.parameter_paths, loop.parameter_values, strict=True))
    return {
        path: value
        for path, value in values.items()
        if any(part in kinds for part in path.split(".")[-2:])
        and ".reference." not in path
        and "sensors" not in path
    }


def assert_closed(scene, q, v):
    """Tips at their mating frames, and nothing slips, by Pinocchio."""
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, q)
    for grasp in scene.grasps:
        gap = data.oMf[grasp.tip.frame].translation - data.oMf[grasp.frame].translation
        assert np.abs(gap).max() < 1e-12, grasp.name
        at = dataclasses.replace(scene, q=q, v=v)
        assert np.abs(relative_jacobian(at, grasp) @ v).max() < 1e-12, grasp.name


@pytest.mark.parametrize("case", SCENES)
def test_any_start_is_closed_and_the_same_as_that_of_its_own_scene(case):
    text, changes = SCENES[case]
    scene, loop = built(case)
    rng, nominal = np.random.default_rng(3), startable(loop)
    bent = [
        p
        for p in nominal
        if not (case == "loop" and p.endswith(("angle_deg", "position.0", "rotation_deg.2")))
    ]
    for _ in range(4):
        values = {path: nominal[path] + rng.normal() for path in bent}
        x0 = loop.setup(loop.parameters(values))[0].full().ravel()
        q, v = x0[: loop.nq], x0[loop.nq : loop.nq + loop.nv]
        assert np.abs(v).max() > 1e-3
        assert_closed(scene, q, v)
        own = small_scene(text, [*changes.items(), *values.items()])
        np.testing.assert_allclose(q, own.q, atol=1e-13)
        np.testing.assert_allclose(v, own.v, atol=1e-13)
        np.testing.assert_array_equal(PinocchioLoop(own).x0[: loop.nq], own.q)


@pytest.mark.parametrize("text", [PLANAR, SPATIAL], ids=["planar", "spatial"])
@pytest.mark.parametrize("kind", ["weld", "compliant"])
def test_an_aligned_grasp_begins_with_the_axes_that_were_asked_for(text, kind):
    changes = aligned(text, kind)
    wanted = changes["target.base"]["align_rotation_deg"]
    if kind == "compliant":
        changes["target.base"]["velocity"] = [0.1, -0.2, 0]
        changes["target.base"]["spin_deg"] = [0, 0, 4]
    scene = small_scene(text, changes)
    loop = build_closed_loop(scene)
    rng, nominal = np.random.default_rng(2), startable(loop)
    for _ in range(3):
        values = {p: x + 40 * rng.normal() for p, x in nominal.items() if p.endswith("angle_deg")}
        x0 = loop.setup(loop.parameters(values))[0].full().ravel()
        q, v, data = x0[: loop.nq], x0[loop.nq : loop.nq + loop.nv], scene.model.createData()
        pin.forwardKinematics(scene.model, data, q, v)
        pin.updateFramePlacements(scene.model, data)
        for grasp, rpy in zip(scene.grasps, (wanted, [0, 0, 0]), strict=True):
            between = data.oMf[grasp.frame].inverse() * data.oMf[grasp.tip.frame]
            np.testing.assert_allclose(between.translation, 0, atol=1e-12)
            np.testing.assert_allclose(
                between.rotation, pin.rpy.rpyToMatrix(np.radians(rpy)), atol=1e-12, rtol=0
            )
        if kind == "compliant":  # velocity and spin as described, in world axes
            frame, world = scene.target.root_frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            motion = pin.getFrameVelocity(scene.model, data, frame, world)
            np.testing.assert_allclose(motion.linear, [0.1, -0.2, 0], atol=1e-12)
            np.testing.assert_allclose(motion.angular, np.radians([0, 0, 4]), atol=1e-12)
    told = [a for a in scene.assumptions if a.startswith("target.base: placed at")]
    assert "turned by (" in told[0]
    assert "so that grasp 'left' closes aligned" in told[0]
    assert told[0].endswith("velocity and spin follow") == (kind == "weld")


def test_an_aligned_start_follows_a_joint_through_whole_turns_without_a_jump():
    scene = small_scene(SPATIAL, aligned(SPATIAL, "weld"))
    loop, path = build_closed_loop(scene), "robots.one.joints.round.angle_deg"
    angles = np.linspace(-400, 400, 161)
    starts = np.array([loop.setup(loop.parameters({path: a}))[0].full().ravel()[: loop.nq] for a in angles])
    place = scene.model.joints[scene.target.root_joint].idx_q
    assert np.abs(np.diff(starts[:, place + 3 : place + 7], axis=0)).max() < 0.06
    assert np.abs(np.linalg.norm(starts[:, place + 3 : place + 7], axis=1) - 1).max() < 1e-12


@pytest.mark.parametrize("case", SCENES)
def test_the_start_is_differentiated_exactly(case):
    _, loop = built(case)
    paths = list(startable(loop))
    rng, places = np.random.default_rng(1), [loop.index(path) for path in paths]
    p = ca.SX.sym("p", len(loop.parameter_paths))
    direction = np.zeros(len(loop.parameter_paths))
    direction[places] = rng.normal(size=len(places))
    slope = ca.Function("slope", [p], [ca.jtimes(loop.setup(p)[0], p, direction)])
    at, step = loop.parameter_values, 1e-4
    found = slope(at).full().ravel()
    ahead, behind = (loop.setup(at + s * step * direction)[0].full().ravel() for s in (1, -1))
    np.testing.assert_allclose(found, (ahead - behind) / (2 * step), atol=1e-8)
    assert np.abs(found).max() > 1e-3


def test_a_loop_closes_by_impulses_that_keep_the_momentum():
    """The change has the least kinetic energy: it does no work along any motion that the grasps allow."""
    scene = load_scene("servicer", {"robots.servicer.joints.left_joint_2.rate_deg": 2} | SPUN)
    described = initial_state(scene.model, scene.bodies, scene.grasps, source=None)[1]
    data = scene.model.createData()
    before, after = (
        pin.computeCentroidalMomentum(scene.model, data, scene.q, v).vector.copy()
        for v in (described, scene.v)
    )
    np.testing.assert_allclose(after, before, atol=1e-11)
    rows = np.vstack([relative_jacobian(scene, grasp) for grasp in scene.grasps])
    assert np.abs(rows @ described).max() > 1e-2
    assert np.abs(rows @ scene.v).max() < 1e-12
    upper = np.triu(pin.crba(scene.model, data, scene.q))
    impulse = (upper + np.triu(upper, 1).T) @ (scene.v - described)
    allowed = np.linalg.svd(rows)[2][len(rows) :]
    assert np.abs(allowed @ impulse).max() < 1e-10
    assert sum("initial velocities changed by up to" in warning for warning in scene.warnings) == 1


SPUN = {"robots.servicer.base.spin_deg": [1, -2, 3], "robots.servicer.base.velocity": [0.1, 0, 0.05]}


def test_a_spinning_servicer_takes_its_target_along():
    """The velocity that had to be worked out by hand follows; another one gives way, and that is told."""
    spin, lever = np.radians(SPUN["robots.servicer.base.spin_deg"]), np.array([2.3, 0, 0])
    velocity = np.array([0.1, 0, 0.05]) + np.cross(spin, lever)
    by_hand = {"target.base.velocity": velocity.tolist(), "target.base.spin_deg": [1, -2, 3]}
    follows, given = load_scene("servicer", SPUN), load_scene("servicer", SPUN | by_hand)
    np.testing.assert_allclose(follows.v[-6:], [*velocity, *spin], atol=1e-9)
    np.testing.assert_allclose(given.v, follows.v, atol=1e-15)
    assert follows.warnings == given.warnings == load_scene("servicer").warnings
    np.testing.assert_allclose(PinocchioLoop(given).x0, PinocchioLoop(follows).x0, atol=1e-15)
    other = load_scene("servicer", SPUN | {"target.base.velocity": [0, 0, 1]})
    np.testing.assert_array_equal(other.v, follows.v)
    (told,) = set(other.warnings) - set(follows.warnings)
    assert told.startswith(
        "target.base: `velocity` is replaced by (0.1, 0.1204, 0.1303) m/s so that grasp 'left'"
    )
    with pytest.raises(
        ScenarioError, match=r"target\.base\.spin_deg\.2: the closed loop does not depend on it"
    ):
        build_closed_loop(follows, vary=["target.base.spin_deg.2"])


def test_who_gives_way_is_told():
    told = "\n".join(small_scene(*SCENES["robot one follows the target"]).assumptions)
    for body, rest in (
        ("robots.one.base: placed at", "so that grasp 'left' closes; its velocity and spin follow"),
        ("robots.two.base: placed at", "so that grasp 'right' closes; its velocity follows"),
    ):
        assert any(line.startswith(body) and line.endswith(rest) for line in told.splitlines()), told
    assert "target.base: placed" not in told
    looping = small_scene(*SCENES["loop"])
    assert any(a.startswith("grasps.right: no base can close it") for a in looping.assumptions)
    moved = small_scene(PLANAR, held(PLANAR, "weld", "weld") | loose(PLANAR))
    assert {w.partition(" m from")[0].split(": moved")[0] for w in moved.warnings if "moved" in w} == {
        "robots.two.base",
        "target.base",
    }


def test_a_robot_that_cannot_move_is_met_by_the_target():
    """Whatever the order of the grasps: the other robot's base follows the target."""
    fixed = held(SPATIAL, "weld", "weld") | {
        "robots.two.base": {"joint": "fixed", "position": [1, 2, 0]},
        "target.base": {"joint": "free_flyer"},
    }
    scene = small_scene(SPATIAL, fixed)
    assert [(c.body.name, c.grasp.name) for c in find_closings(scene.bodies, scene.grasps)] == [
        ("target", "right"),
        ("one", "left"),
    ]
    assert_closed(scene, scene.q, scene.v)


@pytest.fixture(scope="module")
def loop_rollout():
    loop = build_closed_loop(small_scene(PLANAR, looped()))
    signals = Signals.of(loop)
    work = ca.sumsqr(signals.outputs["joint_torque"])
    measures = Measures(signals, {"work": integral(work)}, lambda m, _: {"J": m["work"][0]})
    grid = {"duration_s": 0.1, "step_s": 0.004, "output_step_s": 0.02}
    return build_rollout(loop, **grid, measures=measures, backend="interpreted")


KP = "robots.one.tips.tip.pid.kp"
OPEN = r"grasps\.right does not close: its gap is 0\.0\d+ m, allowed max_gap 1e-06 m"


def test_what_cannot_be_closed_is_that_samples_failure(loop_rollout):
    rollout, wrong = loop_rollout, {BEND: 62.0}
    (nominal,) = (
        value
        for path, value in startable(build_closed_loop(small_scene(PLANAR, looped()))).items()
        if path == BEND
    )
    one = rollout.run(wrong)
    assert one.status == "unclosed"
    assert one.diverged_at_s == 0
    assert re.fullmatch(OPEN, one.cause)
    assert len(one.time) == len(one.state) == 1
    assert np.isnan(one.costs["J"])
    good = rollout.run()
    assert (good.status, good.cause) == ("completed", "")

    batch = rollout.batch([BEND], [[nominal], [62.0], [nominal]], states=True)
    assert [bool(words) for words in batch.unclosed] == [False, True, False]
    np.testing.assert_array_equal(np.isnan(batch.costs["J"]), [False, True, False])
    np.testing.assert_array_equal(np.isnan(batch.diverged_at_s), [True, False, True])
    assert batch.gaps["grasps.right"][1] > 1e-3 > 1e-9 > batch.gaps["grasps.right"][0]
    assert np.isnan(batch.state[1, 1:]).all()
    assert batch.costs["J"][0] == good.costs["J"]

    gradient = rollout.value_and_gradient(wrong, wrt=[KP])
    assert np.isnan(gradient.costs["J"])
    assert np.isnan(gradient.gradients["J"]).all()
    assert re.fullmatch(OPEN, gradient.unclosed[0])
    several = rollout.gradient_batch([BEND], [[62.0], [nominal]], wrt=[KP])
    assert np.isnan(several.gradients["J"][0]).all()
    assert np.isfinite(several.gradients["J"][1]).all()
    assert [bool(words) for words in several.unclosed] == [True, False]
    slopes = rollout.slope_batch([BEND], [[62.0], [nominal]], wrt=[KP, BEND])
    assert [bool(words) for words in slopes.unclosed] == [True, False]
    assert np.isnan(slopes.measures["work"][0]).all()
    assert np.isfinite(slopes.measures["work"][1]).all()
    assert rollout.jacobian(wrong, wrt=[KP]).trajectory.status == "unclosed"
    with pytest.raises(DivergedError, match=OPEN):
        rollout.choose_step(parameters=wrong)
    with pytest.raises(
        ScenarioError, match=r"grasps\.right: does not close: two/tip is 0\.0.* m; change the posture"
    ):
        small_scene(PLANAR, looped() | wrong)


def test_a_compliant_grasp_that_no_base_closes_is_judged_alike():
    """As the scene is: open by more than `max_gap`, it does not begin."""
    scene = small_scene(
        PLANAR, {"target.base": {"joint": "fixed", "position": place(), "rotation_deg": [0, 0, 20]}}
    )
    rollout = build_rollout(build_closed_loop(scene), duration_s=0.02, step_s=0.004, backend="interpreted")
    assert rollout.run().status == "completed"
    off = rollout.run({"robots.one.joints.joint_2.angle_deg": -75})
    assert off.cause.startswith("grasps.left does not close: its gap is 0.0")
    assert off.cause.endswith("allowed max_gap 0.01 m")


def place() -> list[float]:
    scene = small_scene(PLANAR)
    x, y = scene.q[scene.model.joints[scene.target.root_joint].idx_q :][:2]
    return [float(x), float(y), 0.0]
