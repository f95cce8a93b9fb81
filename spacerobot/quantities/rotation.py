"""Rotations of the object and of the bases since the start."""

from __future__ import annotations

import casadi as ca
import numpy as np

from spacerobot.quantities.quantity import Components, Context, Quantity, sizes

SMALLEST = np.radians(1e-9)  # keeps the angle smooth where a body has not turned


def _angles(context: Context, *, target: bool) -> Components:
    """Angle by which bodies have turned since the start [deg]."""
    rotations = context.vectors("body_rotation")
    chosen = [i for i, body in enumerate(context.scene.bodies) if (body.path == "target") == target]
    angles = [180 / np.pi * size for size in sizes([rotations[i] for i in chosen], SMALLEST)]
    return Components(tuple(context.scene.bodies[i].name for i in chosen), ca.vertcat(ca.SX(0, 1), *angles))


def of_target(context: Context) -> Components:
    """Rotation of the object [deg]."""
    return _angles(context, target=True)


def of_bases(context: Context) -> Components:
    """Rotation of each robot's base [deg]."""
    return _angles(context, target=False)


QUANTITIES = (
    Quantity(
        "target_rotation_peak",
        "peak object rotation",
        "largest rotation of the object since the start",
        "deg",
        "peak",
        of_target,
        limit="target_rotation_deg",
        absent="this scene has no target",
        symbol="R",
    ),
    Quantity(
        "base_rotation_peak",
        "peak base rotation",
        "largest rotation of a base since the start",
        "deg",
        "peak",
        of_bases,
        limit="base_rotation_deg",
        absent="this scene has no robot",
        symbol="B",
    ),
)
