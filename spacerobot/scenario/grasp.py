"""Grasps: what holds a tip and a mating frame of the target together."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from spacerobot.scenario.section import Section, quantity


class _Grasp(Section):
    tip: str = Field(pattern=r"^[^/]+/[^/]+$", description="the tip, as robot/tip")
    frame: str = Field(min_length=1, description="mating frame: a link of the target's URDF")
    max_gap: float = quantity(
        "m", "greatest distance of tip and mating frame at the start", default=0.01, ge=0
    )


class Compliant(_Grasp):
    """Spring and damper between tip and mating frame; one pair of opposite wrenches at the tip's point."""

    kind: Literal["compliant"] = "compliant"
    stiffness: float = quantity("N/m", "translational stiffness K_g", default=100.0, ge=0)
    damping: float = quantity("N s/m", "translational damping R_g", default=10.0, ge=0)
    rotational_stiffness: float | None = quantity(
        "N m/rad", "rotational stiffness; none if not given", default=None, ge=0
    )
    rotational_damping: float | None = quantity(
        "N m s/rad", "rotational damping; none if not given", default=None, ge=0
    )


class _Rigid(_Grasp):
    max_gap: float = quantity(
        "m",
        "greatest distance of tip and mating frame at the start, where no base moves to close it",
        default=1e-6,
        ge=0,
    )
    stabilisation: float = quantity(
        "1/s", "rate at which drift of the constraint decays (critically damped)", default=20.0, ge=0
    )


class Point(_Rigid):
    """Rigid point contact: the tip stays at the mating frame and may turn about it."""

    kind: Literal["point"] = "point"


class Weld(_Rigid):
    """Rigid grip: the tip keeps its initial pose in the mating frame."""

    kind: Literal["weld"] = "weld"


Grasp = Annotated[Compliant | Point | Weld, Field(discriminator="kind")]
