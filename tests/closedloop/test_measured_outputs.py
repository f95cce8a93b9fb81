"""Outputs of what sensors measured: true values with the errors of the sections, frames, labels, engines."""

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.pinocchio_engine import simulate
from spacerobot.rollout import build_rollout
from spacerobot.symbolic.noise import NoiseTable
from tests.elements.test_attitude_filter import BOX
from tests.elements.test_attitude_filter import filtered as with_attitude_filter
from tests.elements.test_sensor_errors import NOISY, SEEN
from tests.elements.test_target_filter import BOXES, LOCKED, PLACE, TURN
from tests.elements.test_target_filter import PERIOD as IMAGES
from tests.elements.test_target_filter import filtered as with_target_filter
from tests.oracles.small_scenes import PLANAR, SPATIAL, small_scene

PERIOD, COUNT = 0.02, 6
OFFSET, SCALE, BIAS, WALK, DENSITY, STEP = 0.01, 1.02, 3e-3, 5e-4, 2e-4, 1e-4
TIP = {"period": PERIOD, "noise": DENSITY, "bias": BIAS, "bias_walk": WALK, "resolution": STEP}
TIP_SENSOR = {"tip_position": {"offset": OFFSET, "scale": SCALE, "errors": TIP}}


def rolled(text, changes, period, **options):
    """A scene, its closed loop and a rollout with two samples in each period of a sensor."""
    scene = small_scene(text, {"simulation.duration": COUNT * period} | changes)
    loop = build_closed_loop(scene)
    steps = {"step_s": period / 4, "output_step_s": period / 2, "backend": "interpreted"} | options
    return scene, loop, build_rollout(loop, duration_s=COUNT * period, **steps).run()


def normal(name, rows, width):
    """Standard normal numbers of a sensor (rows, width) in draw 0."""
    return NoiseTable(name, rows, width).drawn(0, 0).reshape(rows, width)


def biases(name, bias, walk, period):
    """Bias at each sample (COUNT, 3): its first value, and a random walk."""
    steps = walk * period**0.5 * normal(f"{name}.walk", COUNT, 3)
    steps[0] = bias * normal(f"{name}.bias", 1, 3)[0]
    return np.cumsum(steps, axis=0)


def part(run, loop, name, label):
    """An output of one label at all samples (samples, n)."""
    variable = next(one for one in loop.variables if one.name == name)
    values = run.outputs[name].reshape(len(run.time), len(variable.labels), -1)
    return values[:, variable.labels.index(label)]


def after(values):
    """Values between the instants of measurement, of twice as many samples."""
    return values[1::2]


def at(values):
    """Values at the instants of measurement but the last."""
    return values[:-1:2]


def frame_positions(scene, run, name):
    """Positions of a frame at all samples (samples, 3)."""
    data, frame = scene.model.createData(), scene.model.getFrameId(name)
    found = []
    for q in run.state[:, : scene.model.nq]:
        pin.framesForwardKinematics(scene.model, data, q)
        found.append(data.oMf[frame].translation.copy())
    return np.array(found)


def frame_rotations(scene, run, name):
    """Rotations of a frame at all samples (samples, 3, 3)."""
    data, frame = scene.model.createData(), scene.model.getFrameId(name)
    found = []
    for q in run.state[:, : scene.model.nq]:
        pin.framesForwardKinematics(scene.model, data, q)
        found.append(data.oMf[frame].rotation.copy())
    return np.array(found)


def test_what_a_controller_reads_has_bias_noise_and_steps_of_the_resolution():
    _, loop, run = rolled(SPATIAL, {"robots.one.sensors": TIP_SENSOR}, PERIOD)
    name = "one/tip.tip_position.3"
    exact = OFFSET + SCALE * at(part(run, loop, "tip_position", "one/tip"))
    exact += biases(name, BIAS, WALK, PERIOD) + DENSITY / PERIOD**0.5 * normal(name, COUNT, 3)
    shown = after(part(run, loop, "measured_tip_position", "one/tip"))
    assert shown.shape == (COUNT, 3)
    assert np.abs(shown - exact).max() < STEP / 2 + 1e-9
    np.testing.assert_allclose(shown, STEP * np.round(exact / STEP), atol=1e-9)
    assert np.isnan(part(run, loop, "measured_tip_position", "two/tip")).all()


def test_what_an_attitude_filter_reads_is_in_body_axes_and_since_the_start():
    changes = with_attitude_filter()
    changes["robots.chaser.sensors"]["base_orientation"]["errors"]["period"] = 0.05
    _, loop, run = rolled(BOX, changes, 0.05)
    gyro, tracker = (
        changes["robots.chaser.sensors"][f"base_{key}"]["errors"] for key in ("spin", "orientation")
    )
    spin = run.state[:, [loop.state_names.index(f"v.chaser/root[{i}]") for i in (3, 4, 5)]]
    name = "chaser/known.base_spin"
    exact = at(spin) + biases(name, gyro["bias"], gyro["bias_walk"], 0.05)
    exact += gyro["noise"] / 0.05**0.5 * normal(name, COUNT, 3)
    shown = after(part(run, loop, "measured_base_spin_body", "chaser"))
    np.testing.assert_allclose(shown, exact, atol=1e-9)
    noise = tracker["noise"] / 0.05**0.5 * normal("chaser/known.base_orientation", COUNT, 3)
    shown = after(part(run, loop, "measured_base_orientation", "chaser"))
    for turn, error, true in zip(shown, noise, at(part(run, loop, "body_rotation", "chaser")), strict=True):
        np.testing.assert_allclose(pin.exp3(turn), pin.exp3(error) @ pin.exp3(true), atol=1e-9)
    assert "measured_base_spin" not in run.outputs


def test_what_a_target_filter_reads_is_a_place_in_the_world_and_a_rotation_since_the_start():
    scene, loop, run = rolled(BOXES, with_target_filter("left") | LOCKED, IMAGES)
    noise = PLACE * normal("chaser/seen.target_position", COUNT, 3)
    shown = after(part(run, loop, "measured_target_position", "chaser/eye"))
    exact = at(frame_positions(scene, run, "target/left"))
    np.testing.assert_allclose(shown, exact + noise, atol=1e-8)
    noise = TURN * normal("chaser/seen.target_orientation", COUNT, 3)
    shown = after(part(run, loop, "measured_target_orientation", "chaser/eye"))
    for turn, error, true in zip(shown, noise, at(part(run, loop, "body_rotation", "target")), strict=True):
        np.testing.assert_allclose(pin.exp3(turn), pin.exp3(error) @ pin.exp3(true), atol=1e-8)


COARSE, REACH = 0.04, 0.75
"""Resolution and range [m or rad]: relative to the tip some components are below the range, some above."""


def coarse(values):
    """Values of a sensor that is coarse and does not reach far."""
    return np.clip(COARSE * np.round(values / COARSE), -REACH, REACH)


def coarse_turn(rotation):
    """Rotation whose rotation vector such a sensor shows."""
    return pin.exp3(coarse(pin.log3(rotation)))


COARSE_ERRORS = {"resolution": COARSE, "range": REACH}


def test_resolution_and_range_of_a_reference_act_on_the_vector_from_the_tip():
    errors = {"period": PERIOD, "noise": 1e-3} | COARSE_ERRORS
    changes = SEEN | {"robots.one.sensors": {"target_position": {"errors": errors}}}
    scene, loop, run = rolled(PLANAR, changes, PERIOD)
    name = "one/tip.robots.one.tips.tip.reference.target_position"
    tip = at(part(run, loop, "tip_position", "one/tip"))[:, :2]
    away = at(frame_positions(scene, run, "target/mate_2"))[:, :2] - tip
    away += 1e-3 / PERIOD**0.5 * normal(name, COUNT, 2)
    shown = after(part(run, loop, "measured_target_position", "one/tip"))[:, :2]
    np.testing.assert_allclose(shown, tip + coarse(away), atol=1e-8)
    assert np.abs(tip + away).max() > REACH > np.abs(away).min()


def test_resolution_and_range_of_a_target_filter_act_on_the_pose_from_the_tip():
    changes = with_target_filter("left") | LOCKED
    for sensor in changes["robots.chaser.sensors"].values():
        sensor["errors"] = sensor["errors"] | COARSE_ERRORS
    changes["robots.chaser.base.position"] = [-2, 3, 0]
    changes["robots.chaser.base.rotation_deg"] = [20, -50, 80]
    scene, loop, run = rolled(BOXES, changes, IMAGES)
    tip = at(part(run, loop, "tip_position", "chaser/eye"))
    away = at(frame_positions(scene, run, "target/left")) - tip
    away += PLACE * normal("chaser/seen.target_position", COUNT, 3)
    shown = after(part(run, loop, "measured_target_position", "chaser/eye"))
    np.testing.assert_allclose(shown, tip + coarse(away), atol=1e-8)
    frames = ("target/left", "target/" + scene.target.description.root, "chaser/right")
    link, root, camera = (at(frame_rotations(scene, run, frame)) for frame in frames)
    noise = TURN * normal("chaser/seen.target_orientation", COUNT, 3)
    shown = after(part(run, loop, "measured_target_orientation", "chaser/eye"))
    for k, turn in enumerate(shown):
        seen = coarse_turn(pin.exp3(noise[k]) @ link[k] @ camera[k].T) @ camera[k]
        np.testing.assert_allclose(pin.exp3(turn), seen @ link[k].T @ root[k] @ root[0].T, atol=1e-8)


def test_resolution_and_range_of_a_star_tracker_act_on_the_rotation_since_the_start():
    changes = with_attitude_filter()
    section = changes["robots.chaser.sensors"]["base_orientation"]
    section = section | {"errors": section["errors"] | {"period": 1.0} | COARSE_ERRORS}
    changes["robots.chaser.sensors"] = changes["robots.chaser.sensors"] | {"base_orientation": section}
    changes["robots.chaser.base.rotation_deg"] = [20, -50, 80]
    _, loop, run = rolled(BOX, changes, 1.0)
    noise = section["errors"]["noise"] * normal("chaser/known.base_orientation", COUNT, 3)
    shown = after(part(run, loop, "measured_base_orientation", "chaser"))
    turned = at(part(run, loop, "body_rotation", "chaser"))
    for turn, error, true in zip(shown, noise, turned, strict=True):
        np.testing.assert_allclose(turn, coarse(pin.log3(pin.exp3(error) @ pin.exp3(true))), atol=1e-8)
    assert np.ptp(shown) > 4 * COARSE


@pytest.mark.parametrize("phases", [False, True])
def test_what_a_reference_reads_is_a_place_in_the_world(phases):
    """The error grows with the distance; the reference of the second phase has an error of its own."""
    follow = SEEN["robots.one.tips.tip.reference"]
    errors = {"period": PERIOD, "noise": 1e-3, "noise_growth": 2.0}
    changes = SEEN | {"robots.one.sensors": {"target_position": {"errors": errors}}}
    path = "robots.one.tips.tip.reference"
    if phases:
        changes["phases"] = {
            "first": {"until": {"time": 3.3 * PERIOD}},
            "second": {"robots": {"one": {"tips": {"tip": {"reference": follow | {"frame": "mate_1"}}}}}},
        }
    scene, loop, run = rolled(PLANAR, changes, PERIOD)
    measured = [name for name in loop.state_names if name.endswith(".target_position.measured[0]")]
    names = [name.removesuffix(".measured[0]") for name in measured]
    assert len(names) == 1 + phases
    assert names[0] == f"one/tip.{path}.target_position"
    shown, tip = (
        after(part(run, loop, "measured_target_position", "one/tip")),
        part(run, loop, "tip_position", "one/tip"),
    )
    for begin, end, name, frame in (
        (0, 3, names[0], "mate_2"),
        (4, COUNT, names[-1], "mate_1" if phases else "mate_2"),
    ):
        true = frame_positions(scene, run, f"target/{frame}")
        away = np.linalg.norm(part(run, loop, "body_position", "target") - tip, axis=1)
        spread = 1e-3 / PERIOD**0.5 * (1 + 2.0 * at(away))[:, None]
        exact = (at(true)[:, :2] + spread * normal(name, COUNT, 2))[begin:end]
        np.testing.assert_allclose(shown[begin:end, :2], exact, atol=1e-8)


LINEAR = {"offset": OFFSET, "scale": SCALE}


def test_a_continuous_sensor_with_offset_and_scale_shows_its_present_reading():
    signals = ("tip_position", "joint_rate", "joint_position")
    sensors = dict.fromkeys(signals, LINEAR) | {"tip_velocity": LINEAR}
    changes = {"robots.one.sensors": sensors, "robots.one.joint_pd": {"kp": 2}}
    _, loop, run = rolled(SPATIAL, changes, PERIOD)
    shown = part(run, loop, "measured_tip_position", "one/tip")
    np.testing.assert_allclose(shown, OFFSET + SCALE * part(run, loop, "tip_position", "one/tip"), atol=1e-12)
    for signal, symbol in (("joint_rate", "v"), ("joint_position", "q")):
        true = run.state[:, [loop.state_names.index(f"{symbol}.one/slide")]]
        shown = part(run, loop, f"measured_{signal}", "one/slide")
        np.testing.assert_allclose(shown, OFFSET + SCALE * true, atol=1e-12)
    assert "measured_tip_velocity" not in run.outputs  # no controller reads it


def test_the_vector_to_the_target_by_a_continuous_sensor_is_shown_as_a_place_in_the_world():
    changes = SEEN | {"robots.one.sensors": {"target_position": LINEAR}}
    scene, loop, run = rolled(PLANAR, changes, PERIOD)
    tip = part(run, loop, "tip_position", "one/tip")[:, :2]
    away = frame_positions(scene, run, "target/mate_2")[:, :2] - tip
    shown = part(run, loop, "measured_target_position", "one/tip")[:, :2]
    np.testing.assert_allclose(shown, tip + OFFSET + SCALE * away, atol=1e-10)


def test_exact_sensors_have_no_output_unless_a_number_of_theirs_varies_or_a_phase_sets_it():
    path = "robots.one.sensors.tip_position.offset"
    changes = {"robots.one.sensors": {"tip_position": {"offset": 0.0}}}

    def names(more, vary=()):
        loop = build_closed_loop(small_scene(SPATIAL, changes | more), vary=vary)
        return [one.name for one in loop.variables if one.name.startswith("measured_")]

    assert names({}) == []
    assert names({}, vary=[path]) == ["measured_tip_position"]
    section = {"robots": {"one": {"sensors": {"tip_position": {"offset": OFFSET}}}}}
    assert names({"phases": {"first": {"until": {"time": 0.1}}, "second": section}}) == [
        "measured_tip_position"
    ]


def test_units_labels_and_frames_are_stated():
    loop = build_closed_loop(small_scene(SPATIAL, NOISY))
    seen = {one.name: one for one in loop.variables if one.name.startswith("measured_")}
    assert set(seen) == {"measured_joint_rate", "measured_joint_position", "measured_tip_position"}
    tip = seen["measured_tip_position"]
    assert (tip.unit, tip.dims) == ("m", ("tip", "axis"))
    assert "world's origin, world axes" in tip.text
    joints = seen["measured_joint_rate"]
    assert (joints.unit, joints.dims) == ("rad/s or m/s", ("driven_joint",))
    assert joints.labels == tuple(f"one/{name}" for name in ("slant", "round", "slide", "wrist"))


@pytest.mark.parametrize(
    ("text", "changes"),
    [
        (SPATIAL, NOISY),
        (PLANAR, SEEN),
        (BOXES, with_target_filter("left") | LOCKED),
        (SPATIAL, {"robots.one.sensors": {"tip_position": LINEAR}}),
    ],
    ids=["controllers", "reference", "filter", "continuous"],
)
def test_both_engines_show_the_same(text, changes):
    scene = small_scene(text, changes | {"simulation.duration": 0.3})
    rollout = build_rollout(
        build_closed_loop(scene), duration_s=0.12, step_s=0.004, output_step_s=0.06, backend="interpreted"
    )
    one, other = rollout.run(), simulate(scene, duration_s=0.12, output_step_s=0.06)
    names = [name for name in one.outputs if name.startswith("measured_")]
    assert names
    for name in names:
        np.testing.assert_allclose(one.outputs[name], other.outputs[name], atol=1e-9)
