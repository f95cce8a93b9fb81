"""Costs of a plan, the same quantities of the simulation that follows it, and integrals of its outputs."""

import numpy as np
import pytest

from optim.evaluation import batch
from optim.planning.output.plan_folder import FOLLOWED, write
from optim.planning.search.make_plan import integrals, make_plan
from spacerobot.quantities import planned
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate

SIGNALS = {
    "torque": "joint_torque",
    "joint_rate": "joint_velocity",
    "base_rotation": "body_rotation",
    "base_translation": "body_position",
    "base_force": "base_force",
    "base_torque": "base_torque",
    "grip_force": "grasp_force",
    "grip_torque": "grasp_torque",
}
"""Costs, and the outputs whose squares they integrate."""
COSTS = dict.fromkeys([*SIGNALS, "base_wrench", "propellant"], 1.0)


@pytest.fixture(scope="module")
def flown(reach, tmp_path_factory):
    """A plan by which a robot turns and stops, driven by its base too, with an object welded to its tip."""
    folder = tmp_path_factory.mktemp("flown")
    changes = {
        "robots.one.base.velocity": [0.03, -0.02, 0],
        "robots.one.base.spin_deg": [0, 0, 2],
        "grasps": {"left": {"tip": "one/tip", "frame": "mate_1", "kind": "weld"}},
        "plan.goals": {
            "turn": {"robot": "one", "joints": {"joint_1": {"angle_deg": 50}}},
            "stop": {"still": "one"},
        },
        "plan.limits": {"base_force": 5, "base_torque": 4},
        "plan.costs": COSTS,
        "plan.duration": 4,
        "plan.intervals": 8,
        "simulation.duration": 4,
        "simulation.output_step": 0.01,
    }
    found = make_plan(reach(*changes.items()), backend="interpreted")
    write(found, folder)
    return found, load_scene(folder / FOLLOWED)


def test_a_plan_and_the_flight_that_follows_it_agree_in_every_cost(flown):
    """Quadrature over collocation points against integrals of the rollout, by one registered quantity."""
    found, scene = flown
    known, duration = planned(), found.motion.duration_s
    mass = scene.scenario.robots["one"].links["base"].mass
    quantities = [known[key].name for key in COSTS]
    data = batch(scene, quantities, {"robots.one.links.base.mass": [mass]}, backend="interpreted").data
    for key, integral in integrals(found.motion).items():
        own = data[known[key].name]
        total = np.linalg.norm(own.values[0], 2 if known[key].total == "norm" else 1)
        assert own.units == known[key].unit_in(scene)
        assert total == pytest.approx(known[key].reduced(integral, duration), rel=3e-6), key


def test_what_a_plan_reports_is_the_integral_of_the_flights_outputs(flown):
    found, scene = flown
    data, known = simulate(scene, backend="interpreted").data, planned()
    data = data.sel(body="one")
    data["body_position"] = data.body_position - data.body_position[0]
    reported = integrals(found.motion)
    for key, name in SIGNALS.items():
        squares = (data[name].values.reshape(len(data.time), -1) ** 2).sum(axis=1)
        rms = np.sqrt(np.trapezoid(squares, data.time.values) / 4)
        assert known[key].reduced(reported[key], 4.0) == pytest.approx(rms, rel=1e-3), key
    forces = np.abs(data.base_force.values).sum(axis=1)
    assert reported["propellant"] == pytest.approx(np.trapezoid(forces, data.time.values), rel=1e-3)
