"""Names of break points by patterns, and their groups in messages."""

import pytest

from spacerobot.closedloop.break_points import grouped, matching_points
from spacerobot.common.errors import SpaceRobotError

NAMES = [f"torque/arm/joint_{k}" for k in range(1, 8)] + ["measurement/arm.joint_rate[0]", "torque/arm/wrist"]


def test_names_that_differ_in_their_last_number_are_one_group():
    assert grouped(NAMES) == ["torque/arm/wrist", "torque/arm/joint_1..7", "measurement/arm.joint_rate[0]"]


def test_a_pattern_selects_names_in_their_order():
    assert matching_points(NAMES, "torque/*_1") == ["torque/arm/joint_1"]
    assert matching_points(NAMES, "*") == NAMES


def test_a_pattern_without_a_match_is_refused_with_the_groups():
    with pytest.raises(SpaceRobotError, match=r"no break point .*; allowed: .*torque/arm/joint_1\.\.7"):
        matching_points(NAMES, "wheel/*")
