"""Environments of Gymnasium: its own checks, seeds, physics, rewards, terminations, errors."""

import pytest

import spacerobot as sr
from tests import forks

pytest.importorskip("gymnasium")

HEAD = """
import warnings
import gymnasium
import numpy as np
import spacerobot as sr
from gymnasium.utils.env_checker import check_env
from tests.oracles.small_scenes import small_scene

warnings.filterwarnings("ignore")
ARM = '''
name: arm
robots:
  one:
    urdf: odd_arm.urdf
    base: {joint: free_flyer, velocity: [0.01, 0.02, -0.01], spin_deg: [1, -2, 3]}
    joints: {slant: {angle_deg: 20, rate_deg: 5}, round: {angle_deg: -50}, slide: {speed: -0.02}}
    actuators: {base: {kind: base_wrench, torque: 0.5}}
simulation: {duration: 1, step: 0.005, output_step: 0.1}
'''

def arm(**options):
    return sr.make_environment(small_scene(ARM), backend="interpreted", **options)

def episode(env, seed, actions):
    rows = [env.reset(seed=seed)[0]]
    for action in actions:
        observation, reward, terminated, truncated, info = env.step(action)
        rows.append(np.append(observation, reward))
        if terminated or truncated:
            break
    return rows, terminated, truncated, info
"""

CHECKED = """
for name in ("capture", "detumble"):
    check_env(sr.make_environment(name, duration=0.5, backend="interpreted"), skip_render_check=True)
"""

RANDOM = """
env = sr.make_environment("SCENARIO", duration=0.2, backend="interpreted")
env.action_space.seed(1)
space, ended = env.observation_space, False
assert env.reset(seed=1)[0] in space
while not ended:
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    ended = terminated or truncated
    assert observation in space and np.isfinite(observation).all() and np.isfinite(reward)
assert (info["summary"]["status"]["state"] == "diverged") == bool(info.get("cause"))
"""

SEEDS = """
env = gymnasium.make("spacerobot.learning:spacerobot/Capture-v0", backend="interpreted").unwrapped
env.action_space.seed(3)
actions = [env.action_space.sample() * 0.1 for _ in range(3)]
first, *_ = episode(env, 5, actions)
other, *_ = episode(env, 6, actions)
again, *_ = episode(env, 5, actions)
assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
assert not np.array_equal(first[0], other[0])
# draws are those of the distribution, and the observation shows them
_, info = env.reset(seed=7)
x = info["draws"]["target.base.position.0"]
assert 2.35 < x < 2.45 and x != 2.4
_, following = env.reset()
assert following["draws"]["target.base.position.0"] != x
"""

PHYSICS = """
# nothing but the base's torque acts from outside: it is the rate of the angular momentum
env = arm(actions=["one/base.torque"], observations=["momentum_angular", "joint_torque"])
assert env.action_names == ["one/base.torque"] * 3
rows, terminated, truncated, info = episode(env, 0, [np.array([0.2, -0.4, 0.6])] * 20)
assert truncated and not terminated and len(rows) == 11
np.testing.assert_allclose(rows[-1][:3] - rows[0][:3], [0.1, -0.2, 0.3], atol=1e-9)
assert info["summary"]["status"]["state"] == "completed"
env.result().save("episode")
assert sr.load("episode").data.time.values[-1] == 1.0
assert np.abs(env.result().data.momentum_angular.values[-1] - rows[-1][:3]).max() == 0
# joints' torques are the actions times their limits, and stay inside
env = arm(actions={"one/slant": 2.0, "one/slide": 3.0}, observations=["joint_torque"])
rows, *_ = episode(env, 0, [[0.5, -9.0]])
assert sorted(rows[-1][:-1].tolist()) == [-3.0, 0.0, 0.0, 1.0], rows
"""

REWARD = """
env = arm(actions=["one/base.torque"], observations={"body_rotation": 0.01, "base_spin": 10.0},
          reward={"base_spin": -2.0, "action": -3.0}, period=0.25, limits={"base_spin": 1e-3})
(_, row), terminated, _, _ = episode(env, 0, [[0.1, 0.0, 0.0]])
spin = row[-4:-1]
assert terminated and np.abs(spin).max() > 1e-3
np.testing.assert_allclose(row[-1], 0.25 * (-2 * np.linalg.norm(spin) - 3 * 0.01), rtol=1e-6)
assert np.abs(row[:-4]).max() <= 0.01
env = arm(actions=["one/base.torque"], reward=lambda outputs, action, events: 7.0)
assert episode(env, 0, [[0.0, 0.0, 0.0]])[0][-1][-1] == 7.0
# the scenario's own feedback captures while the policy rests: a bonus, and the end of the episode
env = sr.make_environment("capture", feedback=True, period=1.0, terminations=["captured"],
                               reward={"events.captured": 10.0}, backend="interpreted")
zero = np.zeros(env.action_space.shape)
rows, terminated, truncated, info = episode(env, 0, [zero] * 30)
assert terminated and not truncated and "left.captured" in info["events"], info["events"]
assert [row[-1] for row in rows[1:]] == [0.0] * (len(rows) - 2) + [10.0]
until = sr.load_scene("capture", {"simulation.duration": len(rows) - 1})
events = sr.simulate(until, backend="interpreted").summary["events"]
alone = [event for event in events if event["kind"] == "captured"][0]
assert abs(info["summary"]["events"][-1]["time_s"] - alone["time_s"]) < 1e-3
assert len(rows) - 2 <= alone["time_s"] <= len(rows) - 1
"""

REFUSED = """
def fault(**options):
    try:
        arm(**{"actions": ["one/base.torque"]} | options)
    except sr.SpaceRobotError as fault:
        assert "\\n" not in str(fault)
        return str(fault)
    raise AssertionError("not refused")

assert "observations: found 'base_spinn', did you mean" in fault(observations=["base_spinn"])
assert "actions: found 'two/*'" in fault(actions=["two/*"])
assert "terminations: found 'captured', allowed: " in fault(terminations=["captured"])
assert "one/base.force has no limit in the scenario" in fault(actions=["one/base.force"])
assert "period: found 0, allowed: > 0 s" in fault(period=0)
assert "reward: found 'joint_torque_peek', did you mean" in fault(reward={"quantities.joint_torque_peek": 1})
assert "found the option 'rewards', did you mean" in fault(rewards={})
assert "robots.one.base.velocity.0 has no limit in the scenario; give one" in fault(
    actions=["robots.one.base.velocity.0"])
env = arm(actions=["one/base.torque"])
try:
    env.step([0.0, 0.0, 0.0])
except sr.SpaceRobotError as error:
    assert "call reset()" in str(error)
else:
    raise AssertionError("not refused")
"""

QUANTITIES = """
# torques are held, so what is measured of them follows from the actions: integrals grow, peaks rise
env = arm(actions={"one/slant": 2.0, "one/slide": 3.0}, observations=["joint_torque"], period=0.25,
          reward={"quantities.joint_torque_rms": -2.0, "quantities.joint_torque_peak": -5.0})
actions = np.array([[0.5, -0.1], [0.2, 0.6], [-0.8, 0.3], [0.1, 0.1]])
torques = actions * [2.0, 3.0]
rows, terminated, truncated, info = episode(env, 0, actions)
peaks = np.maximum.accumulate(np.abs(torques)).sum(axis=1)
expected = -2.0 * 0.25 * (torques**2).sum(axis=1) - 5.0 * np.diff(peaks, prepend=0.0)
np.testing.assert_allclose([row[-1] for row in rows[1:]], expected, rtol=1e-9)
metrics = info["metrics"]
np.testing.assert_allclose(metrics["joint_torque_peak"], np.abs(torques).max(), rtol=1e-9)
np.testing.assert_allclose(metrics["joint_torque_rms"], np.sqrt((torques**2).mean(axis=0).sum()), rtol=1e-9)
"""

NUMBERS = """
from spacerobot.scene import build_scene

def changed(scene, changes):
    return build_scene(scene.scenario, changes, source=scene.source)

# an action that holds a gain or a number of a reference equals the scenario with that number
scene = small_scene(ARM, {
    "robots.one.controllers": {"pd": {"kind": "joint_pd", "kp": 6.0, "kd": 1.0, "ik_rate": 5}},
    "robots.one.tips.tip": {"pid": {"kp": 20, "kd": 4},
                            "reference": {"kind": "line", "displacement": [0.1, 0, 0], "duration": 1}}})
gain, target = "robots.one.controllers.pd.kd", "robots.one.tips.tip.reference.displacement.1"
env = sr.make_environment(scene, actions={gain: [1.0, 3.0], target: 0.2}, backend="interpreted",
                          observations=["joint_position", "tip_error"])
assert env.action_names == [gain, target]
rows, *_ = episode(env, 0, [[-0.5, 0.25]] * 10)
alone = sr.simulate(changed(scene, {gain: 1.5, target: 0.05}))
np.testing.assert_allclose(rows[-1][:4], alone.data.joint_position.values[-1], atol=1e-8)
np.testing.assert_allclose(rows[-1][4:7], alone.data.tip_error.values[-1].ravel(), atol=1e-8)
other, *_ = episode(env, 0, [[0.5, -0.25]] * 10)
assert np.abs(other[-1] - rows[-1]).max() > 1e-3
# limits of a gain are those of the variable that tunes it
tuned = changed(scene, {"tuning": {"variables": {"kd": {"paths": gain, "lower": 1.0, "upper": 3.0}}}})
env = sr.make_environment(tuned, actions=[gain], backend="interpreted", observations=["joint_position"])
np.testing.assert_allclose(episode(env, 0, [[-0.5]] * 3)[0][-1][:4],
                           sr.simulate(changed(scene, {gain: 1.5})).data.joint_position.values[3], atol=1e-8)
"""

DIVERGED = """
# a rollout that is lost costs the worst step so far for each step left, and the bonus of its event
env = arm(actions={"one/slide": 1e7}, observations=["joint_rate"],
          reward={"joint_rate": -1.0, "events.diverged": -7.0})
rows, terminated, truncated, info = episode(env, 0, [[0.0], [0.0], [1.0], [1.0]])
assert terminated and not truncated and info["cause"]
assert info["summary"]["status"]["state"] == "diverged", info["summary"]["status"]
rewards = [row[-1] for row in rows[1:]]
left = 10 - (len(rewards) - 1)
worst = min(*rewards[:-1], -0.1 * np.linalg.norm(rows[0]))
np.testing.assert_allclose(rewards[-1], worst * left - 7.0, rtol=1e-9)
assert np.isfinite(rows[-1]).all()
env.reset(seed=1)
assert not env.step([0.0])[2]
"""

SCRIPTS = {"checked": CHECKED, "seeds": SEEDS, "physics": PHYSICS, "reward": REWARD, "refused": REFUSED}
SCRIPTS |= {"quantities": QUANTITIES, "numbers": NUMBERS, "diverged": DIVERGED}


@pytest.mark.parametrize("script", SCRIPTS.values(), ids=SCRIPTS)
def test_environments(script, tmp_path):
    script = script.replace('"episode"', repr(str(tmp_path / "episode")))
    done = forks.run(HEAD + script)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", list(sr.list_scenarios().scenarios))
def test_a_random_policy_runs_in_every_shipped_scenario(name):
    done = forks.run(HEAD + RANDOM.replace("SCENARIO", name))
    assert done.returncode == 0, done.stderr


def test_a_saved_episode_is_read_and_animated_without_learning(tmp_path):
    save = """
env = arm(actions=["one/base.torque"])
episode(env, 0, [np.array([0.2, -0.4, 0.6])] * 3)
env.result().save("episode")
"""
    read = """
import spacerobot as sr
from spacerobot.elements import kinds
# a kind that ships is known in every process
assert kinds("robot_controller")["policy"].__module__.startswith("spacerobot.elements.")
result = sr.load("episode")
assert abs(result.data.time.values[-1] - 0.3) < 1e-12
sr.animate(result, "episode/page.html")
"""
    folder = repr(str(tmp_path / "episode"))
    for script in (HEAD + save, read.replace('"episode/page.html"', repr(str(tmp_path / "page.html")))):
        done = forks.run(script.replace('"episode"', folder))
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "page.html").stat().st_size > 1e5
