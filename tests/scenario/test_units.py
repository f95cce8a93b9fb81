"""Units by dotted path."""

import pytest

from spacerobot.common.section import leaves
from spacerobot.scenario.load import to_document
from spacerobot.scenario.units import unit_at
from spacerobot.scene import load_scene


@pytest.fixture(scope="module")
def scenario():
    turning = {"orientation_pid": {"kp": 1.0}, "orientation_amnesia": {"ge": 1.0, "ta": 1.0}}
    changes = {f"robots.*.tips.tip.{key}": section for key, section in turning.items()}
    return load_scene("paper", {"robots.*.sensors": {}} | changes).scenario


@pytest.mark.parametrize(
    ("path", "unit"),
    [
        ("target.links.body.mass", "kg"),
        ("target.links.body.inertia.2", "kg m^2"),
        ("robots.rpr1.base.spin_deg.2", "deg/s"),
        ("robots.rpr1.sensors.tip_position.offset", "m"),
        ("robots.rpr1.sensors.joint_rate.offset", "rad/s, m/s"),
        ("robots.rpr1.sensors.tip_position.scale", "1"),
        ("robots.rpr1.tips.tip.pid.kp", "N s/m"),
        ("robots.rpr1.tips.tip.orientation_pid.kp", "N m s/rad"),
        ("robots.rpr1.tips.tip.orientation_pid.ki", "N m/rad"),
        ("robots.rpr1.tips.tip.orientation_pid.kd", "N m s^2/rad"),
        ("robots.rpr1.tips.tip.orientation_pid.filter_time", "s"),
        ("robots.rpr1.tips.tip.orientation_amnesia.ge", "1/s^2"),
        ("robots.rpr1.tips.tip.orientation_amnesia.ta", "1/s"),
        ("grasps.left.stiffness", "N/m"),
    ],
)
def test_a_number_has_the_unit_of_its_field(scenario, path, unit):
    assert unit_at(scenario, path) == unit


def test_every_number_of_a_scenario_has_a_unit(scenario):
    for path, value in leaves(to_document(scenario)):
        if isinstance(value, float) and not path.startswith("tuning."):
            assert unit_at(scenario, path), path
