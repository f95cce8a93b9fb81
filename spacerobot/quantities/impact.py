"""Impacts at captures: impulses, and the energy that events dissipate."""

from __future__ import annotations

import casadi as ca

from spacerobot.quantities.capture import NO_CAPTURE, grasp_names, open_grasps
from spacerobot.quantities.quantity import NOTHING, Components, Context, Quantity, sizes

SMALLEST = 1e-12  # N s; keeps the size smooth where there is no impulse


def impulses(context: Context) -> Components:
    """Size of the sum of all impacts' impulses on the target in each rigid grasp that begins open [N s]."""
    chosen = [i for i in open_grasps(context) if context.scene.grasps[i].config.is_rigid]
    given = context.vectors("grasp_impulse") if chosen else []
    summed = sizes([given[i] for i in chosen], SMALLEST)
    return Components(grasp_names(context, chosen), ca.vertcat(ca.SX(0, 1), *summed))


def dissipated(context: Context) -> Components:
    """Energy that all events together dissipated [J]."""
    if "work_event" not in context.loop.outputs.name_out():
        return NOTHING
    return Components(("total",), context.signals["work_event"])


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
        dissipated,
        total="sum",
        weight="event_energy",
        weight_unit="objective/J",
        absent=NO_CAPTURE,
    ),
)
