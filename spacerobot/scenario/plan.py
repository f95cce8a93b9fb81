"""Planning problem: duration, goals, costs, limits, and accuracy of the solution."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Literal

from pydantic import (
    Field,
    FieldSerializationInfo,
    ValidationError,
    ValidationInfo,
    field_serializer,
    field_validator,
    model_validator,
)

from spacerobot.common.section import Name, Paths, Section, Vector, is_number, quantity
from spacerobot.elements.core.registry import find_kind
from spacerobot.quantities import planned
from spacerobot.scenario.element_fields import ApproachCone, Goal, KeepOut, LineOfSight, PlanLimit
from spacerobot.scenario.merge import overlay, pick, without_null
from spacerobot.scenario.plan_cost import PlanCost
from spacerobot.scenario.tuning import DesignVariable
from spacerobot.scenario.validation_errors import explain


class TimeRange(Section):
    """Duration that is free between two limits; a number alone is a fixed duration."""

    lower: float = quantity("s", "least", gt=0)
    upper: float = quantity("s", "greatest", gt=0, le=1e5)
    guess: float | None = quantity("s", "initial guess; the middle if not given", default=None, gt=0)
    arrivals: int = Field(
        default=0,
        ge=0,
        le=100,
        description="number of fixed durations that are tried in turn instead of a free one, until a plan "
        "is verified: where a base flies to the tumbling target, those at which its goal there comes round "
        "to the side of the start, the shortest first, otherwise equally spaced ones; 0 for a free duration. "
        "The first verified plan is kept: limits passed between the mesh's points get a larger margin, and "
        "no mesh is refined to lower the cost",
    )

    @model_validator(mode="before")
    @classmethod
    def _given(cls, data: Any) -> Any:
        """Convert a number to two equal limits."""
        return {"lower": data, "upper": data} if is_number(data) else data

    @model_validator(mode="after")
    def _check(self) -> TimeRange:
        if not self.lower <= self.upper:
            raise ValueError(f"lower must not be above upper, found {self.lower:g} and {self.upper:g}")
        if self.guess is not None and not self.lower <= self.guess <= self.upper:
            raise ValueError(f"guess: found {self.guess:g}, allowed: {self.lower:g} to {self.upper:g}")
        return self


class JointStartRange(Section):
    """Range of a joint's initial position, to both sides of the scenario's value."""

    angle_deg: float | None = quantity("deg", "of a revolute or continuous joint", default=None, gt=0)
    offset: float | None = quantity("m", "of a prismatic joint", default=None, gt=0)

    @model_validator(mode="after")
    def _check(self) -> JointStartRange:
        if (self.angle_deg is None) == (self.offset is None):
            raise ValueError("give either `angle_deg` or `offset`")
        return self


class FreeStart(Section):
    """Range of a robot's initial posture and base pose, which the optimisation chooses."""

    joints: dict[str, JointStartRange] = Field(
        default={}, description="joints that may begin elsewhere, by name; `*` matches any letters"
    )
    position: Vector = quantity(
        "m",
        "distance along each world axis from its position within which a floating base may begin",
        default=(0.0, 0.0, 0.0),
    )
    rotation_deg: float = quantity(
        "deg", "angle, to both sides, within which a planar base may begin turned", default=0.0, ge=0, lt=180
    )

    @model_validator(mode="after")
    def _check(self) -> FreeStart:
        if min(self.position) < 0:
            raise ValueError("position: found a distance below 0")
        return self

    @property
    def places(self) -> bool:
        """Whether the initial base pose is free."""
        return any(self.position) or bool(self.rotation_deg)


class PlanChoice(Section):
    """Choice among several values, such as mating frames: each is planned, and the best plan is kept."""

    paths: Paths = Field(
        description="dotted paths in the scenario that take it: 'plan.goals.mate.frame', 'grasps.left.frame'",
    )
    among: tuple[str | float, ...] = Field(min_length=2, description="names or numbers")


WHOLE = (
    "choices",
    "model",
    "design",
    "collision_avoidance",
    "start",
    "max_intervals",
    "order",
    "tolerance",
    "starts",
    "iterations",
    "time_limit",
    "seed",
)
"""Keys that are the same in every phase."""
PASSED = "passed"
"""Validation context of a phase that is not the last one and may have no goals."""


class PlanSection(Section):
    """Planning problem and accuracy of its solution."""

    duration: TimeRange = quantity(
        "s",
        "duration, or the limits between which it is free; missing where phases give theirs",
        default=None,
    )
    goals: dict[Name, Goal] = Field(
        default={}, description="terminal conditions, by name; those of a phase are given in the phase"
    )
    start: dict[Name, FreeStart] = Field(
        default={},
        description="by robot: range of the initial posture and placement that the optimisation chooses",
    )
    costs: dict[Name, PlanCost] = Field(
        default={},
        description="terms of the cost, by name: a weight alone, or a section; the name is the kind where "
        "the section gives none",
    )
    limits: dict[Name, PlanLimit] = Field(
        default={},
        description="limits that hold at all times, by name: a number alone, or a section; the name is the "
        "kind where the section gives none. Ranges, rates and efforts of the URDFs hold in any case",
    )
    keep_out: dict[Name, KeepOut] = Field(default={}, description="pairs of shapes that stay apart, by name")
    approach_cones: dict[Name, ApproachCone] = Field(default={}, description="approach cones, by name")
    line_of_sight: dict[Name, LineOfSight] = Field(
        default={}, description="lines of sight that are kept, by name"
    )
    collision_avoidance: bool = Field(
        default=True,
        description="keep links apart that have collision shapes and touch nothing on purpose: of one robot, "
        "of several and of the target",
    )
    phases: dict[Name, dict[str, Any]] = Field(
        default={},
        description="the scenario's first phases, planned as one motion: duration and goals of each, and "
        "what else differs from the section, nested as in it; null for what does not hold there",
    )
    model: dict[str, Any] = Field(
        default={},
        description="numbers of the scenario, by dotted path, that are others in the model that plans are "
        "made with, by `mpc` too, than in the plant: masses, inertias, lengths",
    )
    design: dict[Name, DesignVariable] = Field(
        default={}, description="numbers of the scenario that a design study is free to choose, by name"
    )
    choices: dict[Name, PlanChoice] = Field(
        default={}, description="choices between a few values, by name: each is planned, the best is kept"
    )
    intervals: int = Field(default=16, ge=2, le=2000, description="intervals of the first mesh")
    max_intervals: int = Field(default=256, ge=2, le=4000, description="intervals of the finest mesh allowed")
    order: Literal[4, 6, 8] = Field(
        default=6, description="order of the collocation: 4 is Hermite and Simpson's, 6 and 8 extend it"
    )
    tolerance: float = quantity(
        "m", "maximum error of a tip when the plan's torques are replayed", default=1e-5, gt=0
    )
    open_loop: bool = Field(
        default=True,
        description="whether the tolerance holds without feedback too; false for long plans whose motion is "
        "unstable without it, as of an arm that pushes a heavy object for a minute",
    )
    starts: int = Field(default=1, ge=1, le=1000, description="number of initial guesses of the search")
    iterations: int = Field(default=500, ge=1, description="of one search, at most")
    time_limit: float = quantity(
        "s",
        "processor time after which one search, from one start or refining its mesh, begins no further "
        "iteration; nothing else depends on time",
        default=600.0,
        gt=0,
    )
    seed: int = Field(default=0, ge=0, description="everything random follows from it")

    @model_validator(mode="before")
    @classmethod
    def _absent(cls, data: Any) -> Any:
        """Remove null values of keys that may be defined by phases only."""
        if not isinstance(data, dict):
            return data
        return {key: one for key, one in data.items() if one is not None or key not in ("duration", "costs")}

    @field_validator("costs", "limits", mode="before")
    @classmethod
    def _complete_sections(cls, data: Any, info: ValidationInfo) -> Any:
        """Convert numbers and lists to sections, add missing kinds, and remove null entries."""
        if not isinstance(data, dict):
            return data
        entries = dict[Any, Any]()
        for name, one in data.items():
            if isinstance(one, int | float | list | tuple) and not isinstance(one, bool):
                kind = PlanCost if info.field_name == "costs" else find_kind("plan_limit", str(name))
                short = getattr(kind, "short", None)  # validation reports an unknown kind
                entries[name] = {"kind": str(name)} | ({short: one} if short else {})
            elif isinstance(one, dict):
                entries[name] = {"kind": str(name)} | one
            elif one is not None:
                entries[name] = one
        return entries

    @field_serializer("costs", "limits")
    def _short(self, value: dict[str, PlanCost | PlanLimit], info: FieldSerializationInfo) -> dict[str, Any]:
        """Short form as users write it: a number or list if no other key is set."""
        entries = dict[str, Any]()
        for name, one in value.items():
            document = one.model_dump(mode=info.mode, exclude_none=info.exclude_none)
            defaults = {
                key: field.get_default() for key, field in type(one).model_fields.items() if key != "kind"
            }
            changed = {key for key, default in defaults.items() if getattr(one, key) != default}
            short = one.short if one.kind == name and changed == {one.short} else None
            entries[name] = document[short] if short else document
        return entries

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> PlanSection:
        if self.max_intervals < self.intervals:
            raise ValueError(f"max_intervals: found {self.max_intervals}, allowed: at least {self.intervals}")
        if self.phases:
            return self._check_phases()
        for key in ("duration", "goals", "costs"):
            if not getattr(self, key) and (key, info.context) != ("goals", PASSED):
                raise ValueError(f"{key}: missing")
        for name, cost in self.costs.items():
            if (name == "time") != (cost.kind == "time"):
                raise ValueError(f"costs.{name}: found kind {cost.kind!r}; `time` is the duration's own name")
        if not any(cost.weight for cost in self.costs.values()):
            names = ", ".join(planned())
            raise ValueError(f"costs: nothing is to become small; give one of {names} a weight above 0")
        return self

    def _check_phases(self) -> PlanSection:
        """Validate each phase, merged with the section, and fill in its defaults."""
        if self.goals:
            names = ", ".join(self.phases)
            raise ValueError(
                f"goals.{next(iter(self.goals))}: of which phase? put it into `goals` of one of {names}"
            )
        base, phases = self._base(), {}
        for name, changes in self.phases.items():
            context = None if name == [*self.phases][-1] else PASSED
            for key in (*WHOLE, "phases"):
                if key in changes:
                    raise ValueError(f"phases.{name}.{key}: is the same in all phases; give it in `plan`")
            try:
                phases[name] = pick(self._laid_over(base, changes, context).model_dump(mode="json"), changes)
            except ValidationError as fault:
                where, message = explain(fault.errors(include_url=False)[0], overlay(base, changes))
                raise ValueError(f"phases.{name}.{where}: {message}") from None
        return self.model_copy(update={"phases": phases})

    def _base(self) -> dict[str, Any]:
        """Plain document with which phases are merged."""
        return self.model_dump(mode="json", exclude={"phases"}, exclude_none=True)

    @staticmethod
    def _laid_over(
        base: dict[str, Any], changes: dict[str, Any], context: str | None = PASSED
    ) -> PlanSection:
        """Section of a plain document with changes; null entries are removed."""
        document = overlay(base, changes)
        for key in ("keep_out", "approach_cones", "line_of_sight"):
            if isinstance(document[key], dict):
                document[key] = without_null(document[key])
        return PlanSection.model_validate(document, context=context)

    def every_limit(self) -> Iterator[tuple[str, str, PlanLimit]]:
        """Iterate over all limits: key of the section, name, limit."""
        for section in ("limits", "keep_out", "approach_cones", "line_of_sight"):
            for name, limit in getattr(self, section).items():
                yield section, name, limit

    @property
    def by_phase(self) -> dict[str, PlanSection]:
        """Sections of the phases by name; without phases, this section with an empty name."""
        if not self.phases:
            return {"": self}
        base, by_phase = self._base(), {}
        for name, changes in self.phases.items():
            by_phase[name] = self._laid_over(base, changes)
            base["start"] = {}  # the initial state is free in the first phase only
        return by_phase
