"""Four ways to grasp a tumbling cylinder, on the same fresh draws: docs/validation/astrobee.md.

python -m benchmarks.astrobee train OUT 701         # a network by exact gradients, in 701 iterations (torch)
python -m benchmarks.astrobee evaluate OUT 1000     # a campaign of 1 000 draws
python -m benchmarks.astrobee follow OUT 1000       # one plan followed by feedback on 1 000 draws
python -m benchmarks.astrobee mpc OUT 1000          # model predictive control on 1 000 draws
python -m benchmarks.astrobee ppo OUT 2293760       # the same network by PPO, in 2 293 760 steps (sb3)
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
from scipy.spatial.transform import Rotation

import spacerobot as sr
from benchmarks.peers.compare import spent_s
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
    """Distance of tip and bar relative to 0.3 m, plus their misalignment relative to 2 rad, by grasp."""
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
    """Random weights; those of the last layer are small, so that the first commands are small."""
    rng, named = np.random.default_rng(seed), {}
    for k, (before, after) in enumerate(itertools.pairwise(SIZES)):
        gain = 0.1 if k == len(SIZES) - 2 else 1.0
        named[f"{2 * k}.weight"] = gain * rng.normal(size=(after, before)) / np.sqrt(before)
        named[f"{2 * k}.bias"] = np.zeros(after)
    return named


def prepared(out: Path, weights: dict[str, np.ndarray]) -> Path:
    """Scenario file in a new folder, with these weights."""
    out.mkdir(parents=True, exist_ok=True)
    for name in FILES:
        shutil.copy(EXAMPLES / name, out / name)
    np.savez(out / "astrobee.npz", **weights)
    return out / "astrobee.yaml"


def approach(file: Path, duration: float) -> sr.Scene:
    """Scene of the approach without its end, with the network as the only controller."""
    policy = yaml.safe_load(file.read_text())["robots"]["flyer"]["controllers"]["policy"]
    changes = {"robots.flyer.controllers": {"policy": policy}, "simulation.duration": duration}
    return sr.load_scene(file, APPROACH | changes)


def draws(scene: sr.Scene, count: int, rng: np.random.Generator) -> tuple[list[str], np.ndarray]:
    """Paths of the uncertain numbers, and random values of them (count, n)."""
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
    "body_position[target]",
    "body_momentum_linear[target]",
    "body_momentum_angular[target]",
    "grasp_gap",
    "grasp_misalignment",
)
"""Outputs in world axes (31 numbers), from which :func:`network_inputs` computes the network's inputs."""
CARGO_MASS, CARGO_INERTIA, BAR = 5.0, np.array([0.042, 0.042, 0.036]), np.array([-0.205, 0, 0])
"""Mass [kg] and inertia [kg m^2] of the cylinder, and the place of its bar [m]: grapple_cylinder.urdf."""
PERIOD = 0.1
FADED = 14_000_000
"""Number of steps at which the learning rate of PPO would be zero."""
BONUS = 10.0
"""Reward of a capture; the reward of each step is minus the cost of the approach times the period."""


def network_inputs(observed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inputs (N, 22) of the network in axes of the flyer's root link, and its rotations (N, 3, 3)."""
    joints, (velocity, spin), (turned, target_turned), (place, p, h), (gap, misaligned) = (
        observed[:, :4],
        observed[:, 4:10].reshape(-1, 2, 3).swapaxes(0, 1),
        observed[:, 10:16].reshape(-1, 2, 3).swapaxes(0, 1),
        observed[:, 16:25].reshape(-1, 3, 3).swapaxes(0, 1),
        observed[:, 25:31].reshape(-1, 2, 3).swapaxes(0, 1),
    )
    rotations = Rotation.from_rotvec(turned).as_matrix()
    cargo = Rotation.from_rotvec(target_turned)
    # the origin of the cylinder is its centre of mass; h is about the origin of the world
    target_spin = cargo.apply(cargo.inv().apply(h - np.cross(place, p)) / CARGO_INERTIA)
    bar = cargo.apply(np.tile(BAR, (len(place), 1)))
    vectors = [velocity, spin, -gap, -misaligned, p / CARGO_MASS + np.cross(target_spin, bar), target_spin]
    in_root = [np.einsum("nji,nj->ni", rotations, vector) for vector in vectors]
    return np.hstack([joints, *in_root]), rotations


def environments(file: Path, count: int, duration: float) -> Any:
    """Environments of the approach whose observations and actions are those of the network.

    Observations are the network's inputs. Actions are the values of its last layer before the tanh, so that a
    policy of PPO has the same limits of torque, force and base torque, in the same axes.
    """
    from gymnasium.spaces import Box
    from stable_baselines3.common.vec_env import VecEnvWrapper

    largest = {"flyer/shoulder": 0.05, "flyer/wrist": 0.05}
    # world axes, along which vectors of the box in axes of the root link reach sqrt(3) times as far
    largest |= {"flyer/base.force": 1.5 * np.sqrt(3), "flyer/base.torque": 0.15 * np.sqrt(3)}
    venv = sr.make_vector_environment(
        file,
        count,
        threads=1,
        interface="stable_baselines3",
        observations=OBSERVATIONS,
        actions=largest,
        reward={"events.captured": BONUS},
        terminations=["captured"],
        duration=duration,
        period=PERIOD,
        changes={"simulation.step": 0.02},
    )

    class NetworkAxes(VecEnvWrapper):
        """Wrapper with the network's inputs as observations, its commands as actions, and the reward."""

        def __init__(self) -> None:
            spaces = (Box(-np.inf, np.inf, (SIZES[0],)), Box(-3.0, 3.0, (SIZES[-1],)))
            super().__init__(venv, *spaces)

        def reset(self) -> np.ndarray:
            inputs, self.rotations = network_inputs(self.venv.reset())
            self.returns = np.zeros(count)
            return inputs

        def step_async(self, actions: np.ndarray) -> None:
            commands = np.tanh(actions).reshape(count, -1)
            wrench = np.einsum("nij,nkj->nki", self.rotations, commands[:, 2:].reshape(count, 2, 3))
            self.venv.step_async(np.hstack([commands[:, :2], wrench.reshape(count, 6) / np.sqrt(3)]))

        def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
            observed, rewards, ended, infos = self.venv.step_wait()
            reached = observed.copy()
            for row in np.flatnonzero(ended):
                reached[row] = infos[row]["terminal_observation"]
            inputs, self.rotations = network_inputs(observed)
            last, _ = network_inputs(reached)
            for row in np.flatnonzero(ended):
                infos[row]["terminal_observation"] = last[row]
            gap, turn = (np.square(reached[:, k : k + 3]).sum(axis=1) for k in (25, 28))
            cost = (np.sqrt(gap + GAP**2) - GAP) / 0.3 + (np.sqrt(turn + TURN**2) - TURN) / 2
            rewards = rewards - PERIOD * cost
            self.returns += rewards
            for row in np.flatnonzero(ended):
                infos[row]["episode"]["r"] = float(self.returns[row])
            self.returns[ended] = 0.0
            return inputs, rewards, ended, infos

    return NetworkAxes()


def ppo(out: Path, steps: int) -> None:
    """Train the same network by PPO with normalised observations and rewards, for a number of steps."""
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.vec_env import VecNormalize

    torch.set_num_threads(1)
    begin, used = time.perf_counter(), time.process_time()
    file = prepared(out, network(seed=1))
    venv = VecNormalize(environments(file, 256, duration=15.0), clip_obs=100.0)
    log, captures = [], []

    class Progress(BaseCallback):
        """Callback that logs the training and writes the present network."""

        def _on_step(self) -> bool:
            captures.extend(
                "grip.captured" in one["events"] for one in self.locals["infos"] if "episode" in one
            )
            return True

        def _on_rollout_end(self) -> None:
            wall, cpu = time.perf_counter() - begin, time.process_time() - used
            returns = [one["r"] for one in self.model.ep_info_buffer] or [np.nan]
            share = float(np.mean(captures[-256:])) if captures else 0.0
            log.append((self.num_timesteps, wall, cpu, share))
            if len(log) % 20 == 1:
                spread = self.model.policy.log_std.exp().detach().numpy().round(2)
                print(
                    f"{self.num_timesteps} {wall:.0f} s, cpu {cpu:.0f} s: captured {share:.2f}, "
                    f"noise {spread}, {np.mean(returns):.2f}",
                    flush=True,
                )
                export(out, self.model, venv)

    model = PPO(
        "MlpPolicy",
        venv,
        n_steps=64,
        batch_size=2048,
        n_epochs=6,
        learning_rate=lambda left: 1e-3 * (1 - (1 - left) * steps / FADED),
        policy_kwargs={"net_arch": {"pi": [SIZES[1]], "vf": [64, 64]}, "log_std_init": -1.0},
        seed=3,
    )
    # little noise at the joints: their torques turn light links, and a capture needs a slow gripper
    model.policy.log_std.data[:2] = -2.5
    model.learn(steps, callback=Progress())
    export(out, model, venv)
    model.save(out / "ppo")
    venv.save(str(out / "normalisation.pkl"))
    spent = {"wall_s": time.perf_counter() - begin, "cpu_s": time.process_time() - used}
    (out / "training.json").write_text(json.dumps({"steps": model.num_timesteps, **spent, "log": log}))
    print(spent)


def export(out: Path, model: Any, venv: Any) -> None:
    """Write the policy's mean as the network, with the normalisation of inputs in its first layer."""
    mean, scale = venv.obs_rms.mean, np.sqrt(venv.obs_rms.var + venv.epsilon)
    layers = [model.policy.mlp_extractor.policy_net[0], model.policy.action_net]
    (first, first_bias), (last, last_bias) = (
        [one.detach().numpy().astype(float) for one in (layer.weight, layer.bias)] for layer in layers
    )
    scaled = first / scale
    named = {"0.weight": scaled, "0.bias": first_bias - scaled @ mean}
    np.savez(out / "astrobee.npz", **named, **{"2.weight": last, "2.bias": last_bias})


WIDE = {
    f"campaign.parameters.spin_{axis}.{end}": sign * 23
    for axis in "xyz"
    for end, sign in (("lower", -1), ("upper", 1))
} | {"campaign.parameters.distance.lower": 1.2, "campaign.parameters.distance.upper": 2.0}
"""Ranges of the draws of mjorbit: 0.4 rad/s about each axis, 1.2 to 2 m."""


def evaluate(out: Path, samples: int) -> None:
    """Run campaigns of the scenario in a folder, on draws of another seed than those of training."""
    for name, changes in (("drawn", {}), ("wide", WIDE)):
        seeded = {"campaign.samples": samples, "campaign.seed": 4711}
        begin, used = time.perf_counter(), time.process_time()
        campaign = sr.campaign(sr.load_scene(out / "astrobee.yaml", seeded | changes), out / name)
        spent = {"wall_s": time.perf_counter() - begin, "cpu_s": time.process_time() - used}
        statistics = campaign.summary["gains"]["scenario"]
        text = json.dumps(
            {"spent": spent, "of": campaign.summary["of"]} | dict(statistics), indent=1, default=str
        )
        (out / f"{name}.json").write_text(text)
        print(name, spent, statistics["captured"], flush=True)


PLAN = {
    "duration": {"lower": 8, "upper": 28, "guess": 15},
    "goals": {"mate": {"tip": "flyer/gripper", "frame": "bar"}},
    "costs": {"torque": 1, "joint_acceleration": 0.1, "base_wrench": 1, "time": 0.05},
    "limits": {"base_force": 1.5, "base_torque": 0.15},
    "intervals": 16,
    "max_intervals": 64,
}


def follow(out: Path, samples: int) -> None:
    """Plan for the nominal numbers, and follow the plan with feedback on every draw."""
    file = prepared(out, network(seed=1))
    document = yaml.safe_load(file.read_text())
    controllers = document["robots"]["flyer"]["controllers"]
    del controllers["policy"]
    changes = {"phases.stop.robots": {}, "robots.flyer.controllers": controllers, "plan": PLAN}
    begin, used = time.perf_counter(), time.process_time()
    sr.plan(sr.load_scene(file, changes | {"campaign": None}), out / "plan")
    print({"wall_s": time.perf_counter() - begin, "cpu_s": time.process_time() - used})
    section = document["campaign"] | {"samples": samples, "seed": 4711}
    campaign = sr.campaign(
        sr.load_scene(out / "plan" / "followed.yaml", {"campaign": section}), out / "followed"
    )
    (out / "followed.json").write_text(
        json.dumps(campaign.summary["gains"]["scenario"], indent=1, default=str)
    )


REPLANNED = {
    "duration": 12,
    "goals": PLAN["goals"],
    "costs": {"torque": 1, "joint_acceleration": 0.1, "base_wrench": 1},
    "limits": PLAN["limits"],
    "intervals": 6,
}
LEAD = {
    "kind": "mpc",
    "period": 2.0,
    "min_horizon": 4.0,
    "kp": 0.2,
    "kd": 0.05,
    "kd_linear": 4.0,
    "kd_angular": 0.5,
}


def mpc(out: Path, samples: int) -> None:
    """Run a campaign under model predictive control, with a plan every two seconds."""
    file = prepared(out, network(seed=1))
    document = yaml.safe_load(file.read_text())
    controllers = document["robots"]["flyer"]["controllers"] | {"lead": LEAD}
    del controllers["policy"]
    changes = {
        "phases.stop.robots": {"flyer": {"controllers": {"lead": None}}},
        "robots.flyer.controllers": controllers,
        "plan": REPLANNED,
        "campaign": document["campaign"] | {"samples": samples, "seed": 4711},
    }
    begin, used = time.perf_counter(), spent_s()
    campaign = sr.campaign(sr.load_scene(file, changes), out / "replanned")
    spent = {"wall_s": time.perf_counter() - begin, "cpu_s": spent_s() - used}
    statistics = {"spent": spent, **campaign.summary["gains"]["scenario"]}
    (out / "replanned.json").write_text(json.dumps(statistics, indent=1, default=str))
    print(spent, statistics["captured"])


if __name__ == "__main__":
    {"train": train, "ppo": ppo, "evaluate": evaluate, "follow": follow, "mpc": mpc}[sys.argv[1]](
        Path(sys.argv[2]), int(sys.argv[3])
    )
