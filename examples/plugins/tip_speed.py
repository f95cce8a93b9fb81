r"""The speed of a tip: a quantity, which plans and tuning weigh and campaigns keep, and a limit of plans.

spacerobot plan bounce --plugin tip_speed.py --set plan.duration=3 \
    --set 'plan.goals={up: {kind: posture, robot: arm, joints: {joint_1: {angle_deg: 80}}}}' \
    --set 'plan.costs={torque: 1, tip_speed: 1}' --set 'plan.limits.tip_speed={upper: 0.3, tip: arm/tip}'
"""

from collections.abc import Iterator
from typing import Literal

from pydantic import Field

import spacerobot as sr
from spacerobot.elements import BoundedRow, PlanInstant, PlanLimit, quantity, within

sr.register_quantity(
    sr.Quantity(
        name="tip_speed_rms",
        label="RMS tip speed",
        description="root mean square of the speed of a tip",
        unit="m/s",
        reducer="rms",
        expression="tip_velocity",
        total="norm",
        weight="tip_speed",
        cost="tip_speed",
        is_default=False,
    )
)


@sr.register
class TipSpeedLimit(PlanLimit):
    """Greatest speed of a tip."""

    kind: Literal["tip_speed"] = "tip_speed"
    upper: float = quantity("m/s", "greatest speed", gt=0)
    tip: str = Field(description="which tip, as robot/tip")

    def rows(self, instant: PlanInstant) -> Iterator[BoundedRow]:
        """One row."""
        yield within(f"speed of {self.tip}", "m/s", instant.tip(self.tip).velocity, self.upper)
