"""Controllers whose update is a Python function: alone, in batches, by both engines, refused by gradients."""

import pytest

from tests import forks

HEAD = '''
import dataclasses
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np
import spacerobot as sr
from spacerobot.elements import PythonController, quantity
from tests.oracles.small_scenes import small_scene

sr.load_plugin(Path("examples/plugins/python_pd.py"))
ARM = """
name: arm
robots:
  one:
    urdf: odd_arm.urdf
    base: {joint: free_flyer, velocity: [0.01, 0.02, -0.01], spin_deg: [1, -2, 3]}
    joints: {slant: {angle_deg: 20, rate_deg: 5}, round: {angle_deg: -50}, slide: {speed: -0.02}}
simulation: {duration: 1, step: 0.005, output_step: 0.1}
"""

def scene(section, **more):
    return small_scene(ARM, {"robots.one.controllers": {"mine": section}} | more)

MINE = {"kind": "python_pd", "kp": 3.0, "kd": 1.5, "rate": 1e6, "period": 0.05}
'''

ALONE = """
# the law of kind joint_pd, whose expression is evaluated at the same instants
sampled = {"kind": "joint_pd", "kp": 3.0, "kd": 1.5, "sampled": {"period": 0.05}}
known, found = (sr.simulate(scene(one), backend="interpreted").data for one in (sampled, MINE))
found = found.sel(time=known.time, method="nearest")
np.testing.assert_allclose(found.time, known.time, atol=1e-12)
np.testing.assert_allclose(found.q, known.q, rtol=1e-9, atol=1e-11)
assert np.abs(found.joint_torque).max() > 0.1
again = sr.simulate(scene(MINE), backend="interpreted").data  # functions begin again in each simulation
np.testing.assert_array_equal(again.q.sel(time=known.time, method="nearest"), found.q)
checked = sr.simulate(scene(MINE, **{"simulation.engine": "pinocchio"})).data
checked = checked.sel(time=known.time, method="nearest")
np.testing.assert_allclose(checked.q, found.q, rtol=1e-6, atol=1e-7)
read = found.mine_input_joint_rate.values
np.testing.assert_allclose(read, found.v.values[:, 6:10], atol=1e-12)
"""

BATCH = """
# each simulation has its own function, with its own numbers, and remembers its own torques
values = {"robots.one.controllers.mine.kp": [1.0, 6.0, 2.0], "robots.one.links.d.mass": [1.0, 2.0, 3.0]}
slow = MINE | {"rate": 5.0}
batch = sr.batch(scene(slow), "base_rotation_peak", values, backend="interpreted")
for i in range(3):
    changes = {path: column[i] for path, column in values.items()}
    alone = sr.batch(scene(slow, **changes), "base_rotation_peak",
                     {"robots.one.controllers.mine.kd": [1.5]}, backend="interpreted")
    assert np.array_equal(batch.data.base_rotation_peak.values[i], alone.data.base_rotation_peak.values[0])
assert len(set(batch.data.base_rotation_peak.values[:, 0])) == 3
"""

BASE = """
@sr.register
class Spin(PythonController):
    "Constant torque on the base."
    kind: Literal["spin"] = "spin"
    base_wrench: ClassVar[frozenset[str]] = frozenset({"torque"})
    def update(self, t, measurements):
        assert set(measurements) == {"joint_position", "joint_rate", "base_position", "base_orientation",
                                     "base_velocity", "base_spin"}
        return [0.0] * 4 + [0.0, 0.3, 0.0]

found = sr.simulate(scene({"kind": "spin"}, **{
    "robots.one.actuators": {"base": {"kind": "base_wrench"}}}), backend="interpreted")
# the torque of 0.3 N m about y is all that acts from outside
change = found.data.momentum_angular.values[-1] - found.data.momentum_angular.values[0]
np.testing.assert_allclose(change, [0, 0.3, 0], atol=1e-9)
"""

REFUSED = """
def fault(call):
    try:
        call()
    except sr.SpaceRobotError as fault:
        assert "\\n" not in str(fault)
        return str(fault)
    raise AssertionError("not refused")

path = "robots.one.controllers.mine"
message = fault(lambda: sr.gradient(scene(MINE), "base_rotation_peak", [f"{path}.kp"]))
assert path in message and "Python function, which has no gradient" in message, message

@sr.register
class Broken(PythonController):
    "Fails in several ways."
    kind: Literal["broken"] = "broken"
    count: float = quantity("1", "number of forces", default=3.0)
    def update(self, t, measurements):
        return [1 / (t - 0.2) ** 0 / (abs(t - 0.2) > 1e-9)] * int(self.count)

message = fault(lambda: sr.simulate(scene({"kind": "broken"}), backend="interpreted"))
assert f"{path}: update at t = 0 s: ValueError: returned shape (3,), allowed: (4,), 4 of joints" in message
message = fault(lambda: sr.simulate(scene({"kind": "broken", "count": 4}), backend="interpreted"))
assert "update at t = 0.2 s: ZeroDivisionError" in message, message
"""


@pytest.mark.parametrize("script", [ALONE, BATCH, BASE, REFUSED], ids=["alone", "batch", "base", "refused"])
def test_controllers_with_a_python_update(script):
    done = forks.run(HEAD + script)
    assert done.returncode == 0, done.stderr


def test_the_command_line_runs_the_example(tmp_path):
    changes = ["robots.*.controllers={mine: {kind: python_pd}}", "simulation.duration=0.05"]
    words = [word for change in changes for word in ("--set", change)]
    plugin = ["--plugin", forks.ROOT / "examples/plugins/python_pd.py"]
    done = forks.command("run", "paper", *plugin, *words, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    done = forks.command("check", "paper", *plugin, *words)
    assert "python_pd, in Python every" in " ".join(done.stdout.split()), done.stdout
