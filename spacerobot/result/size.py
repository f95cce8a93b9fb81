"""How much memory a result takes, and whether there is as much."""

from __future__ import annotations

import os
from pathlib import Path

from spacerobot.closedloop import ClosedLoop
from spacerobot.errors import ScenarioError
from spacerobot.scene import Scene

BYTES_EACH = 8
COPIES = 3
"""Engine, dataset and what is derived of them hold each number about so often at once."""
PART = 0.5
"""Of the available memory that a result may take."""


def check_size(scene: Scene, loop: ClosedLoop) -> None:
    """Refuse, before anything runs, a result that the memory does not hold.

    Raises
    ------
    ScenarioError
        Saying what it would take, what is allowed, and which number to change.
    """
    simulation = scene.scenario.simulation
    samples = int(simulation.duration / simulation.output_step) + 1
    width = len(loop.state_names) + sum(loop.outputs.numel_out(i) for i in range(loop.outputs.n_out()))
    needed, allowed = samples * width * BYTES_EACH * COPIES, PART * available_memory()
    if needed > allowed:
        longer = 1.1 * simulation.output_step * needed / allowed
        raise ScenarioError(
            f"the result would take {needed / 1e9:.3g} GB of memory ({samples} samples x {width} numbers x "
            f"{BYTES_EACH * COPIES} bytes), allowed: {allowed / 1e9:.3g} GB, half of what is free; raise "
            f"`simulation.output_step` to {longer:.2g} s or more, or lower `simulation.duration`",
            source=scene.source,
            where="simulation.output_step",
        )


def available_memory() -> float:
    """Memory that could be had without swapping [bytes]; infinite where the system does not say."""
    try:
        text = Path("/proc/meminfo").read_text(encoding="ascii")
        lines = dict(line.split(":", 1) for line in text.splitlines())
        return float(lines["MemAvailable"].split()[0]) * 1024
    except (OSError, KeyError, ValueError):
        pass
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # not a Unix
        return float("inf")
