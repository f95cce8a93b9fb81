"""Four ways to grasp a tumbling cylinder, on the same fresh draws: docs/validation/astrobee.md.

python -m benchmarks.astrobee train OUT 701         # a network by exact gradients, in 701 iterations (torch)
python -m benchmarks.astrobee evaluate OUT 1000     # a campaign of 1 000 draws
python -m benchmarks.astrobee follow OUT 1000       # one plan followed by feedback on 1 000 draws
python -m benchmarks.astrobee ppo OUT 1200          # PPO (extra learning, stable-baselines3)
python -m benchmarks.astrobee evaluate_ppo OUT 200  # 200 episodes
"""

from __future__ import annotations

import itertools
import json
import shutil
import sys
import time
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import yaml

import spacerobot as sr
from optim.evaluation import parameter_paths
from spacerobot.quantities import Quantity

EXAMPLES = Path(__file__).parents[1] / "examples"
FILES = ("astrobee.yaml", "free_flyer.urdf", "grapple_cylinder.urdf")
LAYERS = "robots.flyer.controllers.policy.layers"
SIZES = (22, 32, 8)
GAP, TURN = 0.03, 0.1
"""Distance [m] and angle [rad] below which the cost of training is quadratic."""
APPROACH = {
    "phases": {},
    "grasps.grip.capture.distance": 1e-9,  # no capture: the approach goes on
    "simulation.step": 0.05,
}


def approach_cost(context: Any) -> dict[str, Any]:
    """Distance of tip and bar, and their misalignment, in parts of what a capture allows."""
    gaps, turns = (context.signal(name) for name in ("grasp_gap", "grasp_misalignment"))
    return {
        name: (ca.sqrt(ca.sumsqr(gap) + GAP**2) - GAP) / 0.3
        + (ca.sqrt(ca.sumsqr(turns[name]) + TURN**2) - TURN) / 2
        for name, gap in gaps.items()
    }


sr.register_quantity(
    Quantity(
        name="approach_cost",
        label="cost of the approach",
        description="distance of tip and bar, and their misalignment, over time",
        unit="s",
        reducer="integral",
        expression=approach_cost,
        absent="no grasp captures",
    )
)


def network(seed: int) -> dict[str, np.ndarray]:
    """Random weights; those of the last layer are small, so that the first commands are."""
    rng, named = np.random.default_rng(seed), {}
    for k, (before, after) in enumerate(itertools.pairwise(SIZES)):
        gain = 0.1 if k == len(SIZES) - 2 else 1.0
        named[f"{2 * k}.weight"] = gain * rng.normal(size=(after, before)) / np.sqrt(before)
        named[f"{2 * k}.bias"] = np.zeros(after)
    return named


def prepared(out: Path, weights: dict[str, np.ndarray]) -> Path:
    """Scenario in a folder of its own, with these weights."""
    out.mkdir(parents=True, exist_ok=True)
    for name in FILES:
        shutil.copy(EXAMPLES / name, out / name)
    np.savez(out / "astrobee.npz", **weights)
    return out / "astrobee.yaml"


def approach(file: Path, duration: float) -> sr.Scene:
    """Scene of the approach alone, without an end: the network acts, nothing else."""
    policy = yaml.safe_load(file.read_text())["robots"]["flyer"]["controllers"]["policy"]
    changes = {"robots.flyer.controllers": {"policy": policy}, "simulation.duration": duration}
    return sr.load_scene(file, APPROACH | changes)


def draws(scene: sr.Scene, count: int, rng: np.random.Generator) -> tuple[list[str], np.ndarray]:
    """Paths of the uncertain numbers, and values drawn of them (count, n)."""
    parameters = scene.scenario.campaign.parameters.values()
    low, high = (np.array([getattr(one, key) for one in parameters]) for key in ("lower", "upper"))
    return [one.paths[0] for one in parameters], rng.uniform(low, high, (count, len(low)))


def train(out: Path, iterations: int, size: int = 16) -> None:
    """Train the network by exact gradients with Adam, for a number of iterations."""
    import torch

    torch.set_num_threads(1)
    begin = time.perf_counter()
    file = prepared(out, network(seed=1))
    rng = np.random.default_rng(2)
    log, fly, weights, horizon = [], None, None, 0
    for iteration in range(iterations):
        passed = iteration / iterations
        needed = 10 if passed < 0.4 else 25  # short rollouts first: their gradients are the milder ones
        if needed != horizon:
            horizon = needed
            scene = approach(file, horizon)
            drawn_paths, _ = draws(scene, 1, rng)
            count = len(parameter_paths(scene, LAYERS))
            fly = sr.torch.rollout(scene, "approach_cost", [LAYERS, *drawn_paths], threads=2)
            if weights is None:
                weights = fly.start[:count].clone().requires_grad_()
                optimiser = torch.optim.Adam([weights], lr=3e-3)
            print(f"ready after {time.perf_counter() - begin:.0f} s", flush=True)
        for group in optimiser.param_groups:
            group["lr"] = 3e-3 if passed < 0.6 else 1e-3 if passed < 0.85 else 3e-4
        values = torch.as_tensor(draws(scene, size, rng)[1])
        costs = fly(torch.cat([weights.expand(size, -1), values], 1))[:, 0]
        loss = costs.mean() / horizon
        optimiser.zero_grad()
        loss.backward()
        norm = float(torch.nn.utils.clip_grad_norm_([weights], 1.0))
        optimiser.step()
        if iteration % 10 == 0 or iteration == iterations - 1:
            log.append((iteration, time.perf_counter() - begin, loss.item(), norm))
            print(f"{iteration} {log[-1][1]:.0f} s: {loss.item():.4f} |g| {norm:.3f}", flush=True)
            save(out, weights.detach().numpy())
    training = {"iterations": iterations, "wall_s": time.perf_counter() - begin, "log": log}
    (out / "training.json").write_text(json.dumps(training))


def save(out: Path, values: np.ndarray) -> None:
    """Write weights (k,), in the order of the scenario's paths."""
    named, first = {}, 0
    for k, (before, after) in enumerate(itertools.pairwise(SIZES)):
        named[f"{2 * k}.weight"] = values[first : first + before * after].reshape(after, before)
        first += before * after
        named[f"{2 * k}.bias"] = values[first : first + after]
        first += after
    np.savez(out / "astrobee.npz", **named)


OBSERVATIONS = (
    "joint_position",
    "joint_rate",
    "base_velocity",
    "base_spin",
    "body_rotation",
    "tip_velocity",
    "grasp_gap",
    "grasp_misalignment",
    "body_momentum_linear",
    "body_momentum_angular",
)
"""Observations of PPO: world axes, as an environment offers them."""


def environment(file: Path) -> Any:
    """Environment of the approach, with the limits of the network's commands."""
    return sr.make_environment(
        file,
        observations=OBSERVATIONS,
        actions={
            "flyer/shoulder": 0.05,
            "flyer/wrist": 0.05,
            "flyer/base.force": 1.5,
            "flyer/base.torque": 0.15,
        },
        reward={"grasp_gap": -1.0, "grasp_misalignment": -0.3, "action": -0.01, "events.captured": 10.0},
        terminations=["captured"],
        limits={"grasp_gap": 3.0},
        duration=30.0,
        period=0.1,
    )


def ppo(out: Path, seconds: float) -> None:
    """Train by PPO, with observations and rewards normalised, until the time is over."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    torch.set_num_threads(1)
    file = prepared(out, network(seed=1))
    begin, used = time.perf_counter(), time.process_time()
    venv = VecNormalize(DummyVecEnv([lambda: environment(file)]))
    venv.seed(3)

    class UntilLate(BaseCallback):
        """Stop when the time is over."""

        def _on_step(self) -> bool:
            return time.perf_counter() - begin < seconds

    model = PPO("MlpPolicy", venv, n_steps=3000, batch_size=250, policy_kwargs={"net_arch": [32, 32]}, seed=3)
    model.learn(100_000_000, callback=UntilLate())
    model.save(out / "ppo")
    venv.save(str(out / "normalisation.pkl"))
    spent = {
        "steps": model.num_timesteps,
        "wall_s": time.perf_counter() - begin,
        "cpu_s": time.process_time() - used,
        "episode_reward": float(np.mean([one["r"] for one in model.ep_info_buffer] or [np.nan])),
    }
    (out / "ppo.json").write_text(json.dumps(spent))
    print(spent)


def evaluate_ppo(out: Path, episodes: int) -> None:
    """Captures of the policy of PPO in fresh episodes."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    env = environment(out / "astrobee.yaml")
    scales = VecNormalize.load(str(out / "normalisation.pkl"), DummyVecEnv([lambda: env]))
    model, captured = PPO.load(out / "ppo", device="cpu"), 0
    for episode in range(episodes):
        observation, _ = env.reset(seed=10_000 + episode)
        done = False
        while not done:
            action, _ = model.predict(scales.normalize_obs(observation), deterministic=True)
            observation, _, terminated, truncated, info = env.step(action)
            done = terminated or truncated
        captured += "grip.captured" in info["events"]
        (out / "ppo_episodes.json").write_text(json.dumps({"episodes": episode + 1, "captured": captured}))


WIDE = {
    f"campaign.parameters.spin_{axis}.{end}": sign * 23
    for axis in "xyz"
    for end, sign in (("lower", -1), ("upper", 1))
} | {"campaign.parameters.distance.lower": 1.2, "campaign.parameters.distance.upper": 2.0}
"""Draws as wide as those of mjorbit: 0.4 rad/s about each axis, 1.2 to 2 m."""


def evaluate(out: Path, samples: int) -> None:
    """Campaigns of the scenario in a folder, on draws of another seed than those of training."""
    for name, changes in (("drawn", {}), ("wide", WIDE)):
        seeded = {"campaign.samples": samples, "campaign.seed": 4711}
        begin, used = time.perf_counter(), time.process_time()
        done = sr.campaign(sr.load_scene(out / "astrobee.yaml", seeded | changes), out / name)
        spent = {"wall_s": time.perf_counter() - begin, "cpu_s": time.process_time() - used}
        found = done.summary["gains"]["scenario"]
        text = json.dumps({"spent": spent, "of": done.summary["of"]} | dict(found), indent=1, default=str)
        (out / f"{name}.json").write_text(text)
        print(name, spent, found["captured"], flush=True)


PLAN = {
    "duration": {"lower": 8, "upper": 28, "guess": 15},
    "goals": {"mate": {"tip": "flyer/gripper", "frame": "bar"}},
    "costs": {"torque": 1, "joint_acceleration": 0.1, "base_wrench": 1, "time": 0.05},
    "limits": {"base_force": 1.5, "base_torque": 0.15},
    "intervals": 16,
    "max_intervals": 64,
}


def follow(out: Path, samples: int) -> None:
    """Plan for the scenario's own numbers, and fly the plan with feedback on every draw."""
    file = prepared(out, network(seed=1))
    document = yaml.safe_load(file.read_text())
    controllers = document["robots"]["flyer"]["controllers"]
    del controllers["policy"]
    changes = {"phases.stop.robots": {}, "robots.flyer.controllers": controllers, "plan": PLAN}
    begin, used = time.perf_counter(), time.process_time()
    sr.plan(sr.load_scene(file, changes | {"campaign": None}), out / "plan")
    print({"wall_s": time.perf_counter() - begin, "cpu_s": time.process_time() - used})
    section = document["campaign"] | {"samples": samples, "seed": 4711}
    done = sr.campaign(sr.load_scene(out / "plan" / "followed.yaml", {"campaign": section}), out / "followed")
    (out / "followed.json").write_text(json.dumps(done.summary["gains"]["scenario"], indent=1, default=str))


if __name__ == "__main__":
    {"train": train, "ppo": ppo, "evaluate": evaluate, "evaluate_ppo": evaluate_ppo, "follow": follow}[
        sys.argv[1]
    ](Path(sys.argv[2]), int(sys.argv[3]))
