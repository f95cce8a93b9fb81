"""Numbers and words of a scenario that the studio can change, with their descriptions from the schema."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import annotated_types
import numpy as np
from pydantic.fields import FieldInfo

from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.common.section import Section, is_number, leaves
from spacerobot.elements.core.element import Element
from spacerobot.elements.core.registry import kinds
from spacerobot.scenario import Scenario
from spacerobot.scenario.load import to_document
from spacerobot.scenario.paths import expand
from spacerobot.scenario.units import unit_at
from spacerobot.scene import Scene
from viz.studio.messages import LARGEST

Value = float | int | bool | str | None
LEFT_OUT = ("name", "description", "tuning", "campaign", "plan")
"""Sections of a scenario that do not affect the motion."""

REACH = {"deg": 45.0, "deg/s": 10.0, "m": 0.1, "m/s": 0.1}
"""Half-range of the slider of an angle or of a zero value, by unit; 1 for other units."""

DECADES = 10.0  # a slider of a positive number reaches so many times lower and higher


@dataclass(frozen=True)
class Leaf:
    """One number or word of a scenario.

    Attributes:
        path, value: Dotted path and value.
        kind: ``number``, ``choice``, ``truth`` or ``text``.
        unit, text: Unit and description from the schema.
        low, high: Minimum and maximum allowed value; None without a limit.
        open_ends: Whether the limits themselves are excluded.
        choices: Allowed words of a choice.
        joint_range: For the initial position of a joint, its lower and upper limit, infinite without limits
            in the URDF; None for other numbers.
    """

    path: str
    value: Value
    kind: Literal["number", "choice", "truth", "text"]
    unit: str
    text: str
    low: float | None = None
    high: float | None = None
    open_ends: tuple[bool, bool] = (False, False)
    choices: tuple[str, ...] = ()
    joint_range: tuple[float, float] | None = None

    def check(self, value: Any) -> None:
        """Refuse a value that is not allowed.

        Raises:
            ScenarioError: If it is refused; the message states the value and the allowed ones.
        """
        if self.kind == "number" and not isinstance(value, dict | list | None):
            problem = self.fault(value)
        else:
            strange = self.choices and isinstance(value, str) and value not in self.choices
            problem = near_names(str(value), self.choices) if strange else ""
        if problem:
            raise ScenarioError(f"found {value!r}, {problem}", where=self.path)

    def fault(self, value: Any) -> str:
        """Reason why a number is not allowed; empty if it is."""
        if isinstance(value, bool | str) or not abs(value) < LARGEST:
            return "allowed: a finite number"
        low, high = self.low, self.high
        if low is not None and (value < low or (self.open_ends[0] and value == low)):
            return f"allowed: {'above' if self.open_ends[0] else 'at least'} {low:g}"
        if high is not None and (value > high or (self.open_ends[1] and value == high)):
            return f"allowed: {'below' if self.open_ends[1] else 'at most'} {high:g}"
        return ""

    def plain(self, ends: tuple[float, float, str] | None, free: bool) -> dict[str, Any]:
        """Plain data for the page, with ``ends`` of its slider where the tuning section gives them."""
        entry = {"path": self.path, "value": self.value, "kind": self.kind, "text": self.text, "free": free}
        if self.kind != "number":
            return entry | ({"choices": list(self.choices)} if self.choices else {})
        limits = {"unit": self.unit, "low": self.low, "high": self.high}
        slider = self.slider
        if ends:
            # a wider range if the value is at an end or beyond it
            low, high, scale = ends
            value = float(self.value) if isinstance(self.value, int | float) else 0.0
            if not (low < value < high or (low == value == self.low and value < high)):
                low, high = min(low, slider[0]), max(high, slider[1])
                scale = "log" if low > 0 and high / low > 2 * DECADES else scale
            slider = low, high, scale
        return entry | limits | {"slider": list(slider), "joint": self.joint_range is not None}

    @property
    def slider(self) -> tuple[float, float, str]:
        """Ends of a slider, and its scale."""
        value = float(self.value) if isinstance(self.value, int | float) else 0.0
        if self.joint_range is not None and np.isfinite(self.joint_range).all():
            low, high = self.joint_range  # a joint that begins beyond its limits is simulated with a warning
            return min(low, value), max(high, value), "linear"
        if value > 0 and self.low is not None and self.low >= 0:
            high = DECADES * value if self.high is None else min(self.high, DECADES * value)
            return value / DECADES, high, "log"
        reach = REACH.get(self.unit, 0.0) if self.unit == "deg" or not value else abs(value)
        reach = reach or 1.0
        low, high = value - reach, value + reach
        low = low if self.low is None else max(low, self.low)
        return low, high if self.high is None else min(high, self.high), "linear"


def find_leaves(scene: Scene) -> dict[str, Leaf]:
    """Leaves of a scene's resolved scenario by dotted path, in its order."""
    scenario: Scenario = scene.scenario
    leaves_by_path = {}
    for path, value, field, owner in _walk(scenario, "", None, scenario):
        if value is not None and path.partition(".")[0] not in (*LEFT_OUT, "phases"):
            leaves_by_path[path] = _leaf(path, value, field, owner, unit_at(scenario, path))
    for name in scenario.phases:
        phase_paths = {path for path, _ in leaves(to_document(scenario)["phases"][name])}
        during = scenario.during(name)
        for path, value, field, owner in _walk(during, "", None, during):
            if path in phase_paths and is_number(value):
                full_path = f"phases.{name}.{path}"
                leaves_by_path[full_path] = _leaf(full_path, value, field, owner, unit_at(during, path))
    for body in scene.bodies:
        for joint in body.description.joints:
            turns = joint.kind != "prismatic"
            path = f"{body.path}.joints.{joint.name}.{'angle_deg' if turns else 'offset'}"
            if path in leaves_by_path:
                limits = np.degrees([joint.lower, joint.upper]) if turns else (joint.lower, joint.upper)
                leaves_by_path[path] = replace(
                    leaves_by_path[path], joint_range=(float(limits[0]), float(limits[1]))
                )
    return leaves_by_path


def suggested(scene: Scene, free: Collection[str]) -> dict[str, tuple[float, float, str] | None]:
    """Paths with an initial slider, and bounds and scale of each.

    They are the numbers of the tuning section with its bounds. Without such numbers they are some gains,
    stiffnesses and dampings, whose bounds are None.
    """
    document = to_document(scene.scenario)
    sliders: dict[str, tuple[float, float, str] | None] = {}
    for variable in scene.scenario.tuning.variables.values() if scene.scenario.tuning else ():
        for pattern in variable.paths:
            with suppress(ScenarioError):  # it may need changes of the section
                ends = (variable.lower, variable.upper, variable.scale)
                sliders |= dict.fromkeys((path for path in expand(document, pattern) if path in free), ends)
    ending = re.compile(r"\.tips\..*\.(kp|ki|kd)$|^grasps\..*\.(stiffness|damping)$")
    gains = [path for path, _ in leaves(document) if path in free and ending.search(path)]
    return sliders or dict.fromkeys(gains[:12])


def _walk(
    node: Any, path: str, field: FieldInfo | None, owner: Section
) -> Iterator[tuple[str, Value, FieldInfo | None, Section]]:
    """Every leaf with its field, and the section that has it."""
    if isinstance(node, Section):
        for name, info in type(node).model_fields.items():
            if isinstance(node, Element) and name == node.fills:
                continue  # points of a plan, which a file holds
            yield from _walk(getattr(node, name), _join(path, name), info, node)
    elif isinstance(node, Mapping):
        for name, child in node.items():
            yield from _walk(child, _join(path, str(name)), field, owner)
    elif isinstance(node, list | tuple):
        for index, child in enumerate(node):
            yield from _walk(child, _join(path, str(index)), field, owner)
    elif isinstance(node, int | float | str | None):
        yield path, node, field, owner


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _leaf(path: str, value: Value, field: FieldInfo | None, owner: Section, unit: str) -> Leaf:
    text = re.sub(r" \[[^\]]*\]$", "", (field.description or "") if field else "")
    if isinstance(value, bool):
        return Leaf(path, value, "truth", "", text)
    if isinstance(value, int | float):
        low: float | None = None
        high: float | None = None
        is_open = [False, False]
        for rule in field.metadata if field else ():
            if isinstance(rule, annotated_types.Ge | annotated_types.Gt):
                is_open[0] = isinstance(rule, annotated_types.Gt)
                low = float(rule.gt if isinstance(rule, annotated_types.Gt) else rule.ge)  # type: ignore[arg-type]
            elif isinstance(rule, annotated_types.Le | annotated_types.Lt):
                is_open[1] = isinstance(rule, annotated_types.Lt)
                high = float(rule.lt if isinstance(rule, annotated_types.Lt) else rule.le)  # type: ignore[arg-type]
        return Leaf(path, value, "number", unit, text, low, high, (is_open[0], is_open[1]))
    if isinstance(owner, Element) and path.endswith(".kind"):
        choices = tuple(kinds(owner.family))
    else:
        choices = tuple(_words(field.annotation)) if field else ()
    return Leaf(path, value, "choice" if choices else "text", "", text, choices=choices)


def _words(annotation: Any) -> Iterator[str]:
    """Words of a ``Literal``, also inside a union."""
    for part in get_args(annotation):
        if isinstance(part, str):
            yield part
        else:
            yield from _words(part)
