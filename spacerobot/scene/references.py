"""References of each tip in each phase: its own, the target's, or none."""

from __future__ import annotations

from collections.abc import Mapping

from spacerobot.elements import create
from spacerobot.scenario import Scenario
from spacerobot.scenario.paths import Document
from spacerobot.scene.scene import SceneReference


def references_of(
    label: str, scenario: Scenario, during: Mapping[str, Scenario]
) -> tuple[SceneReference, ...]:
    """References of a tip, in the order of the phases in which they become active.

    Args:
        label: Label of the tip, ``robot/tip``.
        scenario: The resolved scenario.
        during: Scenario in each phase, by name; empty if there are no phases.
    """
    if not during:
        return (_reference(label, scenario, {}, ""),)
    references: dict[tuple[str, bool], SceneReference] = {}
    for name, merged in during.items():
        reference = _reference(label, merged, scenario.phases[name].changes, name)
        key = reference.path, reference.from_target
        phases = (*(references[key].phases if key in references else ()), name)
        references[key] = SceneReference(reference.path, reference.config, reference.from_target, phases)
    return tuple(references.values())


def _reference(label: str, scenario: Scenario, changes: Document, phase: str) -> SceneReference:
    """Reference of a tip in a scenario; a phase-specific one carries the phase's name."""
    robot, _, name = label.partition("/")
    tip, target = scenario.robots[robot].tips[name], scenario.target
    place = f"robots.{robot}.tips.{name}.reference"
    tip_changes = changes.get("robots", {}).get(robot, {}).get("tips", {}).get(name, {})
    is_grasping = any(grasp.tip == label for grasp in scenario.grasps.values())
    if tip.reference is None and is_grasping and target is not None and target.reference is not None:
        target_changes = changes.get("target", {})
        return SceneReference(
            _in(phase, "target.reference", "reference" in target_changes), target.reference, True
        )
    reference = tip.reference or create("reference", "hold")
    return SceneReference(_in(phase, place, tip_changes.get("reference") is not None), reference, False)


def _in(phase: str, path: str, differs: bool) -> str:
    return f"phases.{phase}.{path}" if differs else path
