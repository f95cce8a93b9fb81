"""Forces and torques of grasps, and forces of contacts."""

from __future__ import annotations

from spacerobot.quantities.quantity import Columns, PlanBound, Quantity, SignalSource, sizes

SMALLEST = 1e-6  # N or N m; keeps the size smooth where there is no force
NO_GRASP = "this scene has no grasp that holds"


def forces(source: SignalSource) -> Columns:
    """Magnitude of the force in each grasp [N]."""
    return sizes(source.signal("grasp_force"), SMALLEST)


def torques(source: SignalSource) -> Columns:
    """Magnitude of the torque in each grasp about its tip [N m]; exactly zero without torque."""
    lengths = sizes(source.signal("grasp_torque"), SMALLEST)
    return {label: size - SMALLEST for label, size in lengths.items()}


def contact_forces(source: SignalSource) -> Columns:
    """Magnitude of the force of each contact [N]; exactly zero without contact."""
    lengths = sizes(source.signal("contact_force"), SMALLEST)
    return {label: size - SMALLEST for label, size in lengths.items()}


QUANTITIES = (
    Quantity(
        name="grip_force_peak",
        label="peak grip force",
        description="largest force in a grasp",
        unit="N",
        reducer="peak",
        expression=forces,
        limit="grip_force",
        absent=NO_GRASP,
        symbol="G",
    ),
    Quantity(
        name="grip_torque_peak",
        label="peak grip torque",
        description="largest torque in a grasp",
        unit="N m",
        reducer="peak",
        expression=torques,
        limit="grip_torque",
        is_default=False,
        absent=NO_GRASP,
        symbol="M",
    ),
    Quantity(
        name="contact_force_peak",
        label="peak contact force",
        description="largest force of a contact",
        unit="N",
        reducer="peak",
        expression=contact_forces,
        limit="contact_force",
        is_default=False,
        absent="this scene has no contact",
        symbol="F",
    ),
    Quantity(
        name="grip_force_rms",
        label="RMS grip force",
        description="root mean square of the force in a grasp",
        unit="N",
        reducer="rms",
        expression="grasp_force",
        total="norm",
        weight="grip_force",
        cost="grip_force",
        bounds=(PlanBound("grip_force", "N", "maximum force of any grasp that holds", is_relative=True),),
        is_default=False,
        absent=NO_GRASP,
    ),
    Quantity(
        name="grip_torque_rms",
        label="RMS grip torque",
        description="root mean square of the torque in a grasp",
        unit="N m",
        reducer="rms",
        expression="grasp_torque",
        total="norm",
        weight="grip_torque",
        cost="grip_torque",
        bounds=(PlanBound("grip_torque", "N m", "maximum torque of any grasp that holds", is_relative=True),),
        is_default=False,
        absent=NO_GRASP,
    ),
)
