"""Target filter: against Gaussian conditioning, consistency, inertia ratios, engines, gradients, errors."""

import numpy as np
import pytest
from scipy.stats import chi2

import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine import simulate
from spacerobot.rollout import build_rollout
from spacerobot.symbolic.noise import NoiseTable
from tests.elements.test_sampling import costed, difference
from tests.elements.test_sensor_errors import SEEN as FOLLOWED
from tests.oracles.gaussian import chained, conditioned
from tests.oracles.small_scenes import PLANAR, small_scene

DRAW, PERIOD, PLACE, TURN = "simulation.noise_draw", 0.5, 4e-3, 8e-3
FIRST = {"position": 0.1, "velocity": 0.02, "attitude_deg": 4.0, "spin_deg": 1.5}
SCENE = """
name: seen
robots:
  chaser:
    urdf: {urdf}
    base: {{joint: {joint}, position: [-2, 0, 0], spin_deg: [0, 0, 2]}}
    tips: {{eye: {{frame: {eye}}}}}
target:
  urdf: {urdf}
  base: {{joint: {joint}, spin_deg: {spin}, velocity: {velocity}, rotation_deg: [0, 0, 30]}}
simulation: {{duration: 12, step: 0.1, output_step: 0.5}}
"""
PLATES = SCENE.format(
    urdf="plate.urdf", joint="planar", eye="mate_1", spin=[0, 0, 8], velocity=[0.02, 0.01, 0]
)
BOXES = SCENE.format(
    urdf="flapped_box.urdf", joint="free_flyer", eye="right", spin=[20, -8, 15], velocity=[0.02, 0.01, -0.01]
)
FILTERS = "examples/filters.yaml"
LOCKED = {"robots.chaser.joints.hinge.locked": True, "target.joints.hinge.locked": True}


def camera(delay_s=0.0, robot="chaser", growth=0.0):
    """Changes that give a robot a camera that sees the target's pose."""
    errors = {"period": PERIOD, "delay": delay_s, "noise_growth": growth}
    return {
        f"robots.{robot}.sensors": {
            "target_position": {"errors": errors | {"noise": PLACE * PERIOD**0.5}},
            "target_orientation": {"errors": errors | {"noise": TURN * PERIOD**0.5}},
        }
    }


def filtered(frame, delay_s=0.0, growth=0.0, **section):
    """Changes for the scenes with two free bodies."""
    own = {"kind": "target_filter", "tip": "eye", "frame": frame} | FIRST | section
    return camera(delay_s, growth=growth) | {"robots.chaser.estimators": {"seen": own}}


def rolled(text, changes, duration_s, **options):
    loop = build_closed_loop(small_scene(text, changes))
    steps = {"step_s": 0.1, "output_step_s": PERIOD / 2} | options
    return build_rollout(loop, duration_s=duration_s, **steps)


def states(rollout, run, name):
    """A state of the filter or of a sensor at all samples (samples, n)."""
    names = rollout.loop.state_names
    return run.state[:, [i for i, own in enumerate(names) if own.startswith(f"chaser/seen{name}[")]]


@pytest.mark.parametrize("delay_s", [0.0, 0.3])
def test_in_the_plane_it_is_the_conditional_expectation(delay_s):
    """Seen at its centre of mass, a body's place and angle are two linear systems with a rate each."""
    accelerations = {"acceleration": 1e-3, "spin_acceleration": 2e-3}
    rollout = rolled(PLATES, filtered("body", delay_s, **accelerations), 4.0, backend="interpreted")
    run = rollout.run()
    after = slice(2, None, 2) if delay_s else slice(1, None, 2)  # after each arrival
    mean, known = (states(rollout, run, name)[after] for name in (".mean", ".covariance"))
    place, turn = (
        states(rollout, run, f".target_{name}.measured")[after] for name in ("position", "orientation")
    )
    draws = NoiseTable("chaser/seen.begin", 1, 6).drawn(0, 0)
    deviations = np.radians([1, 1, 1, 1, FIRST["attitude_deg"], FIRST["spin_deg"]])
    deviations[:4] = [FIRST["position"]] * 2 + [FIRST["velocity"]] * 2
    mean, begin = motions(mean), motions(states(rollout, run, ".mean")[:1])[0] + deviations * draws
    square = symmetric(known, 6)
    for axis, rate, shown, noise, density in (
        (0, 2, place[:, 0], PLACE, 1e-3),
        (1, 3, place[:, 1], PLACE, 1e-3),
        (4, 5, np.arctan2(turn[:, 1], turn[:, 0]), TURN, 2e-3),
    ):
        spread = np.diag(deviations[[axis, rate]] ** 2)
        pushed = density**2 * np.array([[PERIOD**3 / 3, PERIOD**2 / 2], [PERIOD**2 / 2, PERIOD]])
        count = len(shown)
        first, joint = chained(
            begin[[axis, rate]], spread, np.array([[1, PERIOD], [0, 1]]), np.zeros((count - 1, 2)), pushed
        )
        for k in range(count):
            rows = np.eye(2 * count)[0 : 2 * k + 1 : 2]
            found, left = conditioned(first, joint, rows, shown[: k + 1], noise**2)
            own = slice(2 * k, 2 * k + 2)
            np.testing.assert_allclose(mean[k, [axis, rate]], found[own], rtol=0, atol=1e-12)
            np.testing.assert_allclose(
                square[k][np.ix_([axis, rate], [axis, rate])], left[own, own], rtol=1e-9, atol=1e-17
            )
    assert count == 8
    assert np.abs(mean[-1] - mean[0]).max() > 1e-3


def motions(numbers):
    """Motions (k, 6) with the angle in place of its cosine and sine (k, 7)."""
    return np.column_stack([numbers[:, :4], np.arctan2(numbers[:, 5], numbers[:, 4]), numbers[:, 6]])


def symmetric(entries, size):
    """Symmetric matrices (k, n, n) of their upper triangles, row by row (k, n (n + 1) / 2)."""
    found = np.zeros((len(entries), size, size))
    above = np.triu_indices(size)
    found[:, above[0], above[1]] = entries
    found[:, above[1], above[0]] = entries
    return found


def consistent(values, freedoms):
    """Whether the mean of values is inside the 95 % bounds of a chi-squared distribution."""
    low, high = chi2.ppf([0.025, 0.975], freedoms * len(values)) / len(values)
    return low < values.mean() < high


def test_errors_are_as_large_as_the_covariance_says():
    """NEES and NIS of 40 draws, of a frame aside the centre of mass, seen late and with growing noise."""
    changes = filtered("mate_2", 0.3, growth=0.4) | {"simulation.duration": 2.2}
    draws, names = {DRAW: np.arange(40.0)}, {"target_nees": 6, "target_nis": 3}
    found = sr.batch(small_scene(PLATES, changes), list(names), draws, backend="interpreted").data
    for name, freedoms in names.items():
        assert consistent(found[name].values.ravel(), freedoms)


@pytest.mark.parametrize(
    ("delay_s", "lost"),
    [(0.0, {"position": 0.4, "orientation": 0.4}), (0.3, {"position": 0.5}), (0.3, {"orientation": 0.5})],
)
def test_samples_that_drop_out_reduce_the_degrees_of_freedom_of_the_nis(delay_s, lost):
    """Counted from the recorded samples: position has two components, angle one; NIS inside those bounds."""
    changes = filtered("mate_2", delay_s)
    for name, probability in lost.items():
        changes[f"robots.chaser.sensors.target_{name}.errors.dropout"] = probability
    rollout = rolled(PLATES, changes, 10.0, backend="interpreted")
    sums, counts = [], []
    for draw in range(6):
        run = rollout.run({DRAW: float(draw)})
        after = slice(2, None, 2) if delay_s else slice(1, None, 2)  # after each arrival
        wanted = 0
        for name, size in (("position", 2), ("orientation", 1)):
            stamps = states(rollout, run, f".target_{name}.measured")[after, -1]
            wanted = wanted + size * (np.diff(stamps, prepend=-1) > PERIOD / 2)
        found = run.outputs["target_nis_dof"][after, 0]
        np.testing.assert_array_equal(found, wanted)
        squares = run.outputs["target_nis"][after, 0]
        assert np.all(squares[wanted == 0] == 0)
        sums.append(squares.sum())
        counts.append(wanted.sum())
    assert {*wanted} >= ({0, 3} if len(lost) == 2 else {2, 3} if "orientation" in lost else {1, 3})
    low, high = chi2.ppf([0.025, 0.975], sum(counts))
    assert low < sum(sums) < high
    assert sum(sums) < chi2.ppf(0.025, 3 * len(wanted) * len(sums))  # as three each, it seems inconsistent


def test_in_space_it_finds_the_inertia_ratios():
    """Of four draws: NEES inside its bounds, and errors of the ratios a fifth of the first ones.

    The first errors are small, for an extended filter is too confident while they are large.
    """
    changes = filtered("left", 0.3, inertia=0.1, attitude_deg=1.0, spin_deg=0.5) | LOCKED
    rollout = rolled(BOXES, changes, 12.0, backend="interpreted", output_step_s=12.0)
    nees, ends = [], []
    for draw in range(4):
        run = rollout.run({DRAW: float(draw)})
        nees.append(run.outputs["target_nees"][-1, 0])
        ratios = np.column_stack([run.outputs[f"target_inertia_{i}"][:, 0] for i in (1, 2)])
        ends.append(ratios[-1] - ratios[0])  # which begin at the true ones, and are then moved
    assert consistent(np.array(nees), 14)
    first = [0.1 * NoiseTable("chaser/seen.begin", 1, 14).drawn(0, draw)[-2:] for draw in range(4)]
    assert np.sqrt(np.mean(np.square(ends))) < 0.2 * np.sqrt(np.mean(np.square(first)))


def test_it_begins_at_the_true_ratios_where_a_campaign_varies_them():
    """An inertia given as a parameter is the same plant, estimate and error as one of the scenario."""
    path, short = "target.links.body.inertia.0", {"simulation.duration": 1.1}
    nees = [
        sr.batch(
            sr.load_scene("examples/filters.yaml", changes), ["target_nees"], values, backend="interpreted"
        )
        for changes, values in ((short, {path: [25.0]}), (short | {path: 25.0}, {DRAW: [0.0]}))
    ]
    found, wanted = (float(each.data["target_nees"].values.item()) for each in nees)
    assert found == pytest.approx(wanted, rel=1e-9)


def test_the_covariance_it_assumes_at_first_is_not_that_of_its_error():
    """So that the one is tuned while the other is drawn as ever."""
    found = []
    for factor in (1.0, 3.0):
        rollout = rolled(
            PLATES, filtered("mate_2", 0.3, initial_factor=factor), 0.05, backend="interpreted", step_s=0.01
        )
        run = rollout.run()
        found.append([states(rollout, run, name)[-1] for name in (".mean", ".covariance")])
    (mean, known), (same, wider) = found
    np.testing.assert_allclose(known[0] / FIRST["position"] ** 2, 1)
    np.testing.assert_allclose(wider, 9 * known, rtol=1e-12)
    np.testing.assert_array_equal(mean, same)


FOLLOWING = (
    FOLLOWED
    | camera(0.05, robot="one")
    | {
        "robots.one.estimators": {
            "seen": {"kind": "target_filter", "tip": "tip", "frame": "mate_2", "position_noise": 3e-3} | FIRST
        }
    }
)
QUICK = {f"robots.one.sensors.target_{name}.errors.period": 0.1 for name in ("position", "orientation")}


@pytest.mark.parametrize(
    ("text", "changes"),
    [(PLANAR, FOLLOWING | QUICK), (BOXES, filtered("left", 0.2) | LOCKED)],
    ids=["planar", "spatial"],
)
def test_both_engines_estimate_the_same(text, changes):
    duration_s, step_s = (0.16, 0.001) if text is PLANAR else (1.0, 0.01)
    steps = {"output_step_s": duration_s, "step_s": step_s}
    rollout = rolled(text, changes, duration_s, backend="interpreted", **steps)
    other = simulate(small_scene(text, changes), duration_s=duration_s, output_step_s=duration_s)
    np.testing.assert_allclose(rollout.run().state, other.state, atol=1e-9)


@pytest.mark.parametrize(
    ("path", "step"),
    [
        ("robots.one.tips.tip.pid.kp", 0.3),
        ("robots.one.estimators.seen.position_noise", 4e-5),
        ("robots.one.estimators.seen.spin_deg", 0.02),
        ("robots.one.sensors.target_orientation.errors.noise", 5e-5),
    ],
)
def test_gradients_go_through_the_filter_to_the_motion_that_follows_it(path, step):
    rollout = costed(FOLLOWING | QUICK, 0.38, backend="interpreted")
    found = rollout.value_and_gradient(wrt=[path])
    assert found.status == ("exact",)
    wanted = difference(rollout, path, step)
    assert abs(wanted) > 1e-6
    np.testing.assert_allclose(found.gradients["x"][0], wanted, rtol=1e-7)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"robots.one.sensors.target_orientation": {"kind": "linear"}}, r"needs samples of target_orient"),
        (
            {"robots.one.sensors.target_position.errors.delay": 0.2},
            r"delay 0\.2 s of target_position and",
        ),
        ({"robots.one.sensors.target_orientation.errors.noise": 0}, r"seen\.attitude_noise: missing"),
        ({"robots.one.estimators.seen.frame": "mate_3"}, r"seen\.frame: found 'mate_3', .*mate_2"),
        ({"robots.one.estimators.seen.tip": "hand"}, r"seen\.tip: found 'hand', .*tip"),
        ({"robots.one.sensors.target_position.errors.period": -1}, r"period: found -1, allowed: above 0"),
    ],
)
def test_a_filter_that_sees_nothing_is_refused(changes, told):
    with pytest.raises(ScenarioError, match=told):
        small_scene(PLANAR, FOLLOWING | changes)
