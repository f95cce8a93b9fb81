"""Goals that no posture reaches, and goals about what nothing changes, are refused before a solver runs."""

import numpy as np
import pinocchio as pin
import pytest
import yaml

from optim.planning.formulation.formulate import formulate
from optim.planning.search import plan_solver as solvers
from optim.planning.search.plan_solver import PlanSolver
from optim.planning.search.reachability import check_posture
from spacerobot.common.errors import ScenarioError
from spacerobot.scene import load_scene


def posed(scene, seed):
    """Goal at the tip's pose in a random posture whose centre of mass is where it was."""
    model, rng = scene.model, np.random.default_rng(seed)
    data, root = model.createData(), scene.robots[0].root_joint
    q = np.array(scene.q)
    pin.centerOfMass(model, data, q)
    before = data.oMi[root].act(data.com[root]).copy()
    step = np.zeros(model.nv)
    step[[model.idx_vs[joint] for joint in scene.robots[0].driven_joints]] = rng.uniform(-1.5, 1.5, 3)
    step[model.idx_vs[root] + 2] = rng.uniform(-1, 1)
    q = pin.integrate(model, q, step)
    pin.centerOfMass(model, data, q)
    q[model.idx_qs[root] : model.idx_qs[root] + 2] += (before - data.oMi[root].act(data.com[root]))[:2]
    pin.framesForwardKinematics(model, data, q)
    tip = data.oMf[scene.tips[0].frame]
    turned = float(np.degrees(np.arctan2(tip.rotation[1, 0], tip.rotation[0, 0])))
    return {
        "tip": "one/tip",
        "position": tip.translation.tolist(),
        "rotation_deg": [0.0, 0.0, turned],
    }


@pytest.mark.parametrize("seed", range(6))
def test_poses_that_a_posture_of_the_floating_robot_has_are_reached(reach, seed):
    goal = posed(reach(), seed)
    check_posture(formulate(reach(("plan.goals", {"there": goal}))))


@pytest.mark.parametrize(
    ("place", "miss"),
    # the centre of mass stays where it is, so that the arm does not reach as far as from a fixed base
    [([1.3, 1.3, 0], r"mate: position [xy] by 0\.\d+ m"), ([1.6, 0.5, 0], r"mate: position x by")],
)
def test_captures_out_of_reach_are_refused_with_their_miss_before_a_solver_runs(
    reach, monkeypatch, place, miss
):
    monkeypatch.setattr(solvers, "build_instants", lambda *_: pytest.fail("a solver is prepared"))
    with pytest.raises(ScenarioError, match=miss) as fault:
        PlanSolver.of(reach(("target.base.position", place)), "interpreted")
    assert "out of reach" in str(fault.value)
    assert "plan.goals" in str(fault.value)


def test_an_object_that_passes_by_is_reached_at_the_instant_when_it_is_near(reach):
    passing = [
        ("target.base.position", [0.8 - 0.5 * 7, 0.8, 0]),
        ("target.base.velocity", [0.5, 0, 0]),
        ("target.base.spin_deg", [0, 0, 0]),
    ]
    check_posture(formulate(reach(*passing, ("plan.duration", {"lower": 2, "upper": 30}))))
    with pytest.raises(ScenarioError, match="out of reach"):
        check_posture(formulate(reach(*passing, ("plan.duration", {"lower": 2, "upper": 3}))))


def test_a_range_of_joints_that_keeps_the_goal_out_is_respected(reach):
    problem = formulate(reach())
    check_posture(problem)
    for joint in problem.stage.driven.joints:
        place = problem.stage.scene.model.joints[joint].idx_q
        for side in (problem.lower, problem.upper):
            side[place] = problem.fixed[place]
    with pytest.raises(ScenarioError, match="out of reach"):
        check_posture(problem)


def test_a_goal_about_what_nothing_changes_is_refused(reach, tmp_path):
    document = yaml.safe_load(reach().source.read_text())
    document["robots"]["two"] = {
        "urdf": "rectangle.urdf",
        "base": {"joint": "planar", "position": [-2, -2, 0]},
        "tips": {"corner": {"frame": "mate_1"}},
    }
    document["plan"]["goals"]["there"] = {"tip": "two/corner", "position": [-2, -1.9, 0]}
    (tmp_path / "two.yaml").write_text(yaml.safe_dump(document))
    with pytest.raises(ScenarioError, match="nothing that is planned changes it") as fault:
        PlanSolver.of(load_scene(tmp_path / "two.yaml"), "interpreted")
    assert "there: position" in str(fault.value)
