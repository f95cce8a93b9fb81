"""The tuning problem of a scene: gradients of everything, meanings of objectives, divergence, threads."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from optim import build_problem, integral, tune
from optim.problem.objectives import OBJECTIVE, reading
from optim.problem.problem import EvaluationCost
from optim.workers import Threads
from spacerobot.closedloop import build_closed_loop
from spacerobot.rollout import build_rollout
from spacerobot.scenario import Objective
from spacerobot.scene import load_scene

LIMITS = {"max_joint_torque": 0.5, "max_grip_force": 0.2, "max_base_rotation_deg": 0.05}
ROUNDING = 1e-9  # of central differences of values near one
KINDS = ("ise", "itae", "minimax", "eq45", "eq45_printed")


def differences(problem, u, step=1e-5):
    """Central differences of objective and constraints."""
    points = np.concatenate([u + step * np.eye(len(u)), u - step * np.eye(len(u))])
    found = problem.evaluate(points)
    k = len(u)
    return (
        (found.objective[:k] - found.objective[k:]) / (2 * step),
        ((found.constraints[:k] - found.constraints[k:]) / (2 * step)).T,
    )


def assert_near(found, expected, tolerance=1e-4):
    assert np.abs(found - expected).max() < tolerance * np.abs(expected).max() + ROUNDING


@pytest.mark.parametrize("kind", KINDS)
def test_objective_and_constraint_gradients_against_differences(small, kind):
    weights = {"kind": kind, "effort": 1e-6, "base_rotation": 0.01, "object_rotation": 0.02}
    problem = build_problem(
        small(tuning__objective=weights, tuning__constraints=LIMITS), variables=["kp", "ta"]
    )
    u = np.array([0.4, 0.6])
    at = problem.linearise(u)
    gradient, jacobian = differences(problem, u)
    assert np.abs(gradient).min() > 1e3 * ROUNDING * np.abs(at.objective)
    assert_near(at.gradient / at.objective, gradient / at.objective)
    assert at.constraint_jacobian.shape == (3 + 1 + 1, 2)
    for row, expected in zip(at.constraint_jacobian, jacobian, strict=True):
        assert_near(row, expected, 1e-3)
    value = problem.evaluate(u[None])
    assert at.objective == pytest.approx(value.objective[0], rel=1e-9)
    assert at.constraints == pytest.approx(value.constraints[0], rel=1e-9)


def test_the_adjoint_serves_smooth_objectives_without_constraints(small):
    problem = build_problem(small(tuning__objective={"kind": "itae"}))
    u = np.full(5, 0.45)
    at = problem.linearise(u)
    assert_near(at.gradient, differences(problem, u)[0])


def test_a_users_expression_gets_exact_gradients(small):
    def own(signals):
        return integral(ca.sumsqr(signals["grasp_force"]) * signals.t)

    problem = build_problem(small(), variables=["kd", "grip"], objective=own)
    u = np.array([0.3, 0.7])
    assert_near(problem.linearise(u).gradient, differences(problem, u)[0])


def test_squares_and_peaks_are_rows_of_the_objective(small):
    u = np.array([0.5, 0.5])
    squares = build_problem(small(), variables=["kp", "ta"]).linearise(u)
    assert (squares.rows**2).sum() == pytest.approx(squares.objective, rel=2e-2)
    assert_near(2 * squares.rows @ squares.rows_jacobian, squares.gradient, 5e-2)
    peaks = build_problem(small(tuning__objective__kind="minimax"), variables=["kp", "ta"]).linearise(u)
    assert peaks.smooth + peaks.rows.max() == pytest.approx(peaks.objective, rel=1e-9)
    assert_near(peaks.rows_jacobian[peaks.rows.argmax()], peaks.gradient, 1e-6)


@pytest.fixture(scope="module")
def samples(small):
    """Errors over time at the scenario's own values, from an ordinary rollout."""
    loop = build_closed_loop(small())
    run = build_rollout(loop, duration_s=1.0, step_s=0.01).run()
    return run.time, run.outputs["tip_error"][:, :2], run.outputs


@pytest.mark.parametrize("kind", KINDS)
def test_objectives_mean_what_they_say(small, samples, kind):
    t, error, _ = samples
    ta, ramp = 4.0, samples[0][:, None]
    total = error.sum(axis=1)

    def integrate(values):
        return np.trapezoid(values, t)

    def memory(fade):
        kernel = np.where(t[:, None] >= t[None, :], np.exp(-ta * t[:, None] + fade * ta * t[None, :]), 0)
        return np.array(
            [np.trapezoid(row[: i + 1] * total[: i + 1], t[: i + 1]) for i, row in enumerate(kernel)]
        )

    expected = {
        "ise": integrate((error**2).sum(axis=1)),
        "itae": integrate(ramp[:, 0] * np.linalg.norm(error, axis=1)),
        "minimax": np.abs(error).max(),
        "eq45": integrate(memory(1) ** 2),
        "eq45_printed": integrate(memory(-1) ** 2),
    }[kind]
    problem = build_problem(small(tuning__objective__kind=kind), variables=["kp"])
    value = problem.evaluate(problem.start[None]).objective[0]
    assert value == pytest.approx(expected, rel=2e-2)


def test_penalties_mean_what_they_say(small, samples):
    t, error, outputs = samples
    weights = {"kind": "ise", "weight": 2.0, "effort": 0.5, "base_rotation": 3.0, "object_rotation": 5.0}
    problem = build_problem(small(tuning__objective=weights), variables=["kp"])
    turned = outputs["body_rotation"]
    rate = 2 * (error**2).sum(1) + 0.5 * (outputs["joint_torque"] ** 2).sum(1)
    rate = rate + 3 * (turned[:, :3] ** 2).sum(1) + 5 * (turned[:, 3:] ** 2).sum(1)
    value = problem.evaluate(problem.start[None]).objective[0]
    assert value == pytest.approx(np.trapezoid(rate, t), rel=2e-2)


def test_variables_set_every_path_they_tie(small):
    problem = build_problem(small(), variables=["kp", "grip"])
    loop = build_closed_loop(small())
    changes = {"robots.arm.tips.tip.pid.kp": 77.0, "grasps.left.stiffness": 50.0, "grasps.left.damping": 50.0}
    reference = build_rollout(loop, duration_s=1.0, step_s=0.01).run(changes)
    tied = problem.rollout.run({"kp": 77.0, "grip": 50.0})
    assert np.array_equal(tied.state, reference.state)
    u = problem.variables.unit(np.array([77.0, 50.0]))
    assert problem.variables.as_changes(problem.variables.values(u)) == pytest.approx(changes)


def test_a_diverged_rollout_has_no_value_and_no_gradient(small):
    problem = build_problem(
        small(simulation__method="rk4", tuning__step=0.25, tuning__constraints=LIMITS), variables=["kp", "kd"]
    )
    found = problem.evaluate(np.array([[1.0, 0.0], [1.0, 1.0]]))
    assert np.isnan(found.objective).any()
    lost = int(np.isnan(found.objective).argmax())
    assert np.isinf(found.violation[lost])
    at = problem.linearise(np.array([[1.0, 0.0], [1.0, 1.0]])[lost])
    assert np.isnan(at.objective)
    assert np.isnan(at.gradient).all()
    assert at.constraint_jacobian.shape == (len(problem.constraint_names), 2)


def test_answers_do_not_depend_on_threads_or_batches(small, compiled):
    import dataclasses

    problem = build_problem(small(), variables=["kp", "ta"])
    u = np.random.default_rng(0).random((37, 2))
    one, two = (dataclasses.replace(problem, workers=Threads(n)).evaluate(u) for n in (1, 2))
    assert np.array_equal(one.objective, two.objective)
    assert np.array_equal(problem.evaluate(u[5:6]).objective, one.objective[5:6])
    assert problem.measure(u)[OBJECTIVE].shape == (37,)


def test_fingerprints_differ_where_answers_may(small):
    prints = {
        build_problem(small(), variables=["kp"]).fingerprint,
        build_problem(small(), variables=["ta"]).fingerprint,
        build_problem(small(tuning__step=0.02), variables=["kp"]).fingerprint,
        build_problem(small(tuning__objective__kind="itae"), variables=["kp"]).fingerprint,
        build_problem(small(tuning__constraints__max_grip_force=3), variables=["kp"]).fingerprint,
        build_problem(small(), variables=["kp"], variant="inertial").fingerprint,
    }
    assert len(prints) == 6
    assert build_problem(small(), variables=["kp"]).fingerprint in prints


@pytest.mark.parametrize(
    ("kind", "limits", "cost"),
    [
        ("itae", {}, EvaluationCost(gradients=1)),
        ("itae", {"tuning__constraints__max_joint_torque": 50}, EvaluationCost(rollouts=1, slopes=2)),
        ("minimax", {}, EvaluationCost(rollouts=1, slopes=2)),
    ],
)
def test_derivatives_are_booked_as_they_are_computed(small, kind, limits, cost):
    problem = build_problem(small(tuning__objective__kind=kind, **limits), variables=["kp", "ta"])
    assert problem.linear_cost == cost


def test_the_step_is_refined_where_it_falsifies_the_derivatives_at_the_best_point():
    """Friction that needs shorter steps than the tuning section's: half of its step is taken."""
    variables = {"friction": {"paths": "contacts.bump.friction", "lower": 0.88, "upper": 1.0}}
    tuning = {
        "step": 0.01,
        "variables": variables,
        "objective": {"kind": "itae"},
        "starts": 1,
        "iterations": 2,
    }
    motion = {"target.base.position": [1.9, 0.05, 0], "target.base.velocity": [-0.5, 0, 0]}
    simulation = {"simulation.duration": 0.4, "simulation.output_step": 0.1, "contacts.bump.friction": 0.9}
    problem = build_problem(load_scene("bounce", {"tuning": tuning, **motion, **simulation}))
    assert problem.step_warning(problem.start).startswith("inaccurate: step: half the step changes")
    found = tune(problem)
    assert "tuned again with a step of 0.005 s, because half" in found.message
    fine = problem.refined
    assert not fine.step_warning(found.outcome.best.u)
    assert found.objective == pytest.approx(fine.evaluate(found.outcome.best.u[None]).objective[0])
    assert fine.recipe.key != problem.recipe.key


def test_an_objective_without_tip_errors_is_not_called_after_them():
    assert reading(Objective(kind="minimax")) == ("minimax", 1e3, "mm")
    assert reading(Objective(kind="minimax", weight=0)) == ("objective", 1.0, "")
