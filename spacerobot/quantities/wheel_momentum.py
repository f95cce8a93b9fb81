"""Angular momentum stored in reaction wheels."""

from __future__ import annotations

from spacerobot.quantities.quantity import Columns, PlanBound, Quantity, SignalSource, sizes

SMALLEST = 1e-12  # N m s; keeps the size smooth where it is zero
NO_WHEELS = "no robot of this scene has wheels, an actuator of kind reaction_wheels"


def stored(source: SignalSource) -> Columns:
    """Magnitude of the total momentum of the wheels of each base [N m s]."""
    return sizes(source.signal("wheel_momentum"), SMALLEST)


QUANTITIES = (
    Quantity(
        name="wheel_momentum_peak",
        label="peak wheel momentum",
        description="largest angular momentum of all wheels of a base together",
        unit="N m s",
        reducer="peak",
        expression=stored,
        limit="wheel_momentum",
        absent=NO_WHEELS,
        symbol="W",
    ),
    Quantity(
        name="wheel_momentum_rms",
        label="RMS wheel momentum",
        description="root mean square of the momentum of all wheels of a base together",
        unit="N m s",
        reducer="rms",
        expression="wheel_momentum",
        total="norm",
        weight="wheel_momentum",
        is_default=False,
        absent=NO_WHEELS,
    ),
    Quantity(
        name="single_wheel_momentum_rms",
        label="RMS momentum of single wheels",
        description="root mean square of the angular momentum of a wheel about its axis, where "
        "wheels alone turn a base",
        unit="N m s",
        reducer="rms",
        expression="single_wheel_momentum",
        total="norm",
        cost="wheel_momentum",
        bounds=(
            PlanBound(
                "wheel_momentum",
                "N m s",
                "maximum angular momentum of any wheel about its axis, where wheels alone turn a base",
                is_relative=True,
            ),
        ),
        is_metric=False,
        is_default=False,
        absent=NO_WHEELS,
    ),
)
