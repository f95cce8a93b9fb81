"""Page data of many rollouts: quantiles of signals over time, and tip paths of some rollouts."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from spacerobot.closedloop import ClosedLoop
from spacerobot.common.arrays import Array
from spacerobot.result import Result, Summary
from spacerobot.result.dataset import build_dataset
from spacerobot.result.summary import unled_tips
from spacerobot.rollout import Batch, Rollout, Trajectory
from spacerobot.rollout.batch import Stop
from spacerobot.scene import Scene
from viz.page.meshcat_scene import packed
from viz.page.signals import quantities

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)
MOST_TIMES = 201
MOST_PATHS = 100
MOST_BANDED = 200
"""Number of rollouts, the first ones, from which quantiles are computed."""

MOST_SIGNALS = 150
"""Maximum number of signals with bands, in the page's order."""

PIECE_BYTES = 100_000_000
"""Maximum size [bytes] of a batch with all states and outputs."""


class CampaignSpread:
    """Rollouts of one scene, gathered piece by piece.

    Args:
        scene: The scene.
        rollout: Compiled rollout of the scene.
    """

    def __init__(self, scene: Scene, rollout: Rollout) -> None:
        assert isinstance(rollout.loop, ClosedLoop)
        self._scene, self._loop, self._rollout = scene, rollout.loop, rollout
        self._time = np.zeros(0)
        self._signals: dict[tuple[str, str], list[Array]] = {}
        self._paths: list[Array] = []

    @property
    def most(self) -> int:
        """Rollouts of a piece at most: as many as fit into memory."""
        width = self._loop.outputs.numel_out() + len(self._loop.state_names)
        return max(1, PIECE_BYTES // (8 * width * (self._rollout.grid.intervals + 1)))

    def roll(self, paths: Sequence[str], values: Array, stop: Stop | None = None) -> Batch:
        """Roll out a piece and store the displayed data; diverged rollouts are left out.

        ``paths`` and ``values`` are those of :meth:`spacerobot.rollout.Rollout.batch`.
        """
        remaining_count = MOST_BANDED - len(self._paths)
        outputs = [variable.name for variable in self._loop.variables] if remaining_count else []
        batch = self._rollout.batch(paths, values, outputs=outputs, states=remaining_count > 0, stop=stop)
        if batch.state is None or not batch.done.all():
            return batch
        every = max(1, len(batch.time) // (MOST_TIMES - 1))
        self._time = batch.time[::every]
        state = batch.state[:, ::every]
        valid_samples = np.isfinite(state).all(axis=2).sum(axis=1)  # an event may end one early
        for k in np.flatnonzero(np.isnan(batch.diverged_at_s) & (valid_samples > 0))[:remaining_count]:
            end = int(valid_samples[k])
            series = {name: rows[k, ::every][:end] for name, rows in batch.outputs.items()}
            self._paths.append(
                np.pad(series["tip_position"], ((0, len(self._time) - end), (0, 0)), mode="edge")
            )
            nothing: dict[str, Any] = {"measures": {}, "costs": {}, "diverged_at_s": None, "steps": 0}
            nothing |= {"status": "completed", "step_s": np.nan, "backend": batch.backend, "wall_s": 0.0}
            rolled = Trajectory(self._time[:end], state[k, :end], series, **nothing)
            data = build_dataset(self._scene, rolled, self._loop)
            summary = cast(Summary, {"unled_tips": unled_tips(self._scene)})  # `quantities` reads no more
            plotted = quantities(Result(self._scene.scenario, data, summary))
            every_signal = ((quantity.title, signal) for quantity in plotted for signal in quantity.signals)
            for title, signal in itertools.islice(every_signal, MOST_SIGNALS):
                padded = np.full(len(self._time), np.nan)
                padded[:end] = signal.values
                self._signals.setdefault((title, signal.name), []).append(padded)
        return batch

    def data(self) -> dict[str, Any]:
        """Bands and paths so far.

        Returns:
            dict: ``time`` (nt,); ``bands`` (signals, quantiles, nt) in their quantities' units,
                ``quantiles``, and ``signals``, title of the quantity and name of each; ``paths`` (shown, nt,
                tips, 3) [m] with its ``shape``; ``drawn``, how many rollouts.
        """
        tips = len(self._scene.tips)
        paths = np.reshape(
            self._paths[:MOST_PATHS], (min(MOST_PATHS, len(self._paths)), len(self._time), tips, 3)
        )
        # quantiles of the rollouts that are still running at each time; NaN if none is
        bands = np.full((len(self._signals), len(QUANTILES), len(self._time)), np.nan)
        for band, rows in zip(bands, map(np.array, self._signals.values()), strict=True):
            has_values = np.isfinite(rows).any(axis=0)
            band[:, has_values] = np.nanquantile(rows[:, has_values], QUANTILES, axis=0)
        return {
            "time": packed(self._time),
            "quantiles": list(QUANTILES),
            "signals": [list(signal) for signal in self._signals],
            "bands": packed(bands),
            "paths": packed(paths),
            "shape": list(paths.shape),
            "drawn": len(self._paths),
        }
