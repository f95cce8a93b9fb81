"""What is measured of bases that act: attitude errors, momentum of wheels, propellant, jitter of tips.

They are read of the outputs that elements declare. A body whose elements declare none has no part in them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import casadi as ca
import numpy as np

from optim.problem.docking import Measured
from optim.problem.tied import extend
from spacerobot.rollout import ClosedLoopFunctions, Measure, Signals, final, integral, peak
from spacerobot.scene import Scene

SMALLEST = 1e-12  # rad and N m s; keeps sizes smooth where they are zero
JITTER = "jitter."


def attitude_squares(loop: ClosedLoopFunctions, signals: Signals, scene: Scene) -> Measured:
    """Integral of the squared attitude error of each base that is held [rad^2 s]."""
    return _of_bodies(loop, signals, scene, "base_attitude_error", "rad^2 s", lambda e: integral(_squares(e)))


def attitude_peaks(loop: ClosedLoopFunctions, signals: Signals, scene: Scene) -> Measured:
    """Largest attitude error of each base that is held [deg]."""
    degree = 180 / np.pi
    return _of_bodies(loop, signals, scene, "base_attitude_error", "deg", lambda e: peak(degree * _sizes(e)))


def wheel_squares(loop: ClosedLoopFunctions, signals: Signals, scene: Scene) -> Measured:
    """Integral of the squared momentum of each base's wheels together [N^2 m^2 s^3]."""
    return _of_bodies(loop, signals, scene, "wheel_momentum", "N^2 m^2 s^3", lambda h: integral(_squares(h)))


def wheel_peaks(loop: ClosedLoopFunctions, signals: Signals, scene: Scene) -> Measured:
    """Largest momentum of each base's wheels together [N m s]."""
    return _of_bodies(loop, signals, scene, "wheel_momentum", "N m s", lambda h: peak(_sizes(h)))


def propellants(loop: ClosedLoopFunctions, signals: Signals, scene: Scene) -> Measured:
    """Propellant that each robot's thrusters spent [kg]."""
    return _of_bodies(loop, signals, scene, "propellant", "kg", lambda spent: final(ca.vertcat(*spent)))


def jitters(loop: ClosedLoopFunctions, signals: Signals, scene: Scene) -> Measured:
    """Integral of the squared jitter of each tip [m^2 s]: of the error less what is slow of it."""
    places = [i for i, name in enumerate(loop.state_names) if name.startswith(JITTER)]
    if not places:
        return Measured((), "m^2 s", integral(ca.SX(0, 1)))
    fast = signals["tip_error"] - signals.x[places]
    squares = [ca.sumsqr(fast[3 * i : 3 * i + 3]) for i in range(len(scene.tips))]
    return Measured(tuple(tip.label for tip in scene.tips), "m^2 s", integral(ca.vertcat(*squares)))


def with_jitter(loop: ClosedLoopFunctions, scene: Scene, frequency_hz: float) -> ClosedLoopFunctions:
    """The closed loop with what is slow of the tips' errors: low passes of first order, which begin at zero.

    Jitter is the error less these: a high pass with the corner frequency [Hz].
    """

    def rates(signals: Signals, slow: ca.SX) -> ca.SX:
        return 2 * np.pi * frequency_hz * (signals["tip_error"] - slow)

    return extend(loop, [f"{JITTER}{tip.label}[{axis}]" for tip in scene.tips for axis in "xyz"], rates)


def _of_bodies(
    loop: ClosedLoopFunctions,
    signals: Signals,
    scene: Scene,
    output: str,
    unit: str,
    measure: Callable[[list[ca.SX]], Measure],
) -> Measured:
    """Measure of an output of bodies, over those that declare it."""
    chosen = list(_declaring(loop, output, len(scene.bodies)))
    size = signals[output].numel() // len(scene.bodies) if chosen else 0
    parts = [signals[output][size * i : size * (i + 1)] for i in chosen]
    return Measured(tuple(scene.bodies[i].name for i in chosen), unit, measure(parts))


def _declaring(loop: ClosedLoopFunctions, output: str, bodies: int) -> Iterator[int]:
    """Bodies for which an output is no constant that is not a number."""
    names = loop.outputs.name_out()
    if output not in names:
        return
    given = [ca.SX.sym(name, loop.outputs.sparsity_in(name)) for name in loop.outputs.name_in()]
    value = loop.outputs.call(given)[names.index(output)]
    size = value.numel() // bodies
    for i in range(bodies):
        first = value[size * i]
        if not (first.is_constant() and np.isnan(float(first))):
            yield i


def _squares(parts: list[ca.SX]) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *(ca.sumsqr(part) for part in parts))


def _sizes(parts: list[ca.SX]) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *(ca.sqrt(ca.sumsqr(part) + SMALLEST**2) for part in parts))
