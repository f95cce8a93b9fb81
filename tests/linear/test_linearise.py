"""Linearised closed loops: against the engine's own motion, rigid constraints, names, and errors."""

import sys

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError, SpaceRobotError
from spacerobot.linear import linearise, margins
from spacerobot.linear.instants import instants
from spacerobot.linear.linearisation import Lineariser
from spacerobot.linear.periodic import common_period
from spacerobot.rollout import build_rollout
from tests.linear.scenes import KD, KP, arm_scene
from tests.oracles.small_scenes import PLANAR, SPATIAL, small_scene

SHORT = {"simulation.duration": 0.2}
FAST = {"robots.one.base.spin_deg": [0, 0, 60], **SHORT}
WELDED = {"grasps.left": {"tip": "one/tip", "frame": "left", "kind": "weld"}, **SHORT}
PINNED = {
    "grasps.left": {"tip": "one/tip", "frame": "mate_1", "kind": "point"},
    "grasps.right": {"tip": "two/tip", "frame": "mate_2", "kind": "point"},
    **SHORT,
}


def flowed(loop, x, c, length):
    """State after a time, by an integrator of its own."""
    found = solve_ivp(
        lambda t, y: loop.dynamics(t, y, c).full().ravel(),
        (0, length),
        x,
        rtol=1e-11,
        atol=1e-13,
        method="DOP853",
    )
    return found.y[:, -1]


def deviation(model, loop, x, y):
    """Tangent coordinates of y seen from x, and the differences of the other states."""
    xi = pin.difference(model, x[: loop.nq], y[: loop.nq])
    return np.concatenate([xi, y[loop.nq :] - x[loop.nq :]])


@pytest.mark.parametrize(
    ("text", "changes", "closed"),
    [(PLANAR, FAST, 0), (SPATIAL, WELDED, 6), (PLANAR, PINNED, 4)],
    ids=["planar", "weld", "closed chain"],
)
def test_deviations_of_the_engine_follow_the_linear_system(text, changes, closed, monkeypatch):
    """The error is of second order in a short time: the coefficients are those of the instant."""
    scene = small_scene(text, changes)
    monkeypatch.setattr("spacerobot.linear.linearisation._relevant", lambda A, *_: list(range(len(A))))
    lineariser = Lineariser.of(scene)
    loop = lineariser.loop
    x0, c = (part.full().ravel() for part in loop.setup(loop.parameter_values))
    c = np.array(loop.at(0.0, x0, c), dtype=float).ravel()
    rollout = build_rollout(loop, duration_s=0.2, step_s=0.01, backend="interpreted")
    (start,) = instants(rollout, loop, [0.0])
    found = lineariser.at(start)
    basis = lineariser._basis(start, lineariser._chart(start.x)[0])
    whole = np.zeros((loop.nx - loop.nq + loop.nv, len(found.A)))
    free = basis.shape[1]
    assert free == 2 * (loop.nv - closed)
    whole[: 2 * loop.nv, :free] = basis
    whole[2 * loop.nv :, free:] = np.eye(len(found.A) - free)
    rng = np.random.default_rng(5)
    coordinates = rng.normal(size=len(found.A))
    direction, size = whole @ coordinates, 1e-5

    def moved(sign):
        step = sign * size * direction
        q = pin.integrate(scene.model, x0[: loop.nq], step[: loop.nv])
        return np.concatenate([q, x0[loop.nq :] + step[loop.nv :]])

    errors = []
    for length in (0.02, 0.01, 0.005):
        ends = [flowed(loop, moved(sign), c, length) for sign in (1, -1)]
        middle = flowed(loop, x0, c, length)
        seen = (
            deviation(scene.model, loop, middle, ends[0]) - deviation(scene.model, loop, middle, ends[1])
        ) / (2 * size)
        # seen in the basis of the instant, whose tangent space turns with the motion
        errors.append(np.abs(whole.T @ seen - expm(found.A * length) @ coordinates).max() / length)
    assert errors[0] / errors[1] > 1.8
    assert errors[1] / errors[2] > 1.8
    assert errors[2] < 0.02 * np.abs(found.A @ coordinates).max()


def test_the_input_at_a_torque_acts_through_the_inverse_of_the_mass_matrix():
    scene = arm_scene(2, "planar")
    (found,) = linearise(scene, backend="interpreted")
    mass = pin.crba(scene.model, scene.model.createData(), scene.q)
    inverse = np.linalg.inv(np.triu(mass) + np.triu(mass, 1).T)
    data = found.to_xarray()
    rows = [f"v.arm/{name}" for name in ("root[0]", "root[1]", "root[2]", "joint_1", "joint_2")]
    for place in (1, 2):
        column = data.B.sel(input=f"torque/arm/joint_{place}", state=rows).values
        np.testing.assert_allclose(column, inverse[:, 2 + place], rtol=1e-12)


def test_poles_of_a_joint_under_pd():
    """J s^2 + K_d s + K_p = 0, with J the inertia about the joint, or its reduced one on a floating base."""
    for base in ("fixed", "planar"):
        scene = arm_scene(1, base)
        (found,) = linearise(scene, backend="interpreted")
        mass = pin.crba(scene.model, scene.model.createData(), scene.q)
        inertia = 1 / np.linalg.inv(np.triu(mass) + np.triu(mass, 1).T)[-1, -1]
        mode = found.modes[-1]
        expected = np.roots([inertia, KD, KP])
        assert found.zero_poles == (0 if base == "fixed" else 6)
        np.testing.assert_allclose(np.sort_complex(found.poles[-2:]), np.sort_complex(expected), rtol=1e-9)
        np.testing.assert_allclose(mode.frequency_hz * 2 * np.pi, np.sqrt(KP / inertia), rtol=1e-9)
        np.testing.assert_allclose(mode.damping, KD / 2 / np.sqrt(KP * inertia), rtol=1e-9)
        assert found.is_stable


def test_outputs_by_name():
    scene = small_scene(PLANAR, SHORT)
    (found,) = linearise(scene, [0.1], outputs=["tip_position"], backend="interpreted")
    data = found.to_xarray()
    rows = data.C.sel(output=["tip_position[0]", "tip_position[1]", "tip_position[2]"]).values
    loop = build_closed_loop(scene)
    frame = scene.tips[0].frame
    rollout = build_rollout(loop, duration_s=0.1, step_s=0.004, output_step_s=0.1, backend="interpreted")
    q = rollout.run().state[-1][: scene.model.nq]
    own = scene.model.createData()
    jacobian = pin.computeFrameJacobian(scene.model, own, q, frame, pin.LOCAL_WORLD_ALIGNED)
    names = [f"d.{name}" for name in Lineariser.of(scene).perturbed.coordinates]
    np.testing.assert_allclose(rows[:, [found.states.index(name) for name in names]], jacobian[:3], atol=1e-9)


def test_an_event_gives_two_instants_and_switches_decide():
    held = {"grasps.left": {"tip": "one/tip", "frame": "mate_1", "kind": "point", "release": {"at": 0.1}}}
    scene = small_scene(PLANAR, {**held, **SHORT})
    before, after = linearise(scene, ["released"], backend="interpreted")
    assert (before.label, after.label) == ("released, before", "released, after")
    assert before.time_s == after.time_s == pytest.approx(0.1)
    assert sum(name.startswith("eta") for name in before.states) == 2 * (scene.model.nv - 2)
    assert sum(name.startswith("d.") for name in after.states) == scene.model.nv


@pytest.mark.parametrize(
    ("at", "told"),
    [([2.0], "from 0 to 1"), (["captured"], "captured"), (["thrown"], "no event 'thrown'")],
)
def test_instants_that_do_not_exist(at, told):
    with pytest.raises(ScenarioError, match=told):
        linearise(arm_scene(), at, backend="interpreted")


@pytest.mark.parametrize("analyse", [linearise, margins])
def test_instants_that_do_not_exist_are_reported_before_anything_is_compiled(analyse, monkeypatch):
    def refuse(*_, **__):
        raise AssertionError("the simulation was prepared")

    monkeypatch.setattr("spacerobot.linear.linearisation.prepare_simulation", refuse)
    monkeypatch.setattr("spacerobot.linear.linearisation.build_perturbed_loop", refuse)
    with pytest.raises(ScenarioError, match="no event 'thrown'"):
        analyse(arm_scene(), ["thrown"])


def test_outputs_that_do_not_exist():
    with pytest.raises(SpaceRobotError, match=r"no output 'tip_positon'.*tip_position"):
        linearise(arm_scene(), outputs=["tip_positon"])


def test_common_period():
    assert common_period([0.01, 0.015, 0.004]) == pytest.approx(0.06)
    with pytest.raises(ScenarioError, match="no common multiple"):
        common_period([1.0, np.sqrt(2)])


def test_the_loop_of_a_simulation_is_not_changed_by_break_points():
    """Without inputs the perturbed loop is the closed loop, to the bit of its derivatives' rounding."""
    scene = small_scene(PLANAR, SHORT)
    loop, perturbed = build_closed_loop(scene), Lineariser.of(scene).perturbed
    x0, c = loop.setup(loop.parameter_values)
    c, x = loop.at(0.0, x0, c), ca.SX.sym("x", loop.nx)
    exact = ca.Function("A", [x], [ca.jacobian(loop.dynamics(0.0, x, c), x)])(x0).full()
    np.testing.assert_allclose(perturbed.derivatives(0.0, x0, c)[0].full(), exact, atol=1e-10)


def test_without_python_control_it_says_what_to_install(monkeypatch):
    (found,) = linearise(arm_scene(1), backend="interpreted")
    monkeypatch.setitem(sys.modules, "control", None)
    with pytest.raises(SpaceRobotError, match=r"pip install 'spacerobot\[margins\]'"):
        found.to_control()
