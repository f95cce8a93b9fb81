"""Limits on registered quantities: one kind for each :class:`spacerobot.quantities.PlanBound`."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np
from pydantic import create_model

from spacerobot.common.section import quantity
from spacerobot.elements.goals.plan_instant import BoundedRow, PlanInstant, within
from spacerobot.elements.limits.plan_limit import JointQuantity, PlanLimit, PlannedJoint, WrenchPart
from spacerobot.quantities import PlanBound, Quantity, bounded

JOINT_SIGNALS: Mapping[Any, JointQuantity] = {"joint_rate": "rate", "joint_torque": "torque"}
WRENCH_SIGNALS: Mapping[Any, WrenchPart] = {"base_force": "force", "base_torque": "torque"}
"""Signals whose entries are unknowns of a plan: a limit on one bounds the unknowns, and adds no rows."""


class QuantityLimit(PlanLimit):
    """Limit on a registered quantity, at all times."""

    bound: ClassVar[PlanBound]
    limited: ClassVar[Quantity]

    upper: float

    @property
    def relative_to_start(self) -> bool:
        """Whether the quantity is measured from the start."""
        return self.limited.relative_to_start

    @property
    def limit(self) -> float:
        """The limit, in the unit of the quantity's columns: radians for degrees."""
        return float(np.radians(self.upper)) if self.bound.unit.startswith("deg") else self.upper

    def joint_limits(self, joint: PlannedJoint) -> Mapping[JointQuantity, float]:
        """Maximum rate or torque of the joints that it is for."""
        part = JOINT_SIGNALS.get(self.limited.expression)
        return {part: self.limit} if part and joint.kind in self.bound.joints else {}

    def base_limits(self) -> Mapping[WrenchPart, float]:
        """Maximum force or torque on a base."""
        part = WRENCH_SIGNALS.get(self.limited.expression)
        return {part: self.limit} if part else {}

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """Bounds on the norms of the quantity's vectors, or on its entries if it is not a norm."""
        limit, root, unit = self.limit, self.limited.is_root, self.limited.unit
        if self.limited.expression in JOINT_SIGNALS.keys() | WRENCH_SIGNALS.keys():
            return
        for label, column in self.limited.columns(instant).items():
            name = f"{self.bound.key.removesuffix('_deg').replace('_', ' ')} of {label}"
            if root and column.numel() > 1:  # as a square, which is smooth at zero
                rows = [within(name, unit, column, limit)]
            else:
                lower = -limit if root else -np.inf
                rows = [BoundedRow(name, unit, entry, lower, limit) for entry in ca.vertsplit(column)]
            for row in rows:
                yield dataclasses.replace(row, size=limit) if self.bound.is_relative else row


def new_kinds(registered: Mapping[str, type[Any]]) -> Iterator[type[QuantityLimit]]:
    """Kinds of the quantities' bounds that are not registered yet, or whose quantity is another one.

    Args:
        registered: Kinds of limits that are registered, by name.
    """
    for bound, limited in bounded().values():
        if getattr(registered.get(bound.key), "limited", None) is not limited:
            keys: dict[str, Any] = {
                "kind": (Literal[bound.key], bound.key),
                "upper": (float, quantity(bound.unit, bound.description, **bound.allowed)),
            }
            name = "".join(word.title() for word in bound.key.split("_")) + "Bound"
            text = f"{bound.description[:1].upper()}{bound.description[1:]}."
            kind = create_model(name, __base__=QuantityLimit, __module__=__name__, __doc__=text, **keys)
            kind.bound, kind.limited = bound, limited
            yield kind
