"""Measures of a rollout: integrals, peaks and final values of expressions, and costs as functions of them.

Expressions are written once, with CasADi, over the named outputs::

    signals = Signals.of(loop)
    error = signals["tip_error"]
    measures = Measures(
        signals,
        {"ise": integral(ca.sumsqr(error)), "torque": peak(ca.fabs(signals["joint_torque"]))},
        costs=lambda r, p: {"cost": r["ise"] + 1e-6 * ca.mmax(r["torque"])},
    )

The same expressions then serve the plain rollout, the batch, the adjoint and the forward sensitivities.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import casadi as ca

from spacerobot.common.errors import SpaceRobotError, near_names
from spacerobot.common.tables import Table
from spacerobot.common.tabular import Tabular
from spacerobot.rollout.closed_loop_protocol import ClosedLoopFunctions

Kind = Literal["integral", "peak", "final"]
Costs = Callable[[Mapping[str, ca.SX], Mapping[str, ca.SX]], Mapping[str, ca.SX]]


@dataclass(frozen=True)
class Signals:
    """Symbols that measures are written with.

    Attributes:
        t: Time in s.
        x: State, shape (nx,).
        outputs: The closed loop's outputs by name, each of shape (n,).
        parameters: Its parameters by dotted path, scalars.
    """

    t: ca.SX
    x: ca.SX
    outputs: Mapping[str, ca.SX]
    parameters: Mapping[str, ca.SX]

    @classmethod
    def of(cls, loop: ClosedLoopFunctions) -> Signals:
        """Symbols for a closed loop."""
        names = loop.outputs.name_out()
        outputs = {name: ca.SX.sym(name, loop.outputs.numel_out(name)) for name in names}
        parameters = {path: ca.SX.sym(path) for path in loop.parameter_paths}
        return cls(ca.SX.sym("t"), ca.SX.sym("x", len(loop.state_names)), outputs, parameters)

    def __getitem__(self, name: str) -> ca.SX:
        """Output of a name.

        Raises:
            SpaceRobotError: There is none.
        """
        if name not in self.outputs:
            raise SpaceRobotError(f"no output '{name}', {near_names(name, self.outputs)}")
        return self.outputs[name]


@dataclass(frozen=True)
class Measure:
    """A reduction of a signal over a rollout.

    Attributes:
        kind: Integral over time, largest value of each component, or value at the end.
        expression: Over :class:`Signals`, shape (n,).
    """

    kind: Kind
    expression: ca.SX


def integral(expression: ca.SX) -> Measure:
    """Integral over the duration, by the numerical method of the state."""
    return Measure("integral", ca.vec(ca.densify(ca.SX(expression))))


def peak(expression: ca.SX) -> Measure:
    """Largest value of each component over all step boundaries. Its derivative is that at the largest one.

    The status of derivatives reports where the one at the signal's maximum between steps differs.
    """
    return Measure("peak", ca.vec(ca.densify(ca.SX(expression))))


def final(expression: ca.SX) -> Measure:
    """Value at the end."""
    return Measure("final", ca.vec(ca.densify(ca.SX(expression))))


@dataclass(frozen=True)
class Measures(Tabular):
    """Named measures of a rollout, and costs that are functions of them.

    Attributes:
        signals: The symbols that the measures are written with.
        named: The measures.
        costs: Function from symbols of the measures, by name, and of the parameters, by path, to scalars by
            name. If None, each scalar measure is a cost.
    """

    signals: Signals
    named: Mapping[str, Measure]
    costs: Costs | None = None

    def __repr__(self) -> str:
        """Names and kinds, in one line."""
        return f"<Measures {', '.join(f'{name} ({m.kind})' for name, m in self.named.items()) or 'none'}>"

    def content(self) -> list[Table]:
        """Kind and length of each."""
        rows = ((name, f"{m.kind} of {m.expression.numel()}") for name, m in self.named.items())
        return [Table.of_pairs("Measures", rows)]

    def of_kind(self, kind: Kind) -> dict[str, ca.SX]:
        """Expressions of one kind, by name."""
        return {name: m.expression for name, m in self.named.items() if m.kind == kind}

    @property
    def sizes(self) -> dict[str, int]:
        """Length of each measure, in the order of r: integrals, peaks, final values."""
        kinds: tuple[Kind, ...] = ("integral", "peak", "final")
        return {name: e.numel() for kind in kinds for name, e in self.of_kind(kind).items()}

    def cost_expressions(self, r: Mapping[str, ca.SX], p: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
        """Costs by name, as expressions of measures and parameters.

        Args:
            r: Measures by name.
            p: Parameters by dotted path.

        Returns:
            dict: Scalar expressions (1x1); without a function of costs, the measures that are scalars.

        Raises:
            SpaceRobotError: If a cost is not a scalar.
        """
        if self.costs is None:
            return {name: value for name, value in r.items() if value.numel() == 1}
        expressions = {name: ca.SX(value) for name, value in self.costs(r, p).items()}
        for name, value in expressions.items():
            if value.numel() != 1:
                raise SpaceRobotError(f"the cost '{name}' has {value.numel()} entries, allowed: one")
        return expressions
