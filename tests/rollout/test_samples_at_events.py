"""On which side of an event an output sample is, as docs/explanation/events.md states it."""

import numpy as np
import yaml

from spacerobot.scene import load_scene
from spacerobot.simulation import simulate

SCENARIO = """
robots:
  arm:
    urdf: short_arm.urdf
    base: {joint: planar}
    joints: {joint_1: {angle_deg: 50}, joint_2: {angle_deg: -80}, joint_3: {angle_deg: 30}}
    tips:
      tip:
        pid: {kp: 20, ki: 10, kd: 1, feedback: inertial, sampled: {period: 0.1}}
        reference: {kind: line, displacement: [0.15, 0.1, 0], duration: 0.5}
phases:
  first: {until: {time: 0.15}}
  second: {robots: {arm: {tips: {tip: {pid: {kp: 15}}}}}}
simulation: {duration: 0.2, step: 0.005, output_step: 0.05}
"""


def test_a_sample_precedes_an_event_and_follows_a_sample_instant(tmp_path):
    (tmp_path / "sides.yaml").write_text(yaml.safe_dump(yaml.safe_load(SCENARIO)), encoding="utf-8")
    data = simulate(load_scene(tmp_path / "sides.yaml"), backend="interpreted").data
    np.testing.assert_array_equal(data.phase.values.ravel(), [0, 0, 0, 0, 1])  # the event is at 0.15 s
    start, held, sampled, same, _ = data.joint_torque.values[:, 0]
    assert start == 0 != held
    assert sampled != held
    assert same == sampled
