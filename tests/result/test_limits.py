"""Joints beyond the limits of their URDFs leave a warning with joint, time and excess."""

from __future__ import annotations

import numpy as np
import pytest

import spacerobot as sr
from tests.oracles.small_scenes import small_scene

LOOSE = """
robots:
  one:
    urdf: odd_arm.urdf
    base: {joint: fixed}
    joints: {wrist: {angle_deg: 170, rate_deg: 30}, '*': {damping: 0}}
simulation: {duration: 0.2, step: 0.01, output_step: 0.1}
"""
"""An arm whose wrist turns freely past its limit of 3 rad."""


def test_a_joint_beyond_its_range_is_warned_of():
    result = sr.simulate(small_scene(LOOSE), backend="interpreted")
    (found,) = [one for one in result.summary["beyond_limits"] if one["joint"] == "one/wrist"]
    angle = np.degrees(result.data.joint_position.sel(joint="one/wrist").values)
    assert (found["quantity"], found["unit"]) == ("position", "deg")
    assert found["limit"] == pytest.approx(np.degrees(3.0))
    assert found["excess"] == pytest.approx(angle.max() - np.degrees(3.0))
    assert found["from_s"] == pytest.approx(0.07, abs=0.011)  # 1.9 deg at 30 deg/s, seen at every step
    (warning,) = [text for text in result.summary["warnings"] if "position beyond" in text]
    assert "one/wrist from 0.07 s on, by up to 4." in warning


def test_rates_and_travels_have_their_own_units():
    changes = {"robots.one.joints": {"slide": {"offset": 0.99, "speed": 1.2}}}
    found = sr.simulate(small_scene(LOOSE, changes), backend="interpreted").summary["beyond_limits"]
    units = {one["quantity"]: (one["unit"], one["limit"]) for one in found if one["joint"] == "one/slide"}
    assert units == {"position": ("m", 1.0), "rate": ("m/s", 1.0)}


def test_within_all_limits_nothing_is_said():
    still = {"robots.one.joints": {"wrist": {"angle_deg": 10}}}
    summary = sr.simulate(small_scene(LOOSE, still), backend="interpreted").summary
    assert "beyond_limits" not in summary
    assert not [text for text in summary["warnings"] if "beyond" in text]
