"""Arms whose joints have nothing left to brake where a plan ends."""

import casadi as ca
import numpy as np
import pytest
import scipy.linalg

from optim.planning.formulation.formulate import formulate
from spacerobot.common.errors import ScenarioError


def settled(reach, *, orientation):
    """Stage, names and values of what a settled goal asks for beside its pose and motion."""
    asked = [("plan.goals.mate.settled", True), ("plan.goals.mate.orientation", orientation)]
    problem = formulate(reach(*asked))
    rows = [row for row in problem.goal if row.name.startswith("settled")]
    values = ca.Function("values", [problem.stage.z], [ca.vertcat(*(row.value for row in rows))])
    return problem.stage, [row.name for row in rows], values


def test_only_rates_that_move_no_tip_are_left_out(reach):
    stage, names, values = settled(reach, orientation=False)
    accelerations = [f"settled: acceleration of one/joint_{k}" for k in (1, 2, 3)]
    assert names[:3] == accelerations
    assert len(names) == 4  # three joints, two directions
    model, rng = stage.scene.model, np.random.default_rng(2)
    q, v, a = np.array(stage.scene.q), rng.normal(size=model.nv), rng.normal(size=model.nv)
    columns = [int(model.idx_vs[joint]) for joint in stage.scene.body("one").driven_joints]
    velocity = stage.velocity(stage.scene.tips[0].frame)[0][:2]
    slopes = ca.Function("slopes", [stage.q], [ca.jacobian(velocity, stage.v)])(q).full()[:, columns]

    def left(rates):
        v[columns] = rates
        z = np.concatenate([q, v, a, np.zeros(stage.z.numel() - model.nq - 2 * model.nv)])
        return values(z).full().ravel()

    np.testing.assert_array_equal(left(np.zeros(3))[:3], a[columns])
    least = slopes.T @ rng.normal(size=2)
    assert abs(left(least)[3]) < 1e-12
    spare = scipy.linalg.null_space(slopes)[:, 0]
    assert abs(left(least + spare)[3]) > 0.1


def test_an_arm_without_joints_to_spare_ends_without_acceleration(reach):
    assert len(settled(reach, orientation=True)[1]) == 3


def test_rest_and_settled_are_one_too_many(reach):
    with pytest.raises(ScenarioError, match="joints at rest are settled"):
        reach(("plan.goals.mate.settled", True), ("plan.goals.mate.rest", True))
