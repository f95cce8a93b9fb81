"""Types of a result's summary, for type checkers.

Optional keys are marked :data:`~typing.NotRequired`. Units are part of the keys or stated in the docstrings.
In a scene without joints, grasps, contacts or wheels, the numbers of these are zero and their names None.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, NotRequired, TypeAlias, TypedDict

Numbers: TypeAlias = Mapping[str, float]


class Status(TypedDict):
    """Status at the end of the simulation, and reasons not to trust its numbers."""

    state: str
    reached_s: float
    diverged_at_s: float | None
    cause: str | None
    trusted: bool
    open: list[str]
    deep: NotRequired[list[str]]
    advice: str | None


class ErrorStatistics(TypedDict):
    """Tip error along a world axis (``x``, ``y``, ``z``), or its ``norm``."""

    min_m: float
    max_m: float
    rms_m: float
    final_m: float


class BodyExcursion(TypedDict):
    """Maximum rotation and travel of a body since the start."""

    max_rotation_deg: float
    max_travel_m: float


class AttitudeError(TypedDict):
    """Attitude error of a base with attitude control."""

    max_deg: float
    final_deg: float


class LargestTorque(TypedDict):
    """Largest joint torque [N m], or force [N] of a prismatic joint; ``unit`` is its unit."""

    torque_n_m: float
    unit: str
    joint: str | None
    time_s: float | None


class LargestRate(TypedDict):
    """Largest joint rate [rad/s], or speed [m/s] of a prismatic joint; ``unit`` is its unit."""

    rate: float
    unit: str
    joint: str | None
    time_s: float | None


class LargestGrip(TypedDict):
    """Largest force of a grasp."""

    force_n: float
    grasp: str | None
    time_s: float | None


class LargestContact(TypedDict):
    """Largest force of a contact, of the samples; a short impact may peak between them."""

    force_n: float
    contact: str | None
    time_s: float | None


class FastestWheel(TypedDict):
    """Largest speed of a reaction wheel; ``least_margin`` is the smallest relative margin to a limit."""

    speed_rad_s: float
    wheel: str | None
    time_s: float | None
    least_margin: float | None


class LinearMomentum(TypedDict):
    """Linear momentum minus the impulse of external wrenches; the relative drift is that of the ledger."""

    initial_n_s: list[float]
    drift_n_s: float
    largest_partial_n_s: float
    relative_drift: float


class AngularMomentum(TypedDict):
    """Angular momentum about the world's origin minus the impulse of external wrenches."""

    initial_n_m_s: list[float]
    drift_n_m_s: float
    largest_partial_n_m_s: float
    relative_drift: float


class MomentumLedger(TypedDict):
    """Conservation of momentum; ``reason`` states why momentum is not conserved."""

    conserved: bool
    reason: NotRequired[str]
    linear: NotRequired[LinearMomentum]
    angular: NotRequired[AngularMomentum]


class EnergyLedger(TypedDict):
    """Energy balance."""

    actuator_work_j: float
    stored_change_j: float
    joint_loss_j: float
    grasp_loss_j: float
    constraint_work_j: float
    largest_residual_j: float
    largest_energy_j: float
    relative_residual: float


class Ledger(TypedDict):
    """Conservation ledger of momentum and energy."""

    momentum: MomentumLedger
    energy: EnergyLedger


class EngineSummary(TypedDict):
    """Engine of the simulation, with notes on its compiler and step as texts."""

    name: str
    backend: str
    step_s: float | None
    steps: int
    toolchain: NotRequired[str]
    interpreted_because: NotRequired[str]
    step_chosen: NotRequired[str]
    step_error: NotRequired[str]


class Timing(TypedDict):
    """Wall time [s]."""

    closed_loop: float
    compile_or_load: float
    rollout: float
    total: float


class MpcStatistics(TypedDict):
    """Numbers and solution times of the plans of model predictive control."""

    period_s: float
    delay_s: float
    plans: int
    missed: int
    unfinished: int
    iterations: int
    first_solve_s: float
    median_solve_s: float
    longest_solve_s: float
    in_time: int


class EventSummary(TypedDict):
    """Event of a simulation; the optional keys depend on its kind."""

    time_s: float
    kind: str
    who: str
    name: str
    relative_velocity_m_s: NotRequired[list[float]]
    relative_spin_rad_s: NotRequired[list[float]]
    impulses_n_s: NotRequired[Mapping[str, list[float]]]
    energy_lost_j: NotRequired[float]
    delay_s: NotRequired[float]
    momentum_change: NotRequired[float]


class ExceededLimit(TypedDict):
    """Violated limit of a joint, with numbers in ``unit``."""

    joint: str
    quantity: Literal["position", "rate", "torque"]
    unit: str
    limit: float
    from_s: float
    excess: float
    time_s: float


class Summary(TypedDict):
    """Summary of a result, as in ``summary.json``."""

    format: int
    name: str
    status: Status
    outcome: str | None
    missed: NotRequired[Mapping[str, Mapping[str, Any]]]
    events: list[EventSummary]
    tip_error: Mapping[str, Mapping[str, ErrorStatistics]]
    unled_tips: NotRequired[list[str]]
    target: BodyExcursion | None
    bases: Mapping[str, BodyExcursion]
    greatest_torque: LargestTorque
    greatest_grip: LargestGrip
    greatest_contact: NotRequired[LargestContact]
    attitude_error: NotRequired[Mapping[str, AttitudeError]]
    propellant_kg: NotRequired[Numbers]
    fastest_joint: LargestRate
    beyond_limits: NotRequired[list[ExceededLimit]]
    fastest_wheel: NotRequired[FastestWheel]
    ledger: Ledger
    engine: EngineSummary
    timing_s: Timing
    assumptions: list[str]
    warnings: list[str]
    urdf_sha256: Mapping[str, str]
    plugins: NotRequired[list[Mapping[str, str]]]
    versions: Mapping[str, str]
    mpc: NotRequired[MpcStatistics]
