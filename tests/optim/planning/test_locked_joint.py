"""A plan made again with a joint locked, flown by the arm that is left."""

import numpy as np

from optim.planning.output.plan_folder import FOLLOWED, write
from optim.planning.search.make_plan import make_plan
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate


def test_a_plan_with_a_locked_joint_is_flown_by_the_arm_that_is_left(reach, tmp_path):
    changes = [("plan.intervals", 8), ("plan.order", 4), ("plan.tolerance", 1e-3)]
    changes += [("plan.goals.mate.orientation", False), ("robots.one.joints.joint_3.locked", True)]
    planned = make_plan(reach(*changes), backend="interpreted")
    write(planned, tmp_path / "out")
    flown = simulate(load_scene(tmp_path / "out" / FOLLOWED), backend="interpreted")
    assert flown.summary["status"]["state"] == "completed"
    at_end = flown.data.sel(time=6.0, method="nearest")
    assert np.abs(at_end.tip_error.values).max() < 1e-3
    assert "one/joint_3" not in flown.data.joint.values
    assert np.abs(flown.data.joint_velocity.sel(joint="one/joint_1").values).max() > 1e-2
