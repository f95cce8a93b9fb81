"""``spacerobot check``: validate a scenario before it is run."""

from __future__ import annotations

import spacerobot as sr
from spacerobot.cli.command import SIMULATE, Command
from spacerobot.cli.options import Changes, ScenarioName, load
from spacerobot.cli.output import print_next, show


@Command.of("check", place=2, group=SIMULATE)
def command(scenario: ScenarioName, changes: Changes = None) -> None:
    """Validate a scenario: print its scene as a tree, and every modelling assumption.

    Example:

        spacerobot check paper --set grasps.left.stiffness=200
    """
    show(sr.check(load(scenario, changes)))
    print_next(f"\nno errors; `spacerobot run {scenario}` simulates it")
