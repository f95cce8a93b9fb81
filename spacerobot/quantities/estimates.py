"""Estimation errors of filters, and their consistency with the filters' covariances."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from spacerobot.quantities.quantity import Columns, Quantity, SignalSource, sizes

SMALLEST = 1e-15  # rad, m; keeps sizes smooth where they are zero
NO_ATTITUDE = "no robot of this scene has an estimator of kind attitude_filter"
NO_HELD = "no robot of this scene has an estimator of kind inertia_filter"
NO_TARGET = "no robot of this scene has an estimator of kind target_filter"


def length(output: str, factor: float = 1.0) -> Callable[[SignalSource], Columns]:
    """Function for the norm of an output of each robot that has it, times a factor."""
    return lambda source: sizes(source.signal(output), SMALLEST, factor)


def _final(
    name: str,
    texts: tuple[str, str],
    unit: str,
    samples: str | Callable[[SignalSource], Columns],
    absent: str,
    **further: Any,
) -> Quantity:
    """Quantity whose final value is a metric only if a campaign names it."""
    label, description = texts
    return Quantity(
        name=name,
        label=label,
        description=description,
        unit=unit,
        reducer="final",
        expression=samples,
        is_default=False,
        absent=absent,
        **further,
    )


QUANTITIES = (
    _final(
        "attitude_estimate_error",
        ("attitude estimate error", "angle from the estimated to the true attitude of a base at the end"),
        "deg",
        length("attitude_estimate_error", 180 / np.pi),
        NO_ATTITUDE,
    ),
    _final(
        "attitude_nees",
        ("NEES of the attitude filter", "normalised error squared of attitude and gyro bias at the end"),
        "1",
        "attitude_nees",
        NO_ATTITUDE,
    ),
    _final(
        "attitude_nis",
        ("NIS of the attitude filter", "normalised innovation squared of the last star tracker sample"),
        "1",
        "attitude_nis",
        NO_ATTITUDE,
    ),
    _final(
        "attitude_nis_dof",
        (
            "degrees of freedom of attitude_nis",
            "components of the innovation of the last star tracker sample that the attitude filter used",
        ),
        "1",
        "attitude_nis_dof",
        NO_ATTITUDE,
    ),
    _final(
        "target_estimate_error",
        ("target estimate error", "distance from the estimated to the true centre of mass at the end"),
        "m",
        length("target_position_error"),
        NO_TARGET,
    ),
    _final(
        "target_nees",
        ("NEES of the target filter", "normalised error squared of all that it estimates at the end"),
        "1",
        "target_nees",
        NO_TARGET,
    ),
    _final(
        "target_nis",
        ("NIS of the target filter", "normalised innovation squared of the last pose"),
        "1",
        "target_nis",
        NO_TARGET,
    ),
    _final(
        "target_nis_dof",
        (
            "degrees of freedom of target_nis",
            "components of the innovation of the last pose that the target filter used",
        ),
        "1",
        "target_nis_dof",
        NO_TARGET,
    ),
    _final(
        "held_deviation",
        (
            "deviation of the held object",
            "greatest relative standard deviation of its mass properties, in any direction, at the end",
        ),
        "1",
        "held_deviation",
        NO_HELD,
        weight="held_deviation",
    ),
    _final(
        "held_mass_error",
        ("mass error of the held object", "estimated less true mass at the end, without sign"),
        "kg",
        length("held_mass_error"),
        NO_HELD,
    ),
    _final(
        "held_com_error",
        (
            "centre error of the held object",
            "distance from the estimated to the true centre of mass at the end",
        ),
        "m",
        length("held_com_error"),
        NO_HELD,
    ),
    _final(
        "held_nees",
        ("NEES of the inertia filter", "normalised error squared of all that it estimates at the end"),
        "1",
        "held_nees",
        NO_HELD,
    ),
)
