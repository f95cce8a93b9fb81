r"""Margins of a closed loop as functions of parameters, with exact derivatives.

A disk margin is the minimum of a function of frequency; its derivative is that of the function at the
minimising frequency (envelope theorem). At a crossing, the frequency moves with the parameters so that the
crossing condition f = |L| - 1 or f = Im L stays zero: ``d omega = -d f / (df / d omega)`` (implicit function
theorem). For a discrete loop the angle ``omega T`` replaces the frequency.

The state at an instant is constant while parameters change, except at the start of the simulation, where the
initial state depends on them. Controllers' memories and poses are thus those of the nominal motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.linear.complex_step import STEP, derivative, evaluate
from spacerobot.linear.instants import Instant, InstantNames, as_instants, instants
from spacerobot.linear.linearisation import Lineariser, LinearSystem
from spacerobot.linear.loop_margins import LoopMargins, is_destabilised, loop_margins
from spacerobot.scene import Scene
from spacerobot.simulation import Backend, Progress

MARGINS = {"disk": "1", "gain_up": "dB", "gain_down": "dB", "phase": "deg", "delay": "s"}
"""Margins that have derivatives, and their units."""


@dataclass(frozen=True)
class MarginValue:
    """Value of a loop's margin, negative if the closed loop is unstable, and its derivatives.

    Attributes:
        loop: Break point.
        value: Margin; for ``gain_down`` its negative, so that larger is better. If the closed loop is
            unstable, the loop with the smallest disk margin has the negative of its margin: every margin is
            zero at the onset of instability.
        gradient: Derivatives with respect to the variables (k,); zero if the margin is infinite.
    """

    loop: str
    value: float
    gradient: Array


@dataclass(frozen=True)
class ParametricLinearisation:
    """Linearised closed loops of a scene at instants, as functions of variables.

    Attributes:
        lineariser: Closed loop and its derivatives.
        instants: States of the nominal simulation.
        places: Indices of the closed loop's parameters that each variable sets.
        prepared: Function (p, t, x, switches) -> (x0, c): initial state, and constants at the instant.
        motion: Derivatives (nx + 1, k) of each instant's state and time with respect to the variables; empty
            if states are constant.
    """

    lineariser: Lineariser
    instants: tuple[Instant, ...]
    places: tuple[tuple[int, ...], ...]
    prepared: ca.Function
    motion: tuple[Array, ...] = ()

    @classmethod
    def of(
        cls,
        scene: Scene,
        at: InstantNames,
        variables: Sequence[Sequence[str]],
        backend: Backend = "auto",
        progress: Progress | None = None,
        loops: str | None = None,
    ) -> ParametricLinearisation:
        """Simulate a scene up to instants, and prepare its linearisation there.

        Args:
            scene, at, backend, progress: As for :func:`spacerobot.linearise`.
            variables: Dotted paths that each variable sets.
            loops: Pattern of break points that will be evaluated; checked before the simulation if given.

        Raises:
            DivergedError, ScenarioError: As :func:`spacerobot.linearise`; if the closed loop does not depend
                on a path.
            SpaceRobotError: If no break point matches.
        """
        tell = progress or (lambda _: None)
        at = as_instants(at)
        varied = [path for paths in variables for path in paths]
        lineariser = Lineariser.of(scene, vary=varied, at=at, loops=loops)
        loop = lineariser.loop
        places = tuple(tuple(loop.index(path) for path in paths) for paths in variables)
        operating_points = tuple(instants(lineariser.rollout(backend, tell), loop, at))
        p, t = ca.SX.sym("p", len(loop.parameter_paths)), ca.SX.sym("t")
        x, switches = ca.SX.sym("x", loop.nx), ca.SX.sym("s", len(loop.switches))
        x0, c = loop.setup(p)
        c[list(loop.switches)] = switches
        prepared = ca.Function("prepared", [p, t, x, switches], [x0, loop.at(t, x, c)])
        return cls(lineariser, operating_points, places, prepared)

    def system(self, k: int, values: Array | None = None, along: int | None = None) -> LinearSystem:
        """Linearised closed loop at an instant.

        Args:
            k: Number of the instant.
            values: Values of the variables; the scenario's numbers if None.
            along: Index of the variable whose derivatives the matrices carry; none if None.
        """
        p, instant = self.lineariser.loop.parameter_values.astype(float), self.instants[k]
        if values is not None:
            for places, value in zip(self.places, values, strict=True):
                p[list(places)] = value
        if along is not None:
            direction = np.zeros(len(p))
            direction[list(self.places[along])] = 1.0
            p = p + 1j * STEP * direction
        t, x, switches = instant.time_s, instant.x, instant.c[list(self.lineariser.loop.switches)]
        if along is not None and self.motion:
            moved = 1j * STEP * self.motion[k][:, along]
            t, x = t + moved[-1], x + moved[:-1]
        x0, c = evaluate(self.prepared, p, t, x, switches)
        x = x0.ravel() if instant.is_start else x
        return self.lineariser.at(replace(instant, time_s=t, x=x, c=c.ravel()))

    def sizes(
        self,
        k: int,
        values: Array | None,
        margin: str,
        loops: Iterable[str],
        *,
        least: bool = False,
        slopes: bool = True,
    ) -> list[MarginValue]:
        """Margins of loops at an instant, with exact derivatives.

        Args:
            k, values: As for :meth:`system`.
            margin: One of :data:`MARGINS`.
            loops: Break points.
            least: Whether only the loop with the smallest margin is needed.
            slopes: Whether derivatives are computed; else they are empty.
        """
        system = self.system(k, values)
        margins = [one for one in loop_margins(system, loops) if not math.isnan(one.disk)]
        sign = -1.0 if margin == "gain_down" else 1.0
        named = [(sign, margin, one) for one in margins]
        if margins and is_destabilised(system, margins):
            nearest = min(range(len(margins)), key=lambda i: margins[i].disk)
            named[nearest] = (-1.0, "disk", margins[nearest])
        if least:
            named = sorted(named, key=lambda one: one[0] * getattr(one[2], one[1]))[:1]
        moved = [self.system(k, values, along) for along in range(len(self.places)) if named and slopes]
        return [
            MarginValue(
                one.name,
                sign * getattr(one, kind),
                np.array([sign * margin_slope(each, one, kind) for each in moved]),
            )
            for sign, kind, one in named
        ]


def margin_slope(system: LinearSystem, one: LoopMargins, margin: str) -> float:
    """Derivative of a margin along the direction that the linearised closed loop carries.

    Args:
        system: Linear system with derivatives, from :meth:`ParametricLinearisation.system`.
        one: Margins of a loop of the same system.
        margin: One of :data:`MARGINS`.

    Returns:
        float: Unit of the margin per unit of the variable; zero if the margin is infinite, or is the
            limit at infinite frequency (disk margins excepted).
    """
    omega, value = one.frequencies.get(margin, math.nan), getattr(one, margin)
    if math.isnan(omega) or not math.isfinite(value) or (math.isinf(omega) and margin != "disk"):
        return 0.0
    place = system.inputs.index(one.name)
    A, B, C, D = system.closed(one.name)
    b, c, d = B[:, place], C[place], D[place, place]
    period = system.period_s or 1.0
    G: complex = d.real + 0j
    by_angle: complex = 0j
    along: complex = derivative(d) + 0j
    if math.isfinite(omega):
        angle = omega * period.real
        s = complex(np.exp(1j * angle)) if system.period_s else 1j * omega
        turn = 1j * s if system.period_s else 1j
        shifted = s * np.eye(len(A)) - A.real
        states, row = np.linalg.solve(shifted, b.real), np.linalg.solve(shifted.T, c.real)
        G, by_angle = complex(G + c.real @ states), complex(-(row @ states) * turn)
        along = along + row @ derivative(A) @ states + derivative(c) @ states + row @ derivative(b)
    if margin == "disk":  # alpha = 1 / |S - 1/2|, S = 1 + G
        return float(-(np.conj(G + 0.5) * along).real / abs(G + 0.5) ** 3)
    L, by_angle, along = -G / (1 + G), -by_angle / (1 + G) ** 2, -along / (1 + G) ** 2
    if margin in ("gain_up", "gain_down"):
        moved = -along.imag / by_angle.imag
        return float(-20 / np.log(10) * (along + by_angle * moved).real / L.real)
    moved = -(np.conj(L) * along).real / (np.conj(L) * by_angle).real
    turned, phase = ((along + by_angle * moved) / L).imag, np.angle(-L)
    if margin == "phase":
        return float(np.degrees(np.sign(phase) * turned))
    phase = phase if phase > 0 else phase + 2 * np.pi
    return float(
        (turned * period.real + phase * derivative(period) - phase * period.real * moved / angle) / angle
    )
