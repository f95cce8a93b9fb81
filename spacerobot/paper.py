"""The paper, side by side: its variants, its figures and ours."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from spacerobot.result import Result
from spacerobot.scene import Scene, load_scene

AXES = (("rpr1/tip", "x"), ("rpr1/tip", "y"), ("rpr2/tip", "x"), ("rpr2/tip", "y"))
"""Columns of the paper's results."""

FIGURE_7_MM = ((-1.18, 1.1), (-1.19, 2.0), (-1.17, 1.5), (-2.0, 1.99))
"""Tip errors with PID and amnesia controller (Fig. 7), in the order of ``AXES``."""

FIGURE_10_MM = ((-1.1, 1.12), (-0.89, 1.10), (-1.19, 1.12), (-1.8, 1.02))
"""The same, tuned by the paper's genetic algorithm (Fig. 10)."""

HELD: dict[str, Any] = {
    "robots.*.controllers": {
        "attitude": {"kind": "base_attitude", "kp": 2000, "kd": 1300},
        "position": {"kind": "base_position", "kp": 2700, "kd": 1800},
    },
    "robots.*.actuators": {"ideal": {"kind": "base_wrench"}},
}
"""What holds both bases where they begin: about 3 rad/s, well damped, by ideal wrenches from outside."""

PID_ONLY_MM = 5.0
"""Trajectory error with PID alone (section 5); the paper does not say of which tip or axis."""


@dataclass(frozen=True)
class Variant:
    """One way to run the paper's scenario: velocity feedback, controllers, radius, and held bases or not."""

    feedback: str
    amnesia: bool
    radius_m: float
    held: bool = False

    @property
    def name(self) -> str:
        """Name of its result folder."""
        controller = "amnesia" if self.amnesia else "pid"
        return f"{self.feedback}-{controller}-R{self.radius_m:.2f}" + "-held" * self.held

    @property
    def changes(self) -> dict[str, Any]:
        """Changes to the shipped scenario, by dotted path."""
        changes: dict[str, Any] = {
            "robots.*.tips.tip.pid.feedback": self.feedback,
            "robots.*.tips.tip.reference.radius": self.radius_m,
        }
        changes |= HELD if self.held else {}
        return changes if self.amnesia else changes | {"robots.*.tips.tip.amnesia": None}

    def scene(self) -> Scene:
        """Its scene."""
        return load_scene("paper", self.changes)


VARIANTS = (
    *(
        Variant(feedback, amnesia, radius)
        for radius in (0.10, 0.15)
        for feedback in ("base", "inertial")
        for amnesia in (False, True)
    ),
    *(Variant("base", amnesia, 0.10, held=True) for amnesia in (False, True)),
)


def run_variants(simulate: Callable[[Scene], Result]) -> Iterator[tuple[Variant, Result]]:
    """Results of all variants, one after the other."""
    for variant in VARIANTS:
        yield variant, simulate(variant.scene())


def is_of_the_paper(result: Result) -> bool:
    """Whether a result is of the paper's robots, whose figures the paper prints."""
    tips = {tip for tip, _ in AXES}
    return result.scenario.name == "paper" and tips <= set(result.summary["tip_error"])


def error_bands_mm(summary: Mapping[str, Any]) -> list[tuple[float, float]]:
    """Least and greatest tip error [mm] in the order of ``AXES``."""
    errors = summary["tip_error"]
    return [(errors[tip][axis]["min_m"] * 1e3, errors[tip][axis]["max_m"] * 1e3) for tip, axis in AXES]


def note(variant: Variant, summary: Mapping[str, Any]) -> str:
    """How a variant stands to the paper, in a few words."""
    largest = max(abs(value) for band in error_bands_mm(summary) for value in band)
    if not variant.amnesia:
        times = largest / PID_ONLY_MM
        return f"largest {largest:.3g} mm: {times:.2g} times the paper's"
    bands = zip(error_bands_mm(summary), FIGURE_7_MM, strict=True)
    outside = [
        f"{tip} {axis}"
        for (tip, axis), (ours, paper) in zip(AXES, bands, strict=True)
        if ours[0] < paper[0] or ours[1] > paper[1]
    ]
    if not outside:
        return f"largest {largest:.2g} mm: inside Fig. 7 on every axis"
    return f"largest {largest:.3g} mm: wider than Fig. 7 on {', '.join(outside)}"
