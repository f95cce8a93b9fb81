"""Memory that a result needs, compared with the available memory."""

from __future__ import annotations

import os
from pathlib import Path

from spacerobot.common.errors import ScenarioError
from spacerobot.scene.scene import Scene

BYTES_EACH = 8
COPIES = 3
"""Number of copies of each number held at once by engine, dataset and derived quantities."""
PART = 0.5
"""Maximum fraction of the available memory for a result."""


def check_size(scene: Scene) -> None:
    """Check that the result of a scene fits in memory, before anything is built or run.

    Raises:
        ScenarioError: If it does not; states the needed and allowed memory, and the number to change.
    """
    simulation = scene.scenario.simulation
    samples = int(simulation.duration / simulation.output_step) + 1
    width = numbers_each(scene)
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


def numbers_each(scene: Scene) -> int:
    """Numbers per sample in a result, without outputs of elements."""
    model = scene.model
    of_tips, of_bodies, of_grasps = 15 * len(scene.tips), 16 * len(scene.bodies), 9 * len(scene.grasps)
    return 14 + int(model.nq) + 4 * int(model.nv) + of_tips + of_bodies + of_grasps


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
