"""The planning problem: what a motion shall come to, what is small on the way, and what must hold."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError, ValidationInfo, model_validator

from spacerobot.elements import Family
from spacerobot.elements.contact import Wrap
from spacerobot.elements.goal import Goal
from spacerobot.scenario.faults import explain
from spacerobot.scenario.merge import overlay, pick
from spacerobot.scenario.tuning import Variable
from spacerobot.section import Name, Section, Vector, quantity

Source = Literal["position", "rate", "torque"]


class Span(Section):
    """A time that is free between two limits; a number alone is a time that is given."""

    lower: float = quantity("s", "least", gt=0)
    upper: float = quantity("s", "greatest", gt=0, le=1e5)
    guess: float | None = quantity("s", "where the search begins; halfway if not given", default=None, gt=0)

    @model_validator(mode="before")
    @classmethod
    def _given(cls, data: Any) -> Any:
        """Take a number for two equal limits."""
        number = isinstance(data, int | float) and not isinstance(data, bool)
        return {"lower": data, "upper": data} if number else data

    @model_validator(mode="after")
    def _check(self) -> Span:
        if not self.lower <= self.upper:
            raise ValueError(f"lower must not be above upper, found {self.lower:g} and {self.upper:g}")
        if self.guess is not None and not self.lower <= self.guess <= self.upper:
            raise ValueError(f"guess: found {self.guess:g}, allowed: {self.lower:g} to {self.upper:g}")
        return self


class Room(Section):
    """How far from the scenario's own position a joint may begin, to both sides."""

    angle_deg: float | None = quantity("deg", "of a revolute or continuous joint", default=None, gt=0)
    offset: float | None = quantity("m", "of a prismatic joint", default=None, gt=0)

    @model_validator(mode="after")
    def _check(self) -> Room:
        if (self.angle_deg is None) == (self.offset is None):
            raise ValueError("give either `angle_deg` or `offset`")
        return self


class Beginning(Section):
    """Where a robot may begin: what of its posture and its base's placement is to be found too."""

    joints: dict[str, Room] = Field(
        default={}, description="joints that may begin elsewhere, by name; `*` stands for any letters"
    )
    position: Vector = quantity(
        "m", "how far a floating base may begin from its place along each world axis", default=(0.0, 0.0, 0.0)
    )
    rotation_deg: float = quantity(
        "deg", "how far a planar base may begin turned, to both sides", default=0.0, ge=0, lt=180
    )

    @model_validator(mode="after")
    def _check(self) -> Beginning:
        if min(self.position) < 0:
            raise ValueError("position: found a distance below 0")
        return self

    @property
    def places(self) -> bool:
        """Whether the base may begin elsewhere."""
        return any(self.position) or bool(self.rotation_deg)


class Costs(Section):
    """What is to become small: a sum of these, each with its weight."""

    torque: float = quantity(
        "1/(N^2 m^2 s)", "weight of the integral of squared joint torques and forces", default=0.0, ge=0
    )
    joint_rate: float = quantity(
        "s/rad^2", "weight of the integral of squared joint rates and speeds", default=0.0, ge=0
    )
    joint_acceleration: float = quantity(
        "s^3/rad^2",
        "weight of the integral of squared joint accelerations: keeps arms of many links from whipping",
        default=0.0,
        ge=0,
    )
    base_rotation: float = quantity(
        "1/(rad^2 s)",
        "weight of the integral of the robots' squared base rotations since the start",
        default=0.0,
        ge=0,
    )
    base_translation: float = quantity(
        "1/(m^2 s)",
        "weight of the integral of the robots' squared base displacements since the start",
        default=0.0,
        ge=0,
    )
    base_wrench: float = quantity(
        "1/(N^2 s)",
        "weight of the integral of squared forces [N] and torques [N m] on the bases",
        default=0.0,
        ge=0,
    )
    propellant: float = quantity(
        "1/(N s)",
        "weight of the impulse that propellant is spent for: the integral of the forces' magnitudes along "
        "each axis of driven bases; the search rounds them off below 1 % of their limit, the plan reports "
        "what is spent",
        default=0.0,
        ge=0,
    )
    impact_speed: float = quantity(
        "s^2/m^2",
        "weight of the squared speeds [m/s] and spins [rad/s] with which tips come to their mating frames",
        default=0.0,
        ge=0,
    )
    base_reaction: float = quantity(
        "1/(N^2 s)",
        "weight of the integral of squared forces [N] and torques [N m] of arms on their bases",
        default=0.0,
        ge=0,
    )
    wheel_momentum: float = quantity(
        "1/(N^2 m^2 s^3)",
        "weight of the integral of squared angular momenta of reaction wheels about their axes, where they "
        "alone turn a base",
        default=0.0,
        ge=0,
    )
    grip_force: float = quantity(
        "1/(N^2 s)", "weight of the integral of squared forces of grasps that hold", default=0.0, ge=0
    )
    grip_torque: float = quantity(
        "1/(N^2 m^2 s)", "weight of the integral of squared torques of grasps that hold", default=0.0, ge=0
    )
    time: float = quantity("1/s", "weight of the duration", default=0.0, ge=0)

    @model_validator(mode="after")
    def _check(self) -> Costs:
        if not any(weight for _, weight in self):
            names = ", ".join(type(self).model_fields)
            raise ValueError(f"nothing is to become small; give one of {names} a weight above 0")
        return self


class Bounds(Section):
    """What must hold at all times; ranges, rates and efforts of the URDFs do where they are given there."""

    urdf: tuple[Source, ...] = Field(
        default=(), description="limits that every planned joint must have in its URDF"
    )
    joint_rate_deg: float | None = quantity(
        "deg/s", "greatest rate of any revolute or continuous joint", default=None, gt=0
    )
    joint_speed: float | None = quantity("m/s", "greatest speed of any prismatic joint", default=None, gt=0)
    torque: float | None = quantity("N m or N", "greatest torque or force of any joint", default=None, gt=0)
    base_rotation_deg: float | None = quantity(
        "deg", "greatest rotation of any robot's base since the start", default=None, gt=0, lt=180
    )
    base_translation: float | None = quantity(
        "m", "greatest displacement of any robot's base since the start", default=None, gt=0
    )
    base_force: float | None = quantity(
        "N",
        "greatest force along each axis that drives a floating base, 0 for none; that of its actuators if "
        "not given",
        default=None,
        ge=0,
    )
    base_torque: float | None = quantity(
        "N m", "greatest torque about each axis, likewise", default=None, ge=0
    )
    wheel_momentum: float | None = quantity(
        "N m s",
        "greatest angular momentum of any reaction wheel about its axis, where wheels alone turn a base",
        default=None,
        gt=0,
    )
    grip_force: float | None = quantity("N", "greatest force of any grasp that holds", default=None, gt=0)
    grip_torque: float | None = quantity("N m", "greatest torque of any grasp that holds", default=None, gt=0)


class KeepOut(Section):
    """Two shapes, or groups of them, that stay apart."""

    between: tuple[str, str] = Field(
        description="the two, each the name of a pad, or robot/link or target/link for all collision shapes "
        "of a link; `*` in a link's name stands for any letters"
    )
    distance: float = quantity("m", "least distance", default=0.0, ge=0)
    wrap: Wrap | None = Field(
        default=None, description="shape of the same extents that stands in for meshes and cylinders"
    )


class Cone(Section):
    """A tip that comes to a mating frame inside a cone about its axis of approach."""

    tip: str = Field(description="which tip, as robot/tip")
    frame: str = Field(description="mating frame, a link of the target's URDF")
    axis: Vector = quantity("1", "direction of approach in the mating frame", default=(1.0, 0.0, 0.0))
    half_angle_deg: float = quantity("deg", "between its axis and its surface", gt=0, lt=90)
    radius: float = quantity("m", "of its cut in the mating frame's plane", default=0.01, gt=0)
    last: float = quantity(
        "1", "part of the duration, at its end, for which it holds", default=0.2, gt=0, le=1
    )


class Sight(Section):
    """A camera that keeps a mating frame in sight."""

    camera: str = Field(description="link that carries it, as robot/link; it is at the link's origin")
    axis: Vector = quantity("1", "direction in which it looks, axes of that link", default=(1.0, 0.0, 0.0))
    frame: str = Field(description="mating frame, a link of the target's URDF")
    half_angle_deg: float = quantity("deg", "between its axis and the edge of what it sees", gt=0, lt=180)
    last: float = quantity(
        "1", "part of the duration, at its end, for which it holds", default=1.0, gt=0, le=1
    )

    @model_validator(mode="after")
    def _check(self) -> Sight:
        if not any(self.axis):
            raise ValueError("axis: found 0 0 0, allowed: a direction")
        return self


class Choice(Section):
    """One of several values, such as mating frames: each is planned, and the best plan is kept."""

    paths: tuple[str, ...] = Field(
        min_length=1,
        description="dotted paths in the scenario that take it: 'plan.goals.mate.frame', 'grasps.left.frame'",
    )
    among: tuple[str | float, ...] = Field(min_length=2, description="names or numbers")

    @model_validator(mode="before")
    @classmethod
    def _one(cls, data: Any) -> Any:
        """Take one path for a list of one."""
        if isinstance(data, dict) and isinstance(data.get("paths"), str):
            return data | {"paths": [data["paths"]]}
        return data


WHOLE = ("choices", "design", "start", "most_intervals", "order", "tolerance", "starts", "iterations", "seed")
"""Keys that are the same in every phase."""
PASSED = "passed"
"""Told of a phase that is not the last one, and may end anywhere."""


class Planning(Section):
    """The planning problem, and how well it is to be solved."""

    duration: Span = quantity(
        "s",
        "duration, or the limits between which it is free; missing where phases give theirs",
        default=None,
    )
    goals: dict[Name, Annotated[Goal, Family("goal")]] = Field(
        default={}, description="what holds at the end, by name; those of phases stand there"
    )
    start: dict[Name, Beginning] = Field(
        default={}, description="by robot: where it may begin, as far as that is to be found"
    )
    costs: Costs = Field(default=None, description="what is to become small")  # type: ignore[assignment]
    limits: Bounds = Field(default=Bounds(), description="what must hold at all times")
    keep_out: dict[Name, KeepOut] = Field(default={}, description="what stays apart, by name")
    cones: dict[Name, Cone] = Field(default={}, description="approach cones, by name")
    sights: dict[Name, Sight] = Field(default={}, description="lines of sight that are kept, by name")
    phases: dict[Name, dict[str, Any]] = Field(
        default={},
        description="the scenario's first phases, planned as one motion: duration and goals of each, and "
        "what else differs from the section, nested as in it; null for what does not hold there",
    )
    design: dict[Name, Variable] = Field(
        default={}, description="numbers of the scenario that a design study is free to choose, by name"
    )
    choices: dict[Name, Choice] = Field(
        default={}, description="what is taken from a few values, by name: each is planned, the best is kept"
    )
    intervals: int = Field(default=16, ge=2, le=2000, description="intervals of the first mesh")
    most_intervals: int = Field(
        default=256, ge=2, le=4000, description="intervals of the finest mesh allowed"
    )
    order: Literal[4, 6, 8] = Field(
        default=6, description="order of the collocation: 4 is Hermite and Simpson's, 6 and 8 go on from it"
    )
    tolerance: float = quantity(
        "m", "greatest error of a tip when the plan's torques are replayed", default=1e-5, gt=0
    )
    starts: int = Field(default=1, ge=1, le=1000, description="from how many guesses the search begins")
    iterations: int = Field(default=500, ge=1, description="of one search, at most")
    seed: int = Field(default=0, ge=0, description="everything random follows from it")

    @model_validator(mode="before")
    @classmethod
    def _absent(cls, data: Any) -> Any:
        """Leave out what only phases give."""
        if not isinstance(data, dict):
            return data
        return {key: one for key, one in data.items() if one is not None or key not in ("duration", "costs")}

    @model_validator(mode="after")
    def _check(self, info: ValidationInfo) -> Planning:
        if self.most_intervals < self.intervals:
            raise ValueError(
                f"most_intervals: found {self.most_intervals}, allowed: at least {self.intervals}"
            )
        if self.phases:
            return self._check_phases()
        for key in ("duration", "goals", "costs"):
            if not getattr(self, key) and (key, info.context) != ("goals", PASSED):
                raise ValueError(f"{key}: missing")
        return self

    def _check_phases(self) -> Planning:
        """Each phase is judged and filled as a section of its own is."""
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
                    raise ValueError(f"phases.{name}.{key}: is the same in all phases; give it beside them")
            try:
                phases[name] = pick(self._laid_over(base, changes, context).model_dump(mode="json"), changes)
            except ValidationError as fault:
                where, message = explain(fault.errors(include_url=False)[0], overlay(base, changes))
                raise ValueError(f"phases.{name}.{where}: {message}") from None
        return self.model_copy(update={"phases": phases})

    def _base(self) -> dict[str, Any]:
        """Plain form of what phases are laid over."""
        return self.model_dump(mode="json", exclude={"phases"}, exclude_none=True)

    @staticmethod
    def _laid_over(base: dict[str, Any], changes: dict[str, Any], context: str | None = PASSED) -> Planning:
        """Section of a plain form with changes, without what is null."""
        document = overlay(base, changes)
        for key in ("keep_out", "cones", "sights"):
            document[key] = {name: one for name, one in document[key].items() if one is not None}
        return Planning.model_validate(document, context=context)

    @property
    def by_phase(self) -> dict[str, Planning]:
        """Sections of the phases by name, each without phases; this one, of no name, where there are none."""
        if not self.phases:
            return {"": self}
        base, found = self._base(), {}
        for name, changes in self.phases.items():
            found[name] = self._laid_over(base, changes)
            base["start"] = {}  # only the first one begins where the scenario does
        return found
