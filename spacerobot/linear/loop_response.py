r"""Loop transfer functions from the closed loop.

G is the response of a break point's signal y to the input w that is added to it: u = y + w. With y = -L u the
sensitivity is ``S = u / w = 1 + G = 1 / (1 + L)``, hence ``L = -G / (1 + G)``. One factorisation of ``s - A``
at each frequency serves all loops. Frequencies keep a distance from undamped poles, such as those of a body
that spins freely, near which a response is mostly rounding.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.linear.linearisation import NEUTRAL, RIGID, LinearSystem
from spacerobot.linear.periodic import Matrices

PER_DECADE = 150
"""Number of frequencies per decade; further ones are added around poles with little damping."""

BEYOND = 30.0
"""Factor by which frequencies extend beyond the slowest and the fastest pole."""

UNDAMPED = 1e-4
"""Width of an undamped pole, relative to its frequency."""

AT_ONCE = 256
"""Number of frequencies evaluated together, which bounds the memory."""

AROUND = np.concatenate([-np.geomspace(8, 1e-2, 40), [0.0], np.geomspace(1e-2, 8, 40)])
"""Frequencies around a pole with little damping, in units of its real part."""


def loop_response(system: LinearSystem, name: str) -> tuple[Array, Array]:
    """Frequencies [rad/s] and loop transfer function (complex) of a loop broken at one point.

    Args:
        system: The linearised closed loop.
        name: The break point.

    Raises:
        SpaceRobotError: If there is no such point, or the broken loop varies in time.
    """
    return next(loop_responses(system, [name]))


def loop_responses(system: LinearSystem, names: Iterable[str]) -> Iterator[tuple[Array, Array]]:
    """Yield frequencies and transfer functions of several loops, in the order of their names.

    Args:
        system, names: As for :func:`loop_response`.

    Raises:
        SpaceRobotError: As :func:`loop_response`.
    """
    names, poles = list(names), system.poles
    poles_open = {name: system.rates(system.broken(name)[0]) for name in names}
    most = np.pi / system.period_s if system.period_s else np.inf
    shared = frequency_grid(poles, most, np.concatenate([poles, *poles_open.values()]))
    by_closed_loop: dict[int, tuple[list[str], Array]] = {}
    for name in names:
        closed = system.closed(name)
        if id(closed[0]) not in by_closed_loop:
            members = [other for other in names if system.closed(other)[0] is closed[0]]
            places = [system.inputs.index(other) for other in members]
            by_closed_loop[id(closed[0])] = (members, responses(closed, places, system.points(shared)))
        members, values = by_closed_loop[id(closed[0])]
        response = values[members.index(name)]
        # poles that the loop shares with the closed one, or nearly so, have their frequencies already
        away = np.abs(poles_open[name][:, None] - poles).min(axis=1, initial=np.inf)
        apart = away > 0.5 * np.maximum(np.abs(poles_open[name].real), NEUTRAL * np.abs(poles_open[name]))
        more = np.concatenate([np.empty(0), *_resonances(poles_open[name][apart])])
        more = more[(more > shared[0]) & (more < shared[-1])]
        if not more.size:
            yield shared, response
            continue
        extra = responses(closed, [system.inputs.index(name)], system.points(more))[0]
        omega, first = np.unique(np.concatenate([shared, more]), return_index=True)
        kept_apart = np.concatenate([[True], np.diff(omega) > 1e-12 * omega[1:]])
        yield omega[kept_apart], np.concatenate([response, extra])[first[kept_apart]]


def responses(closed: Matrices, places: Sequence[int], s: Array) -> Array:
    """Loop transfer functions (loops, points) at complex points s (n,).

    Args:
        closed: Matrices of the closed loop.
        places: Indices of the break points among the inputs.
        s: Points of the Laplace plane, or z of a discrete system.
    """
    A, B, C, D = closed
    eye, B, C, D = np.eye(len(A)), B[:, places], C[places], D[places, places]
    G = np.concatenate(
        [
            np.einsum("in,fni->if", C, np.linalg.solve(part[:, None, None] * eye - A, B)) + D[:, None]
            for part in np.array_split(s, -(-len(s) // AT_ONCE))
        ],
        axis=1,
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(-G / (1 + G))


def response_slopes(closed: Matrices, place: int, s: complex) -> tuple[complex, complex]:
    """Loop transfer function L of one loop at a point s, and dL/ds.

    Args:
        closed, place, s: As for :func:`responses`.
    """
    A, B, C, D = closed
    shifted = s * np.eye(len(A)) - A
    states = np.linalg.solve(shifted, B[:, place])
    G = C[place] @ states + D[place, place]
    slope = -C[place] @ np.linalg.solve(shifted, states)
    return complex(-G / (1 + G)), complex(-slope / (1 + G) ** 2)


def frequency_grid(poles: Array, most: float, reach: Array | None = None) -> Array:
    """Frequencies [rad/s] from below the slowest to beyond the fastest pole, dense around resonances.

    Args:
        poles: Poles whose resonances need dense frequencies [1/s].
        most: Maximum frequency [rad/s].
        reach: Poles that define the range of frequencies [1/s]; ``poles`` if None.
    """
    sizes = np.abs(poles if reach is None else reach)
    sizes = sizes[sizes > RIGID]
    low, high = (sizes.min(), sizes.max()) if sizes.size else (1.0, 1.0)
    # below, poles at zero that rounding has split would count as resonances
    low, high = max(min(low / BEYOND, most / 10), RIGID), min(high * BEYOND, most)
    grids = [np.geomspace(low, high, int(PER_DECADE * np.log10(high / low)) + 2), *_resonances(poles)]
    omega = np.unique(np.concatenate(grids))
    omega = omega[(omega >= low) & (omega <= high)]
    return np.asarray(omega[np.concatenate([[True], np.diff(omega) > 1e-12 * omega[1:]])])


def _resonances(poles: Array) -> Iterator[Array]:
    """Yield frequencies around each pole with little damping, excluding an undamped pole itself."""
    for pole in poles:
        if pole.imag > 0 and abs(pole.real) < 0.2 * abs(pole) and abs(pole) > RIGID:
            if abs(pole.real) < NEUTRAL * abs(pole):
                yield pole.imag * (1 + UNDAMPED * AROUND[AROUND != 0])
            else:
                yield pole.imag + abs(pole.real) * AROUND
