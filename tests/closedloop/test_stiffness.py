"""The fastest rate of a loop against a damper whose rate is known by hand."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from spacerobot.closedloop import build_closed_loop, find_fastest_rate
from spacerobot.scene import load_scene
from tests.oracles.small_scenes import PLANAR, small_scene

INERTIA, STIFFNESS = 0.7, 5.0
WHEEL = f"""
<robot name="wheel">
  <link name="base"/>
  <link name="rim"><inertial><mass value="1"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="{INERTIA}"/></inertial></link>
  <joint name="axle" type="continuous"><parent link="base"/><child link="rim"/><axis xyz="0 0 1"/></joint>
</robot>
"""


def wheel(tmp_path, damper):
    (tmp_path / "wheel.urdf").write_text(WHEEL)
    robot = {"urdf": "wheel.urdf", "base": {"joint": "fixed"}, "joint_pd": {"kp": STIFFNESS, "kd": damper}}
    (tmp_path / "wheel.yaml").write_text(yaml.safe_dump({"robots": {"wheel": robot}}))
    return build_closed_loop(load_scene(tmp_path / "wheel.yaml"))


@pytest.mark.parametrize(("damper", "gains"), [(4000.0, ("kd",)), (0.001, ("kp",))])
def test_a_wheel_on_spring_and_damper(tmp_path, damper, gains):
    """J s^2 + k_d s + k_p = 0: the damper sets the faster root, or the spring alone sets both."""
    found = find_fastest_rate(wheel(tmp_path, damper))
    assert found.per_s == pytest.approx(np.abs(np.roots([INERTIA, damper, STIFFNESS])).max(), rel=1e-4)
    assert found.gains == tuple(f"robots.wheel.joint_pd.{gain}" for gain in gains)


def test_the_stiffest_of_many_is_named():
    scene = small_scene(PLANAR, {"robots.two.joint_pd": {"kp": 10.0, "kd": 1e5}})
    assert find_fastest_rate(build_closed_loop(scene)).gains == ("robots.two.joint_pd.kd",)


def test_a_loop_without_numbers_has_no_rate(tmp_path):
    loop = wheel(tmp_path, 1.0)
    assert find_fastest_rate(replace(loop, parameter_values=loop.parameter_values * np.nan)) is None
