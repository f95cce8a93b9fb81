"""Impulses and speeds of impacts at captures, and the energy that events dissipate."""

from __future__ import annotations

from spacerobot.quantities.capture import NO_CAPTURE, of_open_grasps
from spacerobot.quantities.quantity import Columns, Context, Quantity, sizes

SMALLEST = 1e-12  # N s; keeps the size smooth where there is no impulse


def impulses(context: Context) -> Columns:
    """Magnitude of the total impulse on the target in each rigid grasp that begins open [N s]."""
    rigid = {grasp.name for grasp in context.scene.grasps if grasp.config.is_rigid}
    impulse_by_grasp = of_open_grasps(context, "grasp_impulse")
    return sizes({label: impulse for label, impulse in impulse_by_grasp.items() if label in rigid}, SMALLEST)


QUANTITIES = (
    Quantity(
        name="impulse",
        label="impulse",
        description="total impulse of impacts on the target",
        unit="N s",
        reducer="final",
        expression=impulses,
        total="sum",
        limit="impulse",
        absent="no grasp of this scene is captured with an impact",
        symbol="I",
    ),
    Quantity(
        name="event_energy",
        label="energy lost in events",
        description="energy dissipated by impacts and released springs",
        unit="J",
        reducer="final",
        expression="work_event",
        total="sum",
        weight="event_energy",
        absent=NO_CAPTURE,
    ),
    Quantity(
        name="impact_speed",
        label="impact speed",
        description="speed [m/s] and spin [rad/s] with which tips reach their mating frames",
        unit="m/s",
        reducer="final_length",
        expression="arrival",
        total="norm",
        cost="impact_speed",
        is_metric=False,
        is_default=False,
        absent="there are no tips that reach mating frames: give a goal with `frame`",
    ),
)
