"""Captures: when grasps that begin open closed, and by how much they missed."""

from __future__ import annotations

import casadi as ca

from spacerobot.quantities.quantity import Components, Context, Quantity, sizes

SMALLEST = 1e-9  # m; keeps the distance smooth where it is zero
NO_CAPTURE = "no grasp of this scene begins open"


def open_grasps(context: Context) -> list[int]:
    """Places of the grasps that begin open."""
    return [i for i, grasp in enumerate(context.scene.grasps) if grasp.config.begins == "open"]


def grasp_names(context: Context, chosen: list[int]) -> tuple[str, ...]:
    """Names of grasps by their places."""
    return tuple(context.scene.grasps[i].name for i in chosen)


def times(context: Context) -> Components:
    """Time of the last capture of each grasp [s]; the simulation's duration if it was missed."""
    chosen, duration = open_grasps(context), context.scene.scenario.simulation.duration
    captured = [context.signals["grasp_captured_at"][i] for i in chosen]
    late = [ca.if_else(time < 0, duration, time) for time in captured]
    return Components(grasp_names(context, chosen), ca.vertcat(ca.SX(0, 1), *late))


def distances(context: Context) -> Components:
    """Distance of tip and mating frame of each grasp [m]."""
    chosen, gaps = open_grasps(context), context.vectors("grasp_gap")
    away = sizes([gaps[i] for i in chosen], SMALLEST)
    return Components(grasp_names(context, chosen), ca.vertcat(ca.SX(0, 1), *away))


def touchdown_speeds(context: Context) -> Components:
    """Speed of the tip relative to the target at the capture of each grasp [m/s]; zero if it was missed."""
    chosen = open_grasps(context)
    velocities = context.vectors("grasp_capture_velocity") if chosen else []
    speeds = sizes([velocities[i] for i in chosen], SMALLEST)
    return Components(grasp_names(context, chosen), ca.vertcat(ca.SX(0, 1), *speeds))


def lateral_misses(context: Context) -> Components:
    """Distance of the tip from the mating frame's axis at the capture of each grasp [m]."""
    chosen, misses = open_grasps(context), list[ca.SX]()
    for i in chosen:
        capture = context.scene.grasps[i].config.capture
        assert capture is not None, "scenes are refused whose open grasps have none"
        axis = ca.DM(capture.axis) / ca.norm_2(ca.DM(capture.axis))
        gap = context.vectors("grasp_capture_gap")[i]
        missed = context.signals["grasp_captured_at"][i] < 0
        misses.append(ca.if_else(missed, context.vectors("grasp_gap")[i], gap - axis * ca.dot(axis, gap)))
    found = sizes(misses, SMALLEST)
    return Components(grasp_names(context, chosen), ca.vertcat(ca.SX(0, 1), *found))


QUANTITIES = (
    Quantity(
        "capture_time",
        "capture time",
        "time of the last capture of a grasp that begins open; the simulation's duration if it was missed",
        "s",
        "final",
        times,
        limit="capture_time",
        weight="capture_time",
        weight_unit="objective/s",
        absent=NO_CAPTURE,
        symbol="C",
    ),
    Quantity(
        "miss_distance",
        "miss distance",
        "minimum distance of a tip from its capture point",
        "m",
        "lowest",
        distances,
        absent=NO_CAPTURE,
    ),
    Quantity(
        "touchdown_speed",
        "touchdown speed",
        "speed of a tip relative to the target at the capture; zero if it was missed",
        "m/s",
        "final",
        touchdown_speeds,
        weight="touchdown_speed",
        weight_unit="objective s/m",
        is_default=False,
        absent=NO_CAPTURE,
    ),
    Quantity(
        "lateral_miss",
        "lateral miss",
        "distance of a tip from the axis of its mating frame at the capture; if it was missed, the whole "
        "distance at the end",
        "m",
        "final",
        lateral_misses,
        weight="lateral_miss",
        weight_unit="objective/m",
        is_default=False,
        absent=NO_CAPTURE,
    ),
)
