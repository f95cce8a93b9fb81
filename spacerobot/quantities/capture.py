"""Captures of grasps that begin open: times, distances, touchdown speeds and lateral misses."""

from __future__ import annotations

import casadi as ca

from spacerobot.quantities.quantity import Columns, Context, Quantity, sizes

SMALLEST = 1e-9  # m; keeps the distance smooth where it is zero
NO_CAPTURE = "no grasp of this scene begins open"


def of_open_grasps(context: Context, signal: str) -> Columns:
    """Columns of a signal for the grasps that begin open."""
    begins_open = {grasp.name for grasp in context.scene.grasps if grasp.config.begins == "open"}
    return {label: column for label, column in context.signal(signal).items() if label in begins_open}


def captures(context: Context) -> Columns:
    """Time of the last capture of each grasp [s]; negative if it was missed."""
    return of_open_grasps(context, "grasp_captured_at")


def times(context: Context) -> Columns:
    """Time of the last capture of each grasp [s]; the simulation's duration if it was missed."""
    duration = context.scene.scenario.simulation.duration
    return {label: ca.if_else(time < 0, duration, time) for label, time in captures(context).items()}


def distances(context: Context) -> Columns:
    """Distance of tip and mating frame of each grasp [m]."""
    return sizes(of_open_grasps(context, "grasp_gap"), SMALLEST)


def touchdown_speeds(context: Context) -> Columns:
    """Speed of the tip relative to the target at the capture of each grasp [m/s]; zero if it was missed."""
    return sizes(of_open_grasps(context, "grasp_capture_velocity"), SMALLEST)


def lateral_misses(context: Context) -> Columns:
    """Distance of tip and mating frame's axis at each capture [m]; the whole gap if it was missed."""
    signals = ("grasp_captured_at", "grasp_gap", "grasp_capture_gap")
    times, gaps, at_capture = (of_open_grasps(context, signal) for signal in signals)
    grasps, misses = {grasp.name: grasp for grasp in context.scene.grasps}, dict[str, ca.SX]()
    for label, gap in at_capture.items():
        capture = grasps[label].config.capture
        assert capture is not None, "scenes are refused whose open grasps have none"
        axis = ca.DM(capture.axis) / ca.norm_2(ca.DM(capture.axis))
        misses[label] = ca.if_else(times[label] < 0, gaps[label], gap - axis * ca.dot(axis, gap))
    return sizes(misses, SMALLEST)


QUANTITIES = (
    Quantity(
        name="capture_time",
        label="capture time",
        description="time of the last capture of a grasp that begins open; if it was missed, "
        "missing in tables and the "
        "simulation's duration in objectives",
        unit="s",
        reducer="final",
        expression=times,
        limit="capture_time",
        weight="capture_time",
        absent=NO_CAPTURE,
        symbol="C",
        exists=captures,
    ),
    Quantity(
        name="miss_distance",
        label="miss distance",
        description="minimum distance of a tip from its capture point while its grasp is open; if it "
        "is captured, the distance at the capture, within the envelope",
        unit="m",
        reducer="lowest",
        expression=distances,
        absent=NO_CAPTURE,
    ),
    Quantity(
        name="touchdown_speed",
        label="touchdown speed",
        description="speed of a tip relative to the target at the capture; if it was missed, "
        "missing in tables and zero "
        "in objectives",
        unit="m/s",
        reducer="final",
        expression=touchdown_speeds,
        weight="touchdown_speed",
        is_default=False,
        absent=NO_CAPTURE,
        exists=captures,
    ),
    Quantity(
        name="lateral_miss",
        label="lateral miss",
        description="distance of a tip from the axis of its mating frame at the capture; if it was "
        "missed, the whole "
        "distance at the end",
        unit="m",
        reducer="final",
        expression=lateral_misses,
        weight="lateral_miss",
        is_default=False,
        absent=NO_CAPTURE,
    ),
)
