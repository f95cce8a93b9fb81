"""Plans that begin with a later phase: of what is held and identified by then, and with locked joints."""

import tempfile
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

import spacerobot as sr
from optim.planning.formulation.formulate import formulate
from optim.planning.mpc.handover import Handover
from optim.planning.mpc.horizon import Horizon
from spacerobot.common.errors import ScenarioError
from tests.oracles import one_arm

FILTER = {"kind": "inertia_filter", "tip": "tip", "frame": "mate_1", "period": 0.05, "com_deviation": 0.2}
FILTER |= {"velocity_noise": 1e-6, "spin_noise": 2e-7, "rate_noise": 1e-6}
LIGHT = {"mass": 8, "com": [0, 0, 0], "inertia": [0.5, 0.7, 0.6, 0, 0, 0]}
SURE = {"mass_deviation": 1e-9, "com_deviation": 1e-10, "inertia_deviation": 1e-9}
GOAL = {"joint_1": 30, "joint_2": -60, "joint_3": 40}


@cache
def folder():
    keep = tempfile.TemporaryDirectory(prefix="handover_")
    weld = {"tip": "arm/tip", "frame": "mate_1", "kind": "weld"}
    one_arm.write(Path(keep.name), grasps={"left": weld})
    return keep


def carried(changes=None, **section):
    """An arm turns an object that is heavier than assumed, then carries it by plans made in flight."""
    lead = {"kind": "mpc", "period": 0.25, "min_horizon": 0.5, "kp": 5, "kd": 5}
    tip = {"pid": None, "amnesia": None}
    joints = {name: {"angle_deg": angle} for name, angle in GOAL.items()}
    own = {
        "target.links.body.mass": 12,
        "target.links.body.com": [0.03, -0.02, 0],
        "target.base.align": True,  # what is assumed is in axes of the mating frame
        "robots.arm.estimators": {"held": FILTER | section},
        "robots.arm.controllers": {"lead": lead},
        "phases": {
            "show": {"robots": {"arm": {"controllers": {"lead": None}}}, "until": {"time": 0.8}},
            "carry": {"robots": {"arm": {"tips": {"tip": tip}}}},
        },
        "plan": {
            "duration": 1,
            "intervals": 4,
            "goals": {"there": {"robot": "arm", "joints": joints}},
            "costs": {"torque": 0.01},
        },
        "simulation": {"duration": 1.8, "step": 0.01, "output_step": 0.05},
    }
    return sr.load_scene(Path(folder().name) / "small.yaml", own | (changes or {}))


def missed(result):
    """Distance of the joints from their goal at the end [rad]."""
    return np.abs(result.array("joint_position")[-1] - np.radians(list(GOAL.values()))).max()


def test_plans_know_the_object_that_the_filter_has_identified(monkeypatch):
    real, used = Horizon.of, []

    def of(solver, measured, min_horizon, inertia):
        used.append(inertia)
        return real(solver, measured, min_horizon, inertia)

    monkeypatch.setattr(Horizon, "of", of)
    scene = carried()
    true = scene.model.inertias[scene.target.root_joint].toDynamicParameters()
    flown = {
        "known": sr.simulate(carried(**SURE), backend="interpreted"),
        "assumed": sr.simulate(carried(**SURE, **LIGHT), backend="interpreted"),
        "identified": sr.simulate(carried(**LIGHT), backend="interpreted"),
    }
    seen = [0, 1, 2, 9]
    np.testing.assert_allclose(used[0], true, rtol=1e-5, atol=1e-5)  # moved to the tip's axes and back
    assert used[1][0] == pytest.approx(8, rel=1e-4)
    np.testing.assert_allclose(used[2][seen], true[seen], rtol=1e-3, atol=1e-3)
    for result in flown.values():
        told = result.summary["mpc"]
        assert (told["plans"], told["missed"]) == (3, 0)
        assert result.completed
        assert np.ptp(result.array("momentum_linear"), axis=0).max() < 1e-9
    errors = {name: missed(result) for name, result in flown.items()}
    assert errors["assumed"] > 10 * errors["known"]
    assert errors["identified"] < 1.3 * errors["known"]


def test_the_equations_of_motion_take_the_inertia_as_a_number():
    """The residual is that of a model which has it; also its torques (Pinocchio)."""
    scene, rng = carried(), np.random.default_rng(3)
    problem = formulate(Handover.at_start(carried({"phases": {}})).scene)
    stage, model = problem.stage, scene.model.copy()
    given = pin.Inertia.Random()
    model.inertias[scene.target.root_joint] = given
    q, v, a = pin.integrate(model, scene.q, rng.normal(size=model.nv)), *rng.normal(size=(2, model.nv))
    torque = rng.normal(size=stage.u.numel())
    z = np.concatenate([q, v, a, torque, np.zeros(stage.w.numel())])
    values = np.append(z, given.toDynamicParameters())
    balance = ca.Function("balance", [ca.vertcat(stage.z, stage.inertia)], [stage.balance])
    wanted = pin.rnea(model, model.createData(), q, v, a) + np.asarray(model.damping) * v
    wanted[list(stage.driven.columns)] -= torque
    np.testing.assert_allclose(balance(values).full().ravel(), wanted, atol=1e-12)


def test_plans_know_which_joints_are_locked():
    """The others bring the arm to its goal, which they would miss if the locked one was to help."""
    joints = {name: {"angle_deg": GOAL[name]} for name in ("joint_1", "joint_3")}
    changes = {
        "robots.arm.actuators": {"jam": {"kind": "joint_failure", "joint": "joint_2", "at": 0.5}},
        "plan.goals": {"there": {"robot": "arm", "joints": joints}},
        "robots.arm.controllers.lead.min_horizon": 1,
    }
    result = sr.simulate(carried(changes, **SURE), backend="interpreted")
    assert result.completed
    assert result.summary["mpc"]["plans"] == 1
    time, position = result.array("time"), result.array("joint_position")
    assert np.ptp(position[time > 0.51, 1]) < 1e-9
    goal = np.radians([GOAL["joint_1"], GOAL["joint_3"]])
    np.testing.assert_allclose(position[-1, [0, 2]], goal, atol=2e-3)


def test_a_phase_with_plans_that_never_begins_leaves_the_others():
    changes = {"simulation.duration": 0.3}
    result = sr.simulate(carried(changes, **SURE), backend="interpreted")
    assert result.completed
    assert "mpc" not in result.summary
    assert result.array("time")[-1] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"phases.carry.until": {"time": 0.5}, "phases.carry.next": "show"}, "leads back to 'carry'"),
        (
            {"plan.phases": {"show": {"duration": 1, "goals": {"end": {"still": "arm"}}}}, "plan.goals": {}},
            "plan.phases: found phases",
        ),
        (
            {
                "grasps.left": {"tip": "arm/tip", "frame": "mate_1", "kind": "compliant"},
                "robots.arm.estimators": {},
            },
            "springs are strained",
        ),
    ],
)
def test_what_does_not_fit_a_later_phase_is_refused(changes, message):
    with pytest.raises(ScenarioError, match=message):
        sr.simulate(carried(changes, **SURE), backend="interpreted")


def test_batches_refuse_plans_of_a_later_phase():
    paths = {"target.links.body.mass": [11.0, 12.0]}
    with pytest.raises(ScenarioError, match="plans are made in 'carry', allowed in batches"):
        sr.batch(carried(**SURE), ["joint_torque_peak"], paths)
