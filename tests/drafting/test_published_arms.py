"""Published arms, those of the package example-robot-data: drafts capture and are planned at once."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest

from optim.planning.search.make_plan import make_plan
from spacerobot.drafting import DraftRequest, draft, draft_capture

ARMS = {
    # its tip feels inertias that differ between directions: one gain for all of them missed
    "ur3": ("ur_description/urdf/ur3_robot.urdf", "tool0"),
    # five light joints: damping in their null space left no step for the simulation
    "so101": ("so_arm_description/urdf/so101.urdf", "gripper_frame_link"),
}


def published(name: str) -> Path:
    """Path of a file of example-robot-data, which need not be installed."""
    try:
        package = distribution("example-robot-data")
    except PackageNotFoundError:
        pytest.skip("needs the package example-robot-data")
    return Path(str(package.locate_file("cmeel.prefix/share/example-robot-data/robots"))) / name


@pytest.mark.compiler
@pytest.mark.parametrize("name", ARMS)
def test_a_published_arm_captures_at_the_first_run(name, tmp_path):
    urdf, tip = ARMS[name]
    request = DraftRequest([str(published(urdf))], "satellite_box.urdf", [tip])
    drafted = draft(request, tmp_path / "mine.yaml", capture=True)
    assert drafted.problems == ()
    assert drafted.is_verified


def test_a_published_arm_on_a_damped_torso_is_planned(tmp_path):
    """A damping of 1000 N s/m; with weights that ignore it, the replay ended 71 mm off the plan."""
    urdf = published("tiago_pro_description/robots/tiago_pro.urdf")
    order = DraftRequest([str(urdf)], "satellite_box.urdf", ["gripper_left_base_link"])
    _, scene = draft_capture(order, tmp_path / "mine.yaml")
    plan = make_plan(scene, backend="interpreted")
    assert plan.motion.intervals <= 12
    assert not plan.verification.failures()
