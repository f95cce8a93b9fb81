"""Impacts at captures: impulses, and the energy that events dissipate."""

from __future__ import annotations

from spacerobot.quantities.capture import NO_CAPTURE, of_open_grasps
from spacerobot.quantities.quantity import Columns, Context, Quantity, sizes

SMALLEST = 1e-12  # N s; keeps the size smooth where there is no impulse


def impulses(context: Context) -> Columns:
    """Size of the sum of all impacts' impulses on the target in each rigid grasp that begins open [N s]."""
    rigid = {grasp.name for grasp in context.scene.grasps if grasp.config.is_rigid}
    given = of_open_grasps(context, "grasp_impulse")
    return sizes({label: impulse for label, impulse in given.items() if label in rigid}, SMALLEST)


QUANTITIES = (
    Quantity(
        "impulse",
        "impulse",
        "total impulse of impacts on the target",
        "N s",
        "final",
        impulses,
        total="sum",
        limit="impulse",
        absent="no grasp of this scene is captured with an impact",
        symbol="I",
    ),
    Quantity(
        "event_energy",
        "energy lost in events",
        "energy dissipated by impacts and released springs",
        "J",
        "final",
        "work_event",
        total="sum",
        weight="event_energy",
        absent=NO_CAPTURE,
    ),
    Quantity(
        "impact_speed",
        "impact speed",
        "speed [m/s] and spin [rad/s] with which tips reach their mating frames",
        "m/s",
        "final_length",
        "arrival",
        total="norm",
        cost="impact_speed",
        is_metric=False,
        is_default=False,
        absent="there are no tips that reach mating frames: give a goal with `frame`",
    ),
)
