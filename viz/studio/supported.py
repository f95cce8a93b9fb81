"""Scenarios that the studio simulates."""

from __future__ import annotations

from typing import TYPE_CHECKING

from spacerobot.common.errors import ScenarioError

if TYPE_CHECKING:
    from spacerobot.scenario.scenario import Scenario


def check_supported(scenario: Scenario) -> None:
    """Check that one rollout simulates the scenario.

    Raises:
        ScenarioError: If the scenario names another engine, or a controller is updated by a planner or by a
            Python function.
    """
    engine = scenario.simulation.engine
    if engine != "casadi":
        raise ScenarioError(f"found {engine!r}, allowed in the studio: casadi", where="simulation.engine")
    for name, robot in scenario.robots.items():
        for key, controller in robot.controllers.items():
            if controller.update_scheme:
                raise ScenarioError(
                    f"found kind {controller.kind!r}, whose updates are too slow for the studio: "
                    "`spacerobot run --view` simulates and shows this scenario",
                    where=f"robots.{name}.controllers.{key}",
                )
