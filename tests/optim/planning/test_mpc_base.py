"""Model predictive control of a base: a free flyer without joints, held to closed forms."""

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from optim.planning.mpc.flown_scene import FlownScene
from optim.planning.mpc.horizon import Horizon
from optim.planning.search.make_plan import make_plan
from optim.planning.search.plan_solver import PlanSolver
from spacerobot.closedloop import build_closed_loop
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate

MASS = 10.0
UNIT = f"""<robot name="unit"><link name="body"><inertial><mass value="{MASS}"/>
<inertia ixx="1" iyy="2" izz="3" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
PULL, DURATION, AHEAD = 2e-3, 20.0, 4.0
"""Acceleration that plans do not know [m/s^2], duration of the first plan and shortest horizon [s]."""


@pytest.fixture
def flyer(tmp_path):
    """Function of changes: a body turns and comes to rest at the origin, replanned every 2 s."""
    (tmp_path / "unit.urdf").write_text(UNIT)
    document = {
        "robots": {
            "sat": {
                "urdf": "unit.urdf",
                "base": {
                    "joint": "free_flyer",
                    "position": [2.0, -3.0, 1.0],
                    "rotation_deg": [20, -30, 10],
                    "spin_deg": [2, 1, -1],
                },
                "tips": {"body": {}},
                "controllers": {"lead": {"kind": "mpc", "period": 2, "min_horizon": AHEAD}},
                "actuators": {"jets": {"kind": "base_wrench", "force": 5, "torque": 1}},
            }
        },
        "plan": {
            "duration": DURATION,
            "goals": {
                "there": {"tip": "sat/body", "position": [0, 0, 0], "rotation_deg": [0, 0, 0]},
                "rest": {"still": "sat"},
            },
            "costs": {"base_force": 1, "base_torque": 10},
            "intervals": 10,
        },
        "simulation": {"duration": DURATION, "step": 0.05, "output_step": 0.5},
    }
    (tmp_path / "flyer.yaml").write_text(yaml.safe_dump(document))
    return lambda *changes: load_scene(tmp_path / "flyer.yaml", list(changes))


def end(result):
    """Position and velocity (3,) each of the body at the end, world axes."""
    last = result.data.isel(time=-1)
    return last.q.values[:3], last.momentum_linear.values / MASS


def test_the_first_plan_is_that_of_the_planner_and_is_flown(flyer):
    """The simulated motion under one plan is the planned one; the planner knows nothing of the simulation."""
    once = ("robots.sat.controllers.lead.min_horizon", 100)
    flown, plan = simulate(flyer(once), backend="interpreted"), make_plan(flyer(), backend="interpreted")
    assert flown.summary["mpc"]["plans"] == 1
    planned = plan.motion.along(flown.data.time.values / DURATION)[:, : plan.motion.q.shape[1]]
    np.testing.assert_allclose(flown.data.q.values, planned, atol=2e-4)
    impulse = np.trapezoid(np.abs(plan.motion.u[:, :3]), plan.motion.time, axis=0)
    assert (impulse > 1).all()  # along all three axes


def test_what_plans_do_not_know_counts_for_the_last_one_alone(flyer):
    """Each plan leads from where the body is to the goal: the last one, of h seconds, misses by a h^2 / 2."""
    pulled = [("gravity", [0, 0, -PULL]), ("plan.model", {"gravity.2": 0.0})]
    once = ("robots.sat.controllers.lead.min_horizon", 100)
    still = ("robots.sat.base.spin_deg", [0, 0, 0]), ("robots.sat.base.rotation_deg", [0, 0, 0])
    for more, time in (((once,), DURATION), ((), AHEAD)):
        flown = simulate(flyer(*pulled, *still, *more), backend="interpreted")
        position, velocity = end(flown)
        np.testing.assert_allclose(position, [0, 0, -PULL * time**2 / 2], atol=1e-6)
        np.testing.assert_allclose(velocity, [0, 0, -PULL * time], atol=1e-6)
        assert flown.summary["mpc"]["missed"] == 0


def test_the_rates_that_sensors_show_are_fed_back_in_axes_of_the_base(flyer):
    gains = {"controllers.lead.kd_linear": 20.0, "controllers.lead.kd_angular": 4.0}
    gains |= {"actuators.jets.force": 500, "actuators.jets.torque": 500}
    gains = [(f"robots.sat.{key}", value) for key, value in gains.items()]
    error = np.array([0.01, 0.02])  # of velocity [m/s] and spin [rad/s], along each world axis
    rates = []
    for wrong in (0.0, 1.0):
        offsets = [
            (f"robots.sat.sensors.base_{key}.offset", wrong * value + 1e-12)
            for key, value in zip(("velocity", "spin"), error, strict=True)
        ]
        loop = build_closed_loop(FlownScene.of(flyer(*gains, *offsets)).scene)
        x, c = (value.full().ravel() for value in loop.setup(loop.parameters({})))
        rates.append(loop.dynamics(0, x, loop.at(0, x, c)).full().ravel()[7:13])
    turn, found = Rotation.from_quat(flyer().q[3:7]).as_matrix(), rates[1] - rates[0]
    np.testing.assert_allclose(found[:3], -20 / MASS * error[0] * turn.T @ np.ones(3), atol=1e-9)
    np.testing.assert_allclose(found[3:], -4 * error[1] * turn.T @ np.ones(3) / [1, 2, 3], atol=1e-9)


def test_a_plan_continues_from_the_other_sign_of_a_measured_quaternion(flyer):
    horizons = []
    for sign in (1, -1):
        scene = flyer()
        horizon = Horizon.of(PlanSolver.of(scene, "interpreted"), np.append(scene.q, scene.v), AHEAD)
        state = np.concatenate([part[0] for part in horizon.at(np.array([4.0]))[:2]])
        state[3:7] *= sign
        horizon.replan(4.0, state, 60)
        horizons.append(horizon)
    one, other = horizons
    assert one.iterations == other.iterations
    np.testing.assert_array_equal(one.solution.w, other.solution.w)


def test_plans_that_weigh_propellant_are_continued(flyer):
    """The parts of forces whose magnitudes are a cost, and drives linear in time, are continued with them."""
    cost = ("plan.costs", {"propellant": 1, "base_force": 0.01, "base_torque": 10})
    scene = flyer(cost, ("plan.limits", {"base_force": 5, "base_torque": 1}))
    horizon = Horizon.of(PlanSolver.of(scene, "interpreted"), np.append(scene.q, scene.v), AHEAD)
    before = horizon.at(np.linspace(4, DURATION, 9))
    horizon.replan(4.0, np.concatenate([part[0] for part in before[:2]]), 60)
    assert horizon.missed == 0
    for new, old in zip(horizon.at(np.linspace(4, DURATION, 9))[:2], before[:2], strict=True):
        np.testing.assert_allclose(new, old, atol=5e-3)
