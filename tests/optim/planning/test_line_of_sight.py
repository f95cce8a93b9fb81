"""Mating frames that stay in sight."""

import numpy as np
import pinocchio as pin
import pytest

from optim.planning.output.plan_folder import dataset
from optim.planning.search.make_plan import make_plan
from spacerobot.common.errors import ScenarioError

CHEAP = [("plan.order", 4), ("plan.intervals", 8), ("plan.tolerance", 1e-3), ("plan.costs", {"torque": 1})]
EYE = {
    "camera": "one/link_3",
    "axis": [2, 0, 0],
    "frame": "mate_1",
    "half_angle_deg": 10,
    "final_fraction": 0.5,
}


def angles(motion):
    """Between the camera's axis and the mating frame, at all points [deg]."""
    model = motion.problem.stage.scene.model
    data, found = model.createData(), []
    for q in motion.q:
        pin.framesForwardKinematics(model, data, q)
        eye, mate = (data.oMf[model.getFrameId(name)] for name in ("one/link_3", "target/mate_1"))
        away = mate.translation - eye.translation
        found.append(np.arccos(np.clip(eye.rotation[:, 0] @ away / np.linalg.norm(away), -1, 1)))
    return np.degrees(found)


def test_a_mating_frame_stays_in_sight(reach):
    free, kept = (
        make_plan(reach(*CHEAP, ("plan.line_of_sight", sights)), backend="interpreted")
        for sights in ({}, {"eye": EYE})
    )
    late = free.motion.time >= 3 - 1e-9
    assert angles(free.motion)[late].max() > 12
    assert angles(kept.motion)[late].max() == pytest.approx(10, abs=1e-3)
    assert kept.cost > 1.01 * free.cost
    assert not kept.verification.failures()
    told = dataset(kept).sel(constraint_name="eye: off the camera's axis")
    np.testing.assert_allclose(np.degrees(told.constraint), angles(kept.motion), atol=0.1)
    np.testing.assert_allclose(np.degrees(told.constraint_limit), [-np.inf, 10])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"camera": "two/base"}, "plan.line_of_sight.eye.camera: no robot 'two'"),
        ({"camera": "one/link_4"}, "plan.line_of_sight.eye.camera: no link 'link_4'; did you mean link_"),
        ({"frame": "mate_9"}, "plan.line_of_sight.eye.frame: no link 'mate_9'"),
        ({"axis": [0, 0, 0]}, "axis: found 0 0 0"),
        ({"final_fraction": 1}, "the start violates a limit: eye: off the camera's axis is passed by"),
    ],
)
def test_bad_sights_are_refused_in_one_line(reach, changes, message):
    with pytest.raises(ScenarioError) as fault:
        make_plan(reach(("plan.line_of_sight", {"eye": EYE | changes})), backend="interpreted")
    assert message in str(fault.value)
