"""Sensors with errors: their statistics, the same noise everywhere, both engines, gradients."""

import numpy as np
import pinocchio as pin
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine import simulate
from spacerobot.rollout import build_rollout
from tests.elements.test_sampling import ONE, costed, difference, plate
from tests.oracles.small_scenes import PLANAR, SPATIAL, small_scene

PERIOD, DENSITY, BIAS, WALK = 0.02, 2e-4, 3e-3, 5e-4
DRAW = "simulation.noise_draw"


def seen(duration_s=0.5, draws=(0,), **errors):
    """Spin of a plate as its gyro shows it at its instants, and as it is (draws, samples)."""
    section = {"errors": {"period": PERIOD, "noise": 1e-16} | errors}
    changes = plate(kd=1e-9) | {"robots.one.sensors": {"base_spin": section}}
    changes["simulation.duration"] = duration_s
    loop = build_closed_loop(small_scene(PLANAR, changes))
    rollout = build_rollout(
        loop, duration_s=duration_s, step_s=0.02, output_step_s=PERIOD, backend="interpreted"
    )
    state = rollout.batch([DRAW], np.array(draws, float)[:, None], states=True).state
    names = rollout.loop.state_names
    place = max(i for i, name in enumerate(names) if name.startswith("one.base_spin.3.measured"))
    return state[:, :, place], state[:, :, names.index("v.one/root[2]")]


def test_white_noise_has_the_variance_that_its_density_says():
    """Of 500 samples: within four standard deviations of the mean square, and uncorrelated."""
    shown, true = seen(draws=range(20), noise=DENSITY)
    error = (shown - true)[:, 1:]
    count, variance = error.size, DENSITY**2 / PERIOD
    assert abs((error**2).mean() / variance - 1) < 4 * np.sqrt(2 / count)
    assert abs((error[:, 1:] * error[:, :-1]).mean() / variance) < 4 / np.sqrt(count)
    assert abs(error.mean()) < 4 * np.sqrt(variance / count)


def test_the_bias_begins_anywhere_and_walks_with_its_density():
    shown, true = seen(draws=range(24), duration_s=0.2, bias=BIAS, bias_walk=WALK)
    bias = (shown - true)[:, 1:]
    first, steps = bias[:, 0], np.diff(bias, axis=1)
    # the first sample shown is that after one step of the walk
    assert abs((first**2).mean() / (BIAS**2 + WALK**2 * PERIOD) - 1) < 4 * np.sqrt(2 / len(first))
    assert abs((steps**2).mean() / (WALK**2 * PERIOD) - 1) < 4 * np.sqrt(2 / steps.size)


def test_samples_are_clipped_quantised_lost_and_late():
    shown, true = seen(range=0.02, resolution=1e-3)
    assert np.abs(true).min() > 0.02
    np.testing.assert_allclose(np.abs(shown[:, 1:]), 0.02, atol=1e-12)
    shown, _ = seen(range=0.02, resolution=8e-3)  # 0.024 would be nearer to what is larger than 0.02
    np.testing.assert_allclose(np.abs(shown[:, 1:]), 0.02, atol=1e-12)
    shown, true = seen(resolution=1e-3)
    np.testing.assert_allclose(shown[:, 1:], 1e-3 * np.round(true[:, 1:] / 1e-3), atol=1e-12)
    shown, _ = seen(draws=range(10), noise=DENSITY, dropout=0.25)
    same = (np.diff(shown[:, 1:], axis=1) == 0).mean()
    assert abs(same - 0.25) < 4 * np.sqrt(0.25 * 0.75 / 240)
    early, _ = seen(noise=DENSITY)
    late, _ = seen(noise=DENSITY, delay=2.5 * PERIOD)
    np.testing.assert_allclose(late[:, 4:], early[:, 1:-3], atol=1e-12)
    assert np.ptp(early) > 1e-4


def test_the_draw_below_zero_has_no_errors():
    """Not even lost samples, however many there are in other draws."""
    shown, true = seen(draws=[-1], noise=DENSITY, bias=BIAS, bias_walk=WALK, dropout=0.9)
    np.testing.assert_allclose(shown[:, 1:], true[:, 1:], atol=1e-12)


ERRORS = {"period": 0.02, "delay": 0.03, "noise": 1e-4, "bias": 1e-3, "bias_walk": 1e-4, "dropout": 0.2}
NOISY = {
    f"{ONE}.sampled": {"period": 0.02},
    "simulation.duration": 0.3,
    "robots.one.joint_pd": {"kp": 5.0, "kd": 1.0},
    "robots.one.sensors": {
        "joint_rate": {"errors": ERRORS},
        "joint_position": {"errors": {"period": 0.05, "noise": 1e-3, "resolution": 1e-3, "range": 1.0}},
        "tip_position": {"offset": 0.001, "errors": {"period": 0.02, "noise": 1e-4}},
    },
}
SEEN = {
    "grasps": {},
    "target.base": {"joint": "planar", "position": [1.9, 0.45, 0], "velocity": [0.05, -0.03, 0]},
    "robots.two.base": {"joint": "planar", "position": [8, 0, 0]},
    "robots.one.tips.tip.reference": {
        "kind": "rendezvous",
        "frame": "mate_2",
        "approach_time": 0.4,
        "standoff": 0.3,
        "end_distance": 0.3,
    },
    "robots.one.sensors": {
        "target_position": {"errors": {"period": 0.05, "delay": 0.02, "noise": 1e-3, "noise_growth": 2.0}}
    },
    "simulation.duration": 0.3,
}


@pytest.mark.parametrize(
    ("text", "changes"),
    [(PLANAR, NOISY), (SPATIAL, NOISY), (PLANAR, SEEN)],
    ids=["planar", "spatial", "of the target"],
)
def test_both_engines_see_the_same_noise(text, changes):
    scene = small_scene(text, changes)
    loop = build_closed_loop(scene)
    rollout = build_rollout(loop, duration_s=0.12, step_s=0.004, output_step_s=0.06, backend="interpreted")
    own, other = rollout.run(), simulate(scene, duration_s=0.12, output_step_s=0.06)
    np.testing.assert_allclose(own.state, other.state, atol=1e-9)
    another = rollout.run({DRAW: 1.0})
    assert np.abs(another.state - own.state).max() > 1e-4
    if text is SPATIAL:
        return
    drawn = simulate(small_scene(text, changes | {DRAW: 1}), duration_s=0.12, output_step_s=0.06)
    np.testing.assert_allclose(another.state, drawn.state, atol=1e-9)


def test_noise_depends_on_draw_and_sensor_alone():
    alone, _ = seen(draws=(3, 4), noise=DENSITY)
    both, _ = seen(draws=(4, 3, 9), noise=DENSITY)
    np.testing.assert_array_equal(alone[::-1], both[:2])
    assert (both[0, 1:] != both[2, 1:]).all()


def test_gradients_hold_the_noise_fixed():
    changes = NOISY | {"robots.one.sensors": {"joint_rate": {"errors": ERRORS | {"period": 0.043}}}}
    rollout = costed(changes, 0.26, backend="interpreted")
    paths = {f"{ONE}.kp": 0.3, "robots.one.sensors.joint_rate.errors.noise": 1e-5}
    for path, step in paths.items():
        found = rollout.value_and_gradient(wrt=[path])
        assert found.status == ("exact",)
        np.testing.assert_allclose(found.gradients["x"][0], difference(rollout, path, step), rtol=1e-7)


AT, GAIN = 0.21, 40.0
SECTIONS = {
    "noisy": {"errors": {"period": PERIOD, "noise": DENSITY}},
    "sampled": {"kind": "sampled", "period": PERIOD},
    "continuous": {},
}


def damped(section, failure=None, duration_s=0.4):
    """A plate whose spin a rate controller brings to rest, with a gyro that may fail."""
    fails = {"failure": {"at": AT} | failure} if failure else {}
    changes = plate(kd=GAIN) | {"simulation.duration": duration_s}
    changes["robots.one.sensors"] = {"base_spin": section | fails}
    return costed(changes, duration_s, backend="interpreted", output_step_s=PERIOD)


def readings(rollout):
    """What the gyro showed last, and the spin itself (samples,)."""
    run, names = rollout.run(), rollout.loop.state_names
    shown = max(i for i, name in enumerate(names) if name.startswith("one.base_spin.3.measured"))
    return run.state[:, shown], run.state[:, names.index("v.one/root[2]")]


@pytest.mark.parametrize("kind", ["noisy", "sampled"])
def test_a_sampled_sensor_fails(kind):
    intact, _ = readings(damped(SECTIONS[kind]))
    for mode in ("frozen", "lost"):
        shown, _ = readings(damped(SECTIONS[kind], {"mode": mode}))
        np.testing.assert_array_equal(shown[:11], intact[:11])
        np.testing.assert_array_equal(shown[11:], shown[11])
        assert np.ptp(intact[12:]) > 1e-4
    shown, true = readings(damped(SECTIONS[kind], {"mode": "drifting", "rate": 0.3}))
    noise, spin = intact - readings(damped(SECTIONS[kind]))[1], true
    ramp = 0.3 * np.maximum(PERIOD * np.arange(len(shown)) - AT, 0)
    np.testing.assert_allclose(shown[1:], (spin + noise + ramp)[1:], atol=1e-9)


def test_a_continuous_sensor_fails():
    """w' = -k s, with s the spin w, then what it was or w and a ramp: an exponential, then closed forms."""
    spin = damped({}).run().state[:, damped({}).loop.state_names.index("v.one/root[2]")]
    t = PERIOD * np.arange(len(spin))
    k = -np.log(spin[10] / spin[0]) / t[10]
    after, last = t[11:] - AT, spin[0] * np.exp(-k * AT)
    expected = {
        "frozen": last * (1 - k * after),
        "lost": last * (1 - k * after),
        "drifting": last * np.exp(-k * after) + 0.3 / k * (1 - np.exp(-k * after) - k * after),
    }
    for mode, value in expected.items():
        rollout = damped({}, {"mode": mode, "rate": 0.3})
        run = rollout.run()
        found = run.state[:, rollout.loop.state_names.index("v.one/root[2]")]
        np.testing.assert_allclose(found[:11], spin[:11], atol=1e-12)
        np.testing.assert_allclose(found[11:], value, rtol=1e-7, atol=1e-10)


def test_a_frozen_sensor_looks_new_and_a_lost_one_does_not():
    """The time of the last sample, by which filters make updates."""
    filtered = {"robots.one.estimators": {"attitude": {"kind": "attitude_filter"}}}
    gyro, tracker = {"kind": "gyro"}, {"kind": "star_tracker", "errors": {"period": 0.05, "noise": 1e-5}}
    times = {}
    for mode in ("frozen", "lost"):
        sensors = {"base_spin": gyro, "base_orientation": tracker | {"failure": {"at": 0.12, "mode": mode}}}
        changes = plate(kp=10.0, kd=GAIN) | filtered
        changes |= {"robots.one.sensors": sensors, "simulation.duration": 0.4}
        rollout = costed(changes, 0.4, backend="interpreted", output_step_s=0.1)
        run, names = rollout.run(), rollout.loop.state_names
        places = [
            i for i, name in enumerate(names) if name.startswith("one/attitude.base_orientation.measured")
        ]
        times[mode] = run.state[:, places[-1]]
        np.testing.assert_array_equal(run.state[2:, places[:-1]], run.state[2:3, places[:-1]].repeat(3, 0))
    np.testing.assert_allclose(times["frozen"][1:], [0.1, 0.2, 0.3, 0.4], atol=1e-12)
    np.testing.assert_allclose(times["lost"][1:], 0.1, atol=1e-12)


@pytest.mark.parametrize("mode", ["frozen", "drifting"])
@pytest.mark.parametrize("kind", ["noisy", "continuous"])
def test_gradients_by_the_time_at_which_a_sensor_fails_are_exact(kind, mode):
    """A sampled sensor that freezes between two samples does the same whenever that is."""
    rollout, path = (
        damped(SECTIONS[kind], {"mode": mode, "rate": 0.3}),
        "robots.one.sensors.base_spin.failure.at",
    )
    found = rollout.value_and_gradient(wrt=[path])
    assert found.status == ("exact",)
    expected = difference(rollout, path, 1e-3)
    np.testing.assert_allclose(found.gradients["x"][0], expected, rtol=1e-6, atol=1e-12)
    assert (abs(expected) > 1e-6) == ((kind, mode) != ("noisy", "frozen"))


@pytest.mark.parametrize("kind", ["noisy", "continuous"])
def test_both_engines_agree_on_a_sensor_that_fails(kind):
    changes = plate(kd=GAIN) | {"simulation.duration": 0.3}
    changes["robots.one.sensors"] = {"base_spin": SECTIONS[kind] | {"failure": {"at": AT}}}
    scene = small_scene(PLANAR, changes)
    rollout = build_rollout(
        build_closed_loop(scene), duration_s=0.3, step_s=0.01, output_step_s=0.1, backend="interpreted"
    )
    other = simulate(scene, duration_s=0.3, output_step_s=0.1)
    np.testing.assert_allclose(rollout.run().state, other.state, atol=1e-9)


@pytest.mark.compiler
def test_lanes_see_the_noise_of_single_rollouts():
    changes = plate(kp=40, kd=20) | {"simulation.duration": 0.2}
    changes["robots.one.sensors"] = {"base_spin": {"errors": {"period": 0.02, "noise": 1e-3}}}
    found = []
    for backend in ("interpreted", "compiled"):
        rollout = costed(changes, 0.2, backend=backend)
        found.append(rollout.batch([DRAW], np.arange(9.0)[:, None]).costs["x"])
    np.testing.assert_allclose(*found, rtol=1e-12)
    assert len(np.unique(found[0])) == 9


@pytest.mark.parametrize(
    ("kind", "signal", "streams"),
    [
        ("gyro", "base_spin", ["", ".bias", ".walk"]),
        ("star_tracker", "base_orientation", [""]),
        ("joint_encoder", "joint_position", []),
        ("camera_position", "target_position", [""]),
    ],
)
def test_presets_have_their_errors(kind, signal, streams):
    changes = plate(kp=40, kd=20) if signal.startswith("base_") else {"robots.one.joint_pd": {"kp": 5.0}}
    changes |= SEEN if signal.startswith("target_") else {}
    changes |= {"robots.one.sensors": {signal: {"kind": kind}}}
    loop = build_closed_loop(small_scene(PLANAR, changes))
    assert sorted(table.sensor.partition(signal)[2].removeprefix(".3") for table in loop.noise) == streams
    assert any(signal in name and ".measured" in name for name in loop.state_names)


def test_only_the_numbers_that_are_used_are_drawn():
    """Of three components for 100 samples: white noise alone, and with a bias and lost samples."""
    for errors, count in (({"noise": 1e-4}, 3 * 102), ({"noise": 1e-4, "bias": 1e-4, "dropout": 0.1}, 411)):
        changes = plate(kd=1) | {"simulation.duration": 1.0}
        changes["robots.one.sensors"] = {"base_spin": {"errors": {"period": 0.01} | errors}}
        loop = build_closed_loop(small_scene(PLANAR, changes))
        assert sum(table.rows * table.width for table in loop.noise) == count


def test_white_noise_is_the_same_whether_or_not_the_bias_walks():
    alone, _ = seen(noise=DENSITY)
    drifting, _ = seen(noise=DENSITY, bias_walk=1e-15)
    np.testing.assert_allclose(alone, drifting, atol=1e-12)


@pytest.mark.parametrize("text", [PLANAR, SPATIAL], ids=["planar", "spatial"])
def test_a_misaligned_gyro_shows_the_spin_in_its_own_axes(text):
    """What is read in axes turned by exp(m) is taken for what is in the base's: R exp(m)^T R^T w."""
    turn = [3.0, -2.0, 5.0]
    changes = {
        "robots.one.controllers": {"turn": {"kind": "base_attitude", "kd": 1e-9, "feed_forward": 0.0}},
        "robots.one.actuators": {"ideal": {"kind": "base_wrench"}},
        "robots.one.sensors": {"base_spin": {"errors": {"period": 0.05, "misalignment_deg": turn}}},
    }
    scene = small_scene(text, changes)
    rollout = build_rollout(
        build_closed_loop(scene), duration_s=0.1, step_s=0.01, output_step_s=0.05, backend="interpreted"
    )
    run, names = rollout.run(), rollout.loop.state_names
    places = [i for i, name in enumerate(names) if name.startswith("one.base_spin.3.measured")]
    root = next(body for body in scene.robots if body.name == "one").root_frame
    model, x = scene.model, run.state[-1]
    data = model.createData()
    pin.forwardKinematics(model, data, x[: model.nq], x[model.nq : model.nq + model.nv])
    pin.updateFramePlacements(model, data)
    true = pin.getFrameVelocity(model, data, root, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED).angular
    axes = data.oMf[root].rotation
    wanted = axes @ pin.exp3(np.radians(turn)).T @ axes.T @ true
    np.testing.assert_allclose(x[places], wanted, atol=1e-12)
    assert np.abs(wanted - true).max() > 1e-4


@pytest.mark.parametrize(
    ("section", "told"),
    [
        ({"period": 0.0}, r"errors\.period: found 0\.0, allowed: above 0"),
        ({"period": 0.01, "delay": 0.2}, r"delay: found 0\.2 s, allowed: at most 16 periods, 0\.16 s"),
        ({"period": 0.01, "dropout": 1.0}, r"dropout: found 1\.0, allowed: below 1"),
        ({"period": 0.01, "misalignment_deg": [0, 0, 1]}, r"joint_rate\.errors\.misalignment_deg: found one"),
    ],
)
def test_errors_that_cannot_be_are_refused(section, told):
    with pytest.raises(ScenarioError, match=told):
        small_scene(PLANAR, {"robots.one.sensors": {"joint_rate": {"errors": section}}})
