"""Parameters: changing a value through ``setup`` is the same as building the scene with that value."""

from __future__ import annotations

import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.scene import build_scene, load_scene
from tests.oracles.small_scenes import PLANAR, SPATIAL, random_x, small_scene
from tests.oracles.two_engines import ENGINES, Numeric, Symbolic

ALL = {
    "robots.one.tips.tip.orientation_pid": {"kp": 3, "ki": 2, "kd": 0.5},
    "robots.one.tips.tip.orientation_amnesia": {"ge": 5, "ta": 2},
    "robots.two.tips.tip.pid.derivative": "filtered",
    "robots.two.tips.tip.pid.filter_time": 0.5,
    "robots.one.joint_pd": {"kp": 4, "kd": 1},
    "robots.one.sensors": {"joint_rate": {"offset": 0.02, "scale": 0.9}, "tip_position": {"offset": 0.01}},
    "robots.two.sensors": {"tip_velocity": {"scale": 1.1}},
    "robots.two.torque_limits": True,
    "robots.two.joints.*.torque_limit": 40,
    "grasps.left.rotational_stiffness": 4,
    "grasps.left.rotational_damping": 0.5,
    "gravity": [0.1, -0.2, 0],
    "grasps.*.max_gap": 1,
}
KEPT_ZEROS = {
    "planar": ("robots.one.links.link_2.com.1", "robots.two.links.base.com.0", "target.links.body.inertia.5"),
    "spatial": (
        "robots.one.links.b.inertia.3",
        "robots.two.links.d.com.1",
        "robots.two.joints.wrist.damping",
        "robots.two.tips.tip.reference.rotation_deg.0",
    ),
}
KEPT_ZEROS["fixed"] = ()
TEXTS = {"planar": PLANAR, "spatial": SPATIAL}
TOGETHER = 8
FIXED = {"robots.one.base": {"joint": "fixed", "position": [0.1, 0.2, 0]}}


def changed(path: str, value: float) -> float:
    """Another allowed value, far enough to show."""
    if path.endswith(("mass", "scale", "duration", "radius")):
        return 1.1 * value
    if ".inertia." in path and int(path[-1]) < 3:
        return 1.05 * value
    return 1.1 * value + (0.002 if ".inertia." in path or ".com." in path else 0.05)


def scene_with(kind: str, changes: dict[str, float]):
    if kind == "fixed":
        return small_scene(PLANAR, FIXED | ALL | changes)
    return small_scene(TEXTS[kind], ALL | changes)


def found_by(engine, x):
    """Start, rates and outputs without readings: only sensors whose values are not exact have these."""
    outputs = [value for name, value in engine.outputs(0.6, x).items() if not name.startswith("measured_")]
    return engine.x0, engine.rate(0.6, x), np.concatenate(outputs)


@pytest.mark.parametrize("kind", [*TEXTS, "fixed"])
def test_every_parameter_is_what_the_scenario_calls_by_its_path(kind):
    """Several far apart change at once, as a scene takes long to build; each alone must change something."""
    scene = scene_with(kind, {})
    loop = Symbolic(scene, vary=KEPT_ZEROS[kind])
    x, unmoved, all_changes = random_x(scene, np.random.default_rng(1), len(loop.x0)), [], {}
    plain = found_by(loop, x)
    for path, value in zip(loop.loop.parameter_paths, loop.loop.parameter_values, strict=True):
        if kind == "fixed" and not path.startswith("robots.one"):
            continue  # as in the planar scene
        all_changes[path] = changed(path, value)
        loop.change({path: all_changes[path]})
        if all(np.abs(a - b).max() < 1e-9 for a, b in zip(found_by(loop, x), plain, strict=True)):
            unmoved.append(path)
    apart = len(all_changes) // TOGETHER + 1
    for first in range(apart):
        changes = dict([*all_changes.items()][first::apart])
        loop.change(changes)
        rebuilt = Numeric(build_scene(scene.scenario, changes, source=scene.source))
        for found, expected in zip(found_by(loop, x), found_by(rebuilt, x), strict=True):
            scale = max(1.0, np.abs(expected).max())
            assert np.abs(found - expected).max() < 1e-10 * scale, changes
    # limits that are not reached, inertias that turning in a plane hides
    allowed = ["torque_limit"]
    allowed += [] if kind == "spatial" else [".inertia.0", ".inertia.1"]
    assert [path for path in unmoved if not any(part in path for part in allowed)] == []


@pytest.mark.parametrize("name", ["paper", "servicer"])
def test_setup_begins_where_the_scene_does(name):
    scene = load_scene(name)
    loop = Symbolic(scene)
    np.testing.assert_allclose(loop.x0[: scene.model.nq], scene.q, atol=1e-13)
    np.testing.assert_allclose(loop.x0[scene.model.nq :][: scene.model.nv], scene.v, atol=1e-13)
    assert not loop.x0[scene.model.nq + scene.model.nv :].any()


@pytest.mark.parametrize(
    "rpy", [(0, 0, 270), (200, 10, -300), (180, 0, 0), (0, 90, 0), (10, 90, 20), (1, 2, 720)]
)
def test_setup_begins_where_the_scene_does_at_any_attitude(rpy):
    scene = small_scene(SPATIAL, {"robots.one.base.rotation_deg": rpy})
    loop = Symbolic(scene)
    np.testing.assert_allclose(loop.x0[: scene.model.nq], scene.q, atol=1e-13)
    np.testing.assert_allclose(loop.x0[scene.model.nq :][: scene.model.nv], scene.v, atol=1e-13)


@pytest.mark.parametrize("kind", TEXTS)
def test_several_changes_at_once_and_through_a_rollout(kind):
    joint = {"planar": "joint_2", "spatial": "slant"}[kind]
    changes = {
        f"robots.one.joints.{joint}.angle_deg": -33.0,
        "robots.one.base.rotation_deg.2": 77.0,
        "robots.two.base.rotation_deg.2": 150.0,
        "robots.one.base.spin_deg.2": -3.0,
        "robots.one.tips.tip.pid.kp": 21.0,
        "robots.one.tips.tip.amnesia.ta": 0.5,
        "grasps.left.stiffness": 50.0,
        "target.links.body.mass": 15.0,
    }
    through_setup = Symbolic(small_scene(TEXTS[kind]), changes)
    for engine in ENGINES.values():
        rebuilt_scene = small_scene(TEXTS[kind], changes)
        rebuilt = engine(rebuilt_scene)
        np.testing.assert_allclose(through_setup.x0, rebuilt.x0, atol=1e-13)
        x = random_x(rebuilt_scene, np.random.default_rng(7), len(rebuilt.x0))
        found, expected = through_setup.rate(0.3, x), rebuilt.rate(0.3, x)
        np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max())


def test_zeros_are_left_out_unless_they_shall_vary():
    scene = small_scene(PLANAR)
    path = "robots.one.links.link_2.com.1"
    assert path not in build_closed_loop(scene).parameter_paths
    loop = build_closed_loop(scene, [path])
    assert path in loop.parameter_paths
    assert loop.parameters({path: 0.1})[loop.index(path)] == 0.1
    with pytest.raises(ScenarioError, match=r"robots.one.tips.tip.pid.kq: .*did you mean .*pid.kp"):
        loop.index("robots.one.tips.tip.pid.kq")
    with pytest.raises(ScenarioError, match="does not depend on it"):
        build_closed_loop(scene, ["simulation.duration"])


def test_sensors_are_parameters_where_a_controller_reads_them():
    """Of these two robots, only the first has an amnesia controller."""
    paths = build_closed_loop(scene_with("planar", {})).parameter_paths
    assert "robots.one.sensors.tip_position.offset" in paths
    unread = "robots.two.sensors.tip_position.offset"
    assert unread not in paths
    with pytest.raises(ScenarioError, match=f"{unread}: .*does not depend on it"):
        build_closed_loop(scene_with("planar", {}), [unread])
    amnesia = {"robots.two.tips.tip.amnesia": {"ge": 5, "ta": 2}}
    assert unread in build_closed_loop(scene_with("planar", amnesia)).parameter_paths
