"""Test of a goal: a plan with it ends with the tip in the required direction."""

from pathlib import Path

import numpy as np

import spacerobot as sr

sr.load_plugin(Path(__file__).with_name("pointing.py"))


def test_the_tip_points_along_y_at_the_end_of_the_plan(tmp_path):
    """At the end of the plan the tip's axis is within one degree of y."""
    goal = {"kind": "pointing", "tip": "arm/tip", "towards": [0, 1, 0]}
    changes = {"plan.duration": 3, "plan.costs": {"torque": 1}, "plan.goals": {"camera": goal}}
    plan = sr.plan(sr.load_scene("bounce", changes), tmp_path / "plan")
    # the tip of this planar arm turns about z by the angle between its x axis and the world's
    angle = plan.data.tip_rotation.isel(time=-1, tip=0).values[2]
    assert abs(angle - np.pi / 2) < np.radians(1.01)
