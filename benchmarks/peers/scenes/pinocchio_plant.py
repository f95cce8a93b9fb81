"""The arms without forces once more, by ``pin.aba`` in a loop written in Python."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from benchmarks.peers.compare import Job, Outcome, PeerScene, Side, compare
from benchmarks.peers.scenes.mujoco_plant import DURATION, TITLE, TOLERANCE, our_plant, passive
from benchmarks.plain_loop import configuration_rate
from spacerobot.common.arrays import Array
from spacerobot.exports.mjcf_bodies import coordinates
from spacerobot.scene import Scene


def python_loop(
    scene: Scene, duration_s: float, step_s: float, acceleration: Callable[[Array, Array], Array]
) -> Side:
    """Classical Runge-Kutta steps of (q, v), normalised after each."""
    model = scene.model

    def rate(x: Array) -> Array:
        q, v = x[: model.nq], x[model.nq :]
        return np.concatenate([configuration_rate(model, q, v), acceleration(q, v)])

    def ready(level: int) -> Job:
        h = step_s / 2**level

        def run() -> Array:
            x = np.concatenate([scene.q, scene.v])
            for _ in range(round(duration_s / h)):
                k1 = rate(x)
                k2 = rate(x + h / 2 * k1)
                k3 = rate(x + h / 2 * k2)
                k4 = rate(x + h * k3)
                x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
                x[: model.nq] = pin.normalize(model, x[: model.nq])
            return np.concatenate(coordinates(scene, x[: model.nq], x[model.nq :]))

        return run

    return Side(ready, lambda level: f"RK4 in Python, {step_s / 2**level * 1e3:g} ms")


def measure() -> Outcome:
    """Joint damping is the only force."""
    scene = passive()
    model, data = scene.model, scene.model.createData()
    theirs = python_loop(scene, DURATION, 0.02, lambda q, v: pin.aba(model, data, q, v, -model.damping * v))
    return compare(our_plant(scene, 0.08), theirs, TOLERANCE)


SCENE = PeerScene("Pinocchio", "pin", TITLE, "`pin.aba`; its wheel has no compiled loop around it", measure)
