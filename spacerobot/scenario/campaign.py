"""Monte Carlo campaign: uncertain parameters, sampling, metrics and limits."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from spacerobot.common.errors import near_names
from spacerobot.common.registry import SAMPLERS
from spacerobot.common.section import MAX_SAMPLES, MAX_STEPS, Name, OneOf, Paths, Section, quantity
from spacerobot.quantities import default_metrics, find_quantity, metrics
from spacerobot.samplers import Sampler
from spacerobot.scenario.quantity_numbers import QuantityLimits

Distribution = Literal["uniform", "normal", "lognormal", "truncated_normal"]
NEEDS: dict[str, tuple[str, ...]] = {
    "uniform": ("lower", "upper"),
    "normal": ("mean", "std"),
    "lognormal": ("median", "sigma"),
    "truncated_normal": ("mean", "std", "lower", "upper"),
}
"""Parameters of each distribution."""

MOST_SAMPLES = 1_000_000
EIGENVALUE = 1e-10  # minimum eigenvalue of a correlation matrix


class UncertainParameter(Section):
    """Uncertain number with its distribution, at one or several paths of the scenario."""

    paths: Paths = Field(
        description="dotted paths that take its value, `*` for every name: 'grasps.*.stiffness'"
    )
    kind: Distribution = Field(
        default="uniform",
        description="uniform: lower, upper; normal: mean, std; lognormal: median, sigma (of the natural "
        "logarithm); truncated_normal: mean, std of the normal distribution that is cut at lower, upper",
    )
    apply: Literal["value", "factor", "offset"] = Field(
        default="value",
        description="what is drawn: the number itself, a factor of the scenario's number, or what is added "
        "to it; each in the paths' unit",
    )
    lower: float | None = quantity("unit of the paths", "minimum value", default=None)
    upper: float | None = quantity("unit of the paths", "maximum value", default=None)
    mean: float | None = quantity("unit of the paths", "mean", default=None)
    std: float | None = quantity("unit of the paths", "standard deviation", default=None, gt=0)
    median: float | None = quantity("unit of the paths", "median", default=None, gt=0)
    sigma: float | None = quantity("1", "standard deviation of the logarithm", default=None, gt=0, le=5)
    levels: int | None = Field(default=None, ge=1, le=10_000, description="values of a grid")

    @model_validator(mode="before")
    @classmethod
    def _known_kind(cls, data: Any) -> Any:
        """Check that the distribution is known, before its parameters are looked up."""
        if isinstance(data, dict):
            _check_word(data.get("kind", "uniform"), "kind", NEEDS)
        return data

    @model_validator(mode="after")
    def _check(self) -> UncertainParameter:
        needed = NEEDS[self.kind]
        for name in ("lower", "upper", "mean", "std", "median", "sigma"):
            is_set = getattr(self, name) is not None
            if is_set != (name in needed):
                problem = f"{name} is {'given' if is_set else 'missing'}"
                raise ValueError(f"a {self.kind} distribution takes {', '.join(needed)}; {problem}")
        if self.lower is not None and self.upper is not None and not self.lower < self.upper:
            raise ValueError(f"lower must be below upper, found {self.lower:g} and {self.upper:g}")
        if self.kind == "truncated_normal":
            # probability of the normal distribution between the truncation limits
            a, b = ((limit - self.mean) / self.std for limit in (self.lower, self.upper))  # type: ignore[operator]
            probability = 0.5 * (math.erf(b / math.sqrt(2)) - math.erf(a / math.sqrt(2)))
            if probability < 1e-6:
                raise ValueError("lower and upper cut away all but a millionth of the normal distribution")
        return self


class Limits(QuantityLimits):
    """Values beyond which a rollout counts as failed, in addition to divergence."""


class Campaign(Section):
    """Monte Carlo campaign: simulations over uncertain parameters, with metrics and limits."""

    parameters: dict[Name, UncertainParameter] = Field(min_length=1, description="uncertain numbers by name")
    correlation: tuple[tuple[float, ...], ...] | None = Field(
        default=None,
        description="correlation matrix of the parameters' normal scores, in the order of `parameters` "
        "(Gaussian copula); independent if not given",
    )
    design: Annotated[str, OneOf(SAMPLERS.names)] = Field(
        default="sobol",
        description="how samples are drawn: "
        + "; ".join(f"{name}, {each.summary}" for name, each in SAMPLERS.entries().items()),
    )
    samples: int = Field(
        default=1024,
        ge=1,
        le=MOST_SAMPLES,
        description="how many; of `saltelli`: of the base sample, each worth parameters + 2 rollouts; a "
        "grid's number follows from its levels",
    )
    levels: int = Field(default=5, ge=1, le=10_000, description="values of each parameter of a grid")
    seed: int = Field(default=0, ge=0, description="of the draw")
    gains: dict[Name, dict[str, Any]] = Field(
        default={},
        description="sets of gains to compare on the same samples: changes to the scenario by dotted path; "
        "the scenario's own gains alone if not given",
    )
    metrics: tuple[str, ...] = Field(
        default_factory=default_metrics,
        min_length=1,
        description="which numbers are kept of each rollout; if not given, those that fit the scene without "
        "jitter, which takes states of its own, contact forces, grip torques and statistics of estimates",
    )
    jitter_frequency: float = quantity(
        "Hz", "corner frequency of the high pass whose output is the tips' jitter", default=1.0, gt=0
    )
    series: tuple[Name, ...] = Field(
        default=(),
        description="signals that are kept over time, by the names of the closed loop's outputs: tip_error, "
        "joint_torque, grasp_force, body_rotation, momentum_linear, ...; none if not given",
    )
    series_step: float | None = quantity(
        "s",
        "longest time between two values of a series; a hundredth of the duration if not given",
        default=None,
        gt=0,
        recurs=MAX_SAMPLES,
    )
    limits: Limits = Limits()
    require_captures: bool = Field(
        default=True,
        description="whether a sample fails that never captures one of the grasps which begin open",
    )
    percentiles: tuple[float, ...] = Field(
        default=(5.0, 50.0, 95.0, 99.0), min_length=1, description="percentiles that are reported"
    )
    confidence: float = quantity("1", "of every interval", default=0.95, gt=0, lt=1)
    step: float = quantity("s", "step of the rollouts", default=0.01, gt=0, recurs=MAX_STEPS)

    @model_validator(mode="before")
    @classmethod
    def _known_words(cls, data: Any) -> Any:
        """Check that design and metrics are known; messages have similar names."""
        if isinstance(data, dict):
            _check_word(data.get("design", "sobol"), "design", SAMPLERS.names())
            named = data.get("metrics", ())
            for word in named if isinstance(named, list | tuple) else ():
                _check_word(word, "metrics", metrics(), "; your own come with --plugin FILE")
        return data

    @model_validator(mode="after")
    def _check(self) -> Campaign:
        if not all(0 < value < 100 for value in self.percentiles):
            raise ValueError("percentiles: each must be between 0 and 100, the ends excluded")
        twice = [name for i, name in enumerate(self.series) if name in self.series[:i]]
        if twice:
            raise ValueError(f"series: {twice[0]} is given twice")
        if self.series_step is not None and not self.series:
            raise ValueError("series_step: there is no series; name signals in `series`")
        for name in self.limits.given:
            if name not in self.metrics:
                raise ValueError(f"limits.{find_quantity(name).limit}: {name} must be among the metrics")
        if self.correlation is not None:
            if not self.sampler.takes_correlation:
                raise ValueError(f"correlation: the design {self.design} takes parameters as independent")
            rows = self.correlation
            names = list(self.parameters)
            size = len(names)
            if len(rows) != size or any(len(row) != size for row in rows):
                raise ValueError(
                    f"correlation: {size} rows of {size} numbers, one for each of {', '.join(names)}"
                )
            matrix = np.array(rows)
            for i in range(size):
                if matrix[i, i] != 1:
                    raise ValueError(f"correlation: {names[i]} with itself is 1, found {matrix[i, i]:g}")
                for j in range(i):
                    if matrix[i, j] != matrix[j, i] or abs(matrix[i, j]) >= 1:
                        raise ValueError(
                            f"correlation: {names[i]} with {names[j]} is one number between -1 and 1, "
                            f"found {matrix[i, j]:g} and {matrix[j, i]:g}"
                        )
            if np.linalg.eigvalsh(matrix)[0] < EIGENVALUE:
                raise ValueError("correlation: not positive definite, so no joint distribution has it")
        self.sampler.check(self)
        if self.count > MOST_SAMPLES:
            raise ValueError(f"{self.count} samples, allowed: at most {MOST_SAMPLES}")
        return self

    @property
    def count(self) -> int:
        """Number of all samples."""
        return self.sampler.count(self)

    @property
    def sampler(self) -> Sampler:
        """Sampler named by ``design``."""
        kind: Sampler = SAMPLERS.find(self.design)
        return kind


def _check_word(word: Any, key: str, allowed: Iterable[str], hint: str = "") -> None:
    if isinstance(word, str) and word not in allowed:
        raise ValueError(f"{key}: no {word!r}; {near_names(word, allowed)}{hint}")
