"""Tuning problem: design variables, objective, constraints, margins and budgets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from spacerobot.common.errors import near_names
from spacerobot.common.registry import TUNING_METHODS
from spacerobot.common.section import MAX_STEPS, Name, OneOf, Paths, Section, quantity
from spacerobot.quantities import Quantity, limited
from spacerobot.scenario.quantity_numbers import QuantityLimits, QuantityWeights


class DesignVariable(Section):
    """Free number of a tuning or design problem, at one or several paths of the scenario."""

    paths: Paths = Field(
        description="dotted paths that take its value, `*` for every name: 'robots.*.tips.tip.pid.kp'",
    )
    lower: float = Field(description="minimum value, in the unit of the paths")
    upper: float = Field(description="maximum value, in the unit of the paths")
    scale: Literal["linear", "log"] = Field(
        default="linear", description="log: equal ratios count as equal distances"
    )

    @model_validator(mode="after")
    def _check(self) -> DesignVariable:
        if not self.lower < self.upper:
            raise ValueError(f"lower must be below upper, found {self.lower:g} and {self.upper:g}")
        if self.scale == "log" and self.lower <= 0:
            raise ValueError(f"a log scale needs a lower bound above 0, found {self.lower:g}")
        return self


class Objective(QuantityWeights):
    """Objective to be minimised: a measure of the tip errors, weighted penalties, and weighted quantities."""

    kind: Literal["ise", "itae", "minimax", "eq45", "eq45_printed"] = Field(
        default="ise",
        description="of all tips together. ise: integral of the squared error [m^2 s]; itae: integral of "
        "time times distance [m s^2]; minimax: largest absolute error on any axis [m]; eq45: integral of the "
        "squared memory of Eq. 45, decaying as it was meant to [m^2 s^3]; eq45_printed: as printed",
    )
    weight: float = quantity("1", "factor of the tip errors' measure", default=1.0, ge=0)
    jitter_frequency: float = quantity("Hz", "corner frequency of the jitter's high pass", default=1.0, gt=0)


class Constraints(QuantityLimits):
    """Largest values of quantities; no limit where none is given."""

    @classmethod
    def quantities(cls) -> Mapping[str, Quantity]:
        """Quantities that can be bounded, by ``max_`` and the key of their limit."""
        return {f"max_{key}": each for key, each in limited().items()}


class MarginRequirement(Section):
    """Least stability margin of loops at an instant, or the weight of one loop's margin in the objective."""

    loops: str = Field(default="torque/*", description="break points, `*` for any letters")
    kind: Literal["disk", "gain_up", "gain_down", "phase", "delay"] = Field(
        default="disk",
        description="disk margin [1], growth and fall of the gain [dB], phase [deg], additional delay [s]",
    )
    at: float | str = quantity(
        "s", "time, or an event: the instants just before and just after it", default=0.0
    )
    least: float | None = quantity("unit of the kind", "minimum margin", default=None, gt=0)
    weight: float | None = quantity(
        "objective/unit of the kind",
        "the objective falls by this weight times the margin of one loop",
        default=None,
        gt=0,
    )

    @model_validator(mode="after")
    def _check(self) -> MarginRequirement:
        if self.least is None and self.weight is None:
            raise ValueError("found neither `least` nor `weight`, required: at least one of them")
        return self


class Robustness(Section):
    """Perturbed plants for verification: numbers drawn uniformly around the nominal ones."""

    plants: int = Field(default=64, ge=1, le=100_000, description="how many")
    seed: int = Field(default=1, ge=0, description="of the draw")
    object: float = quantity("1", "spread of the object's mass and of its inertia", default=0.2, ge=0, lt=1)
    links: float = quantity("1", "spread of each link's mass", default=0.1, ge=0, lt=1)
    grip: float = quantity("1", "spread of each compliant grasp's stiffness", default=0.3, ge=0, lt=1)
    tip_position_offset: float = quantity("m", "maximum sensor offset", default=2e-4, ge=0)
    joint_rate_offset: float = quantity("rad/s", "maximum sensor offset", default=1e-5, ge=0)


class Tuning(Section):
    """Tuning problem and its budget."""

    variables: dict[Name, DesignVariable] = Field(min_length=1, description="free numbers by name")
    sets: dict[Name, tuple[Name, ...]] = Field(
        default={}, description="choices of variables that are tuned and compared; all of them if not given"
    )
    changes: dict[str, Any] = Field(
        default={}, description="changes to the scenario while it is tuned, by dotted path"
    )
    variants: dict[Name, dict[str, Any]] = Field(
        default={}, description="further changes, by name: each variant is a tuning problem of its own"
    )
    objective: Objective = Field(default=Objective(), description="objective to be minimised")
    constraints: Constraints = Field(default=Constraints(), description="upper bounds of quantities")
    margins: tuple[MarginRequirement, ...] = Field(default=(), description="stability margins of loops")
    robustness: Robustness = Field(default=Robustness(), description="plants on which the outcome is tried")
    methods: tuple[Annotated[str, OneOf(TUNING_METHODS.names)], ...] = Field(
        default=(), description="methods to compare; all if none is given"
    )
    budget: int = Field(default=7500, ge=1, description="rollouts that one run of the GA may spend")
    baseline_budget: int = Field(
        default=2500, ge=1, description="rollouts that one run of another evolutionary method may spend"
    )
    population: int = Field(default=50, ge=4, description="of the evolutionary methods")
    runs: int = Field(default=6, ge=1, description="of each evolutionary method, each with a seed of its own")
    starts: int = Field(default=4, ge=1, description="of the NLP")
    iterations: int = Field(default=100, ge=1, description="of the NLP from one start, at most")
    seed: int = Field(default=0, ge=0, description="everything random follows from it")
    step: float = quantity("s", "step of the rollouts that tune", default=0.01, gt=0, recurs=MAX_STEPS)

    @model_validator(mode="after")
    def _check(self) -> Tuning:
        for name, chosen in self.sets.items():
            if not chosen:
                raise ValueError(f"sets.{name}: no variable; allowed: {', '.join(self.variables)}")
            for variable in chosen:
                if variable not in self.variables:
                    hint = near_names(variable, self.variables)
                    raise ValueError(f"sets.{name}: no variable {variable!r}; {hint}")
        return self
