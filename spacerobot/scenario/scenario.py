"""Scenario: robots, target, grasps, environment, phases, simulation, and sections of jobs."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, ValidationError, model_validator

from spacerobot.common.errors import near_names
from spacerobot.common.section import MAX_SAMPLES, MAX_STEPS, Name, Section, Vector, quantity
from spacerobot.scenario.bodies import Base, Robot, Target
from spacerobot.scenario.campaign import Campaign
from spacerobot.scenario.element_fields import CollisionShape, Contact, Environment, Grasp
from spacerobot.scenario.merge import check_changes, expand_names, overlay, pick, without_disabled
from spacerobot.scenario.paths import Document
from spacerobot.scenario.phases import Phase, check_phases, check_planned
from spacerobot.scenario.plan import PlanSection
from spacerobot.scenario.recurrences import check_recurrences
from spacerobot.scenario.tuning import Tuning
from spacerobot.scenario.validation_errors import explain


class Simulation(Section):
    """Duration, step, output and engine of a simulation."""

    duration: float = quantity("s", "simulated time", default=10.0, gt=0, le=1e6)
    step: float | None = quantity(
        "s",
        "longest step of the fixed-step engine, shortened so that steps end on samples; chosen from "
        "`tolerance` if not given",
        default=None,
        gt=0,
        recurs=MAX_STEPS,
    )
    output_step: float = quantity(
        "s", "time between samples of the result", default=0.02, gt=0, recurs=MAX_SAMPLES
    )
    tolerance: float = quantity(
        "1", "maximum relative error of the state that a chosen step may cause", default=1e-7, gt=0, le=1e-2
    )
    method: Literal["tanaka6", "verner7", "dop853", "rk4"] = Field(
        default="tanaka6",
        description="explicit Runge-Kutta method of the casadi engine: of order 6 (Tanaka and others, stable "
        "at the longest steps), 7 (Verner), 8 (Dormand and Prince) or 4 (Kutta)",
    )
    engine: Literal["casadi", "pinocchio"] = Field(
        default="casadi",
        description="casadi: fixed steps over the closed loop's functions; pinocchio: slow and independent, "
        "for checks",
    )

    noise_draw: float = quantity(
        "1",
        "which draw of the sensors' noise, its whole part; -1: none, as filters assume it all the same; "
        "campaigns vary it",
        default=0.0,
        ge=-1,
        le=1e15,
    )
    noise_seed: float = quantity("1", "of all draws", default=0.0, ge=0, le=1e15)

    @model_validator(mode="after")
    def _check(self) -> Simulation:
        if self.step is not None and self.step > self.duration:
            raise ValueError(f"step: found {self.step:g}, allowed: at most the duration, {self.duration:g} s")
        return self


class Scenario(Section):
    """Complete description of a simulation and of the jobs that use it."""

    name: Name = Field(default="scenario", description="name of the scenario; that of its file if not given")
    description: str = Field(default="", description="what it shows, for people")
    gravity: Vector = quantity("m/s^2", "gravity; none in orbit", default=(0.0, 0.0, 0.0))
    environment: dict[Name, Environment] = Field(
        default={}, description="what acts from outside on everything that moves, by name"
    )
    robots: dict[Name, Robot] = Field(min_length=1, description="robots by name")
    target: Target | None = Field(default=None, description="the object that is held")
    grasps: dict[Name, Grasp] = Field(default={}, description="grasps by name")
    pads: dict[Name, CollisionShape] = Field(
        default={}, description="shapes for contact that no URDF has, by name"
    )
    contacts: dict[Name, Contact] = Field(default={}, description="what may touch, by name")
    phases: dict[Name, Phase] = Field(
        default={}, description="what differs from the scenario for a while, in turn; one phase if not given"
    )
    simulation: Simulation = Field(default=Simulation(), description="how long, how finely, by which engine")
    tuning: Tuning | None = Field(default=None, description="the tuning problem")
    campaign: Campaign | None = Field(default=None, description="uncertain numbers, and rollouts over them")
    plan: PlanSection | None = Field(default=None, description="the planning problem")

    def __repr__(self) -> str:
        """Name of the scenario and names of its robots and grasps, in one line."""
        robots, grasps = ", ".join(self.robots), ", ".join(self.grasps) or "none"
        return f"<Scenario {self.name}: robots {robots}; grasps {grasps}>"

    @model_validator(mode="after")
    def _check(self) -> Scenario:
        if "target" in self.robots:
            raise ValueError("robots.target: `target` is the held object's name; rename the robot")
        tips = [f"{robot}/{tip}" for robot, r in self.robots.items() for tip in r.tips]
        grasp_by_tip: dict[str, str] = {}
        for name, grasp in self.grasps.items():
            if self.target is None:
                raise ValueError(f"grasps.{name}: there is no target to hold")
            if grasp.tip not in tips:
                raise ValueError(f"grasps.{name}.tip: no tip {grasp.tip!r}; {near_names(grasp.tip, tips)}")
            if grasp.tip in grasp_by_tip:
                raise ValueError(
                    f"grasps.{name}.tip: {grasp.tip!r} already holds grasp {grasp_by_tip[grasp.tip]!r}"
                )
            grasp_by_tip[grasp.tip] = name
        bodies: list[tuple[str, Base]] = [
            (f"robots.{name}", robot.base) for name, robot in self.robots.items()
        ]
        if self.target is not None:
            bodies.append(("target", self.target.base))
        for path, base in bodies:
            if base.close_grasp is not None and base.close_grasp not in self.grasps:
                hint = near_names(base.close_grasp, self.grasps)
                raise ValueError(f"{path}.base.close_grasp: no grasp {base.close_grasp!r}; {hint}")
        return self

    @model_validator(mode="after")
    def _check_recurrences(self) -> Scenario:
        check_recurrences(self, self.simulation.duration)
        return self

    @model_validator(mode="after")
    def _check_fall(self) -> Scenario:
        falling = [f"environment.{name}" for name, kind in self.environment.items() if kind.falls]
        if len(falling) > 1:
            raise ValueError(f"{falling[1]}: the world's origin falls with {falling[0]}; give one of them")
        if falling and any(self.gravity):
            raise ValueError(
                f"gravity: the world's origin falls freely with {falling[0]}; give one of the two"
            )
        return self

    @model_validator(mode="after")
    def _check_phases(self) -> Scenario:
        """Validate each phase, merged with the scenario, and fill in its defaults."""
        if self.plan is not None:
            check_planned(list(self.plan.phases), self.phases)
        if not self.phases:
            return self
        bodies = [*self.robots, *(["target"] if self.target is not None else [])]
        check_phases(self.phases, self.grasps, bodies)
        base, phases = self._base(), {}
        for name, phase in self.phases.items():
            try:
                changes = expand_names(phase.changes, base)
                merged = self._laid_over(base, changes).model_dump(mode="json")
                changes = pick(merged, changes)
                check_changes(base, changes)
            except ValidationError as fault:
                where, message = explain(fault.errors(include_url=False)[0], overlay(base, changes))
                raise ValueError(f"phases.{name}.{where}: {message}") from None
            except ValueError as fault:
                raise ValueError(f"phases.{name}.{fault}") from None
            phases[name] = phase.model_copy(update=changes)
        return self.model_copy(update={"phases": phases})

    def _base(self) -> Document:
        """Plain document with which phases are merged."""
        return self.model_dump(mode="json", exclude={"phases", "tuning", "campaign", "plan"})

    def body_label(self, body: str) -> str:
        """Displayed name of a body in figures, pages and tables.

        Args:
            body: Name of a robot, or ``target``.

        Returns:
            str: Name of the robot. For ``target``, the name of its URDF file without suffixes, or ``object``
                if a robot has that name.
        """
        if body != "target" or self.target is None:
            return body
        name = self.target.urdf.replace("\\", "/").rpartition("/")[2].partition(".")[0]
        return "object" if not name or name in self.robots else name

    def during(self, phase: str) -> Scenario:
        """Scenario of a phase: the scenario with the phase's changes, without phases."""
        return self._laid_over(self._base(), self.phases[phase].changes)

    @staticmethod
    def _laid_over(base: Document, changes: Document) -> Scenario:
        """Scenario of a plain document with changes, without disabled controllers."""
        return Scenario.model_validate(without_disabled(overlay(base, changes)))
