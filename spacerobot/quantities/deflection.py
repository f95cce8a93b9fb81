"""Deflections, modal coordinates and vibration energy of flexible links."""

from __future__ import annotations

import casadi as ca

from spacerobot.quantities.quantity import Columns, Quantity, SignalSource, sizes

SMALLEST = 1e-12  # m; keeps the size smooth where it is zero


def of_ends(source: SignalSource) -> Columns:
    """Deflections of the ends of all beams [m]."""
    lengths = sizes(source.signal("deflection"), SMALLEST)
    return {"total": ca.vertcat(*lengths.values())} if lengths else {}


def of_modes(source: SignalSource) -> Columns:
    """Absolute values of all modal coordinates [kg^(1/2) m]."""
    coordinates = source.signal("modal_coordinate").values()
    return {"total": ca.fabs(ca.vertcat(*coordinates))} if coordinates else {}


QUANTITIES = (
    Quantity(
        name="deflection_peak",
        label="peak deflection",
        description="largest deflection of the end of a flexible link of kind beam",
        unit="m",
        reducer="peak",
        expression=of_ends,
        limit="deflection",
        absent="no flexible link of this scene is of kind beam",
        symbol="D",
    ),
    Quantity(
        name="modal_coordinate_peak",
        label="peak modal coordinate",
        description="largest mass-normalised coordinate of a mode of a flexible link",
        unit="kg^(1/2) m",
        reducer="peak",
        expression=of_modes,
        limit="modal_coordinate",
        absent="no flexible link of this scene is of kind modes",
        symbol="V",
    ),
    Quantity(
        name="vibration_energy",
        label="energy of vibrations",
        description="integral of the energy of flexible links: elastic, and kinetic of their motion "
        "in their joints; of "
        "modes sum (h'^2 + w^2 h^2) / 2, h being their mass-normalised coordinates",
        unit="J s",
        reducer="integral",
        expression="vibration_energy",
        cost="vibration",
        is_metric=False,
        is_default=False,
        absent="there are no flexible links",
    ),
)
