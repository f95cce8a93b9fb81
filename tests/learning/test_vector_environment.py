"""Many simulations as one environment: seeds, resets of one alone, lanes and threads, adaptors."""

import pytest

from tests import forks

pytest.importorskip("gymnasium")

HEAD = """
import warnings
import gymnasium
import numpy as np
import spacerobot as sr
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
OPTIONS = {
    "actions": ["one/base.torque"],
    "observations": ["base_spin", "joint_rate"],
    "reward": {"base_spin": -1.0, "quantities.base_rotation_peak": -2.0, "action": -0.1},
    # ends the episodes of some, each at a time of its own; the last period is shorter than the others
    "limits": {"base_spin": 0.08},
    "duration": 0.75,
    "draws": {"spin": {"paths": "robots.one.base.spin_deg.*", "apply": "offset", "lower": -1.5,
                       "upper": 1.5}},
}

def many(count, threads=1, backend="interpreted", **options):
    options = OPTIONS | {"backend": backend} | options
    return sr.make_vector_environment(small_scene(ARM), count, threads=threads, **options)

def actions_of(count, steps):
    generators = [np.random.default_rng(100 + i) for i in range(count)]
    return [np.array([each.uniform(-1, 1, 3) for each in generators]) for _ in range(steps)]

def flown(env, steps=20, seed=3):
    rows = [np.pad(env.reset(seed=seed)[0], ((0, 0), (0, 3)))]
    for actions in actions_of(env.num_envs, steps):
        observations, rewards, terminated, truncated, info = env.step(actions)
        rows.append(np.column_stack([observations, rewards, terminated, truncated]))
    return np.array(rows), info
"""

RESET = """
# episodes of many are those of one with the same seed and actions, those after a reset among them
env, single = many(3), sr.make_environment(small_scene(ARM), backend="interpreted", **OPTIONS)
assert env.metadata["autoreset_mode"] is gymnasium.vector.AutoresetMode.SAME_STEP
start = env.reset(seed=5)[0]
singles = [sr.make_environment(small_scene(ARM), backend="interpreted", **OPTIONS) for _ in range(3)]
for i, one in enumerate(singles):
    np.testing.assert_allclose(start[i], one.reset(seed=5 + i)[0], atol=1e-12)
ends = []
for k, actions in enumerate(actions_of(3, 20)):
    observations, rewards, terminated, truncated, info = env.step(actions)
    for i, one in enumerate(singles):
        seen, reward, stopped, cut, last = one.step(actions[i])
        np.testing.assert_allclose(rewards[i], reward, atol=1e-12)
        assert (terminated[i], truncated[i]) == (stopped, cut)
        assert info["time_s"][i] == last["time_s"]
        if stopped or cut:
            ends.append((k, i, bool(stopped)))
            np.testing.assert_allclose(info["final_obs"][i], seen, atol=1e-12)
            peak = info["final_info"]["metrics"]["base_rotation_peak"][i]
            np.testing.assert_allclose(peak, last["metrics"]["base_rotation_peak"], rtol=1e-12)
            seen, begun = one.reset()
            path = "robots.one.base.spin_deg.0"
            assert info["draws"][path][i] == begun["draws"][path]
        else:
            assert "final_obs" not in info or not info["_final_obs"][i]
        np.testing.assert_allclose(observations[i], seen, atol=1e-12)
# some ended alone, by their limit and by their duration
assert len({k for k, _, _ in ends}) > 2 and {stopped for _, _, stopped in ends} == {True, False}, ends
made = gymnasium.make_vec("spacerobot.learning:spacerobot/Capture-v0", 2,
                          vectorization_mode="vector_entry_point", backend="interpreted")
assert made.reset(seed=1)[0].shape == (2, *made.single_observation_space.shape)
"""

LANES = """
whole, info = flown(many(19, threads=2, backend="compiled"))
for count, threads in ((3, 2), (11, 1)):
    part, _ = flown(many(count, threads=threads, backend="compiled"))
    assert np.array_equal(part, whole[:, :count])
assert whole[1:, :, -2:].any(axis=2).any(axis=0).all()
interpreted, _ = flown(many(3))
np.testing.assert_allclose(interpreted, whole[:, :3], atol=1e-9)
"""

REFUSED = """
def fault(work):
    try:
        work()
    except sr.SpaceRobotError as fault:
        assert "\\n" not in str(fault)
        return str(fault)
    raise AssertionError("not refused")

assert "num_envs: found 0, allowed: at least 1" in fault(lambda: many(0))
assert "interface: found 'sb3', allowed: gymnasium, stable_baselines3" in fault(
    lambda: sr.make_vector_environment("capture", interface="sb3"))
env = many(2)
assert "call reset()" in fault(lambda: env.step(np.zeros((2, 3))))
assert "seed: found 1 seeds, allowed: 2, or one" in fault(lambda: env.reset(seed=[1]))
env.reset()
assert "actions of shape (3,), allowed: (2, 3)" in fault(lambda: env.step(np.zeros(3)))
"""

BASELINES = """
from stable_baselines3.common.vec_env import VecNormalize
env, other = many(3), many(3, interface="stable_baselines3")
other.seed(3)
first, _ = env.reset(seed=3)
assert np.array_equal(other.reset(), first)
returns = np.zeros(3)
for actions in actions_of(3, 12):
    observations, rewards, terminated, truncated, info = env.step(actions)
    seen, gained, ended, infos = other.step(actions)
    assert np.array_equal(seen, observations) and np.array_equal(gained, rewards)
    assert np.array_equal(ended, terminated | truncated)
    returns += rewards
    for i in np.flatnonzero(ended):
        assert np.array_equal(infos[i]["terminal_observation"], info["final_obs"][i])
        assert infos[i]["TimeLimit.truncated"] == truncated[i]
        np.testing.assert_allclose(infos[i]["episode"]["r"], returns[i])
        returns[i] = 0
normalised = VecNormalize(other)
assert normalised.reset().shape == (3, 7)
assert other.get_attr("num_envs", [0, 2]) == [3, 3]
"""


def run(script):
    done = forks.run(HEAD + script)
    assert done.returncode == 0, done.stderr


def test_an_episode_that_ends_is_reset_alone():
    run(RESET)


@pytest.mark.compiler
def test_episodes_do_not_depend_on_lanes_threads_or_the_number_of_environments():
    run(LANES)


def test_wrong_calls_are_refused():
    run(REFUSED)


def test_the_adaptor_of_stable_baselines_gives_the_same_episodes():
    pytest.importorskip("stable_baselines3", reason="stable-baselines3 (extra sb3) is not installed")
    run(BASELINES)
