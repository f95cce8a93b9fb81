"""Signals of a result that the animated page can plot over time, as plain data."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.tables import ROTORS, unit_scale
from spacerobot.result import Result
from spacerobot.result.ledger import work_text, works_of
from viz.drawing.motion import Rows, pick_rows
from viz.figures.bodies import rotation_deg, translation_mm
from viz.figures.style import shown_axes
from viz.page.limits import Limits
from viz.page.meshcat_scene import packed

NO_LIMITS: Limits = {}

MOST_SAMPLES = 1200
"""Number of samples over time, in addition to the extremes of each signal; about the pixels of a chart."""

ABOUT_AXES = ("rad", "rad/s", "kg m^2")
"""Units of vectors whose components are rotations about axes."""

ENERGIES = {"energy_kinetic": "kinetic", "energy_spring": "springs of grips", "energy_potential": "potential"}

DEG = float(np.degrees(1.0))
RPM = unit_scale("rad/s", "wheel_speed")[0]
TIP_ERRORS = (
    ("tip error", "mm", "controlled tip", "tip_error", 1e3, "size"),
    ("tip error by axis", "mm", "controlled tip", "tip_error", 1e3, "along"),
    ("tip orientation error", "deg", "controlled tip", "tip_orientation_error", DEG, "size"),
)
TIPS_TO_JOINTS = (
    ("tip position", "m", "tip", "tip_position", 1.0, "along"),
    ("tip reference", "m", "controlled tip", "tip_reference", 1.0, "along"),
    ("tip velocity", "mm/s", "tip", "tip_velocity", 1e3, "along"),
    ("grip force", "N", "grasp", "grasp_force", 1.0, "size"),
    ("grip force by axis", "N", "grasp", "grasp_force", 1.0, "along"),
    ("grip torque by axis", "N m", "grasp", "grasp_torque", 1.0, "about"),
    ("gap of grips", "mm", "grasp", "grasp_gap", 1e3, "size"),
    ("misalignment of grips", "deg", "oriented grasp", "grasp_misalignment", DEG, "size"),
    ("contact force along the normal", "N", "contact", "contact_normal_force", 1.0, "value"),
    ("contact force by axis", "N", "contact", "contact_force", 1.0, "along"),
    ("gap of contacts", "mm", "contact", "contact_gap", 1e3, "value"),
    ("joint angle", "deg", "turning joint", "joint_position", DEG, "value"),
    ("joint rate", "deg/s", "turning joint", "joint_velocity", DEG, "value"),
    ("joint torque", "N m", "turning joint", "joint_torque", 1.0, "value"),
    ("joint travel", "mm", "sliding joint", "joint_position", 1e3, "value"),
    ("joint speed", "mm/s", "sliding joint", "joint_velocity", 1e3, "value"),
    ("joint force", "N", "sliding joint", "joint_torque", 1.0, "value"),
)
WHEELS = (
    ("wheel speed", "rpm", "wheel", "wheel_speed", RPM, "value"),
    ("wheel torque", "N m", "wheel", "wheel_torque", 1.0, "value"),
    ("speed limit left to wheels", "%", "wheel", "wheel_margin", 100.0, "value"),
    ("angular momentum of wheels by axis", "N m s", "acting body", "wheel_momentum", 1.0, "about"),
)
BASE_ERRORS = (
    ("attitude error of bases by axis", "deg", "acting body", "base_attitude_error", DEG, "about"),
    ("position error of bases by axis", "mm", "acting body", "base_position_error", 1e3, "along"),
)
THRUSTERS = (
    ("thruster force", "N", "thruster", "thruster_force", 1.0, "size"),
    ("propellant", "g", "acting body", "propellant", 1e3, "value"),
)
"""Curves: title, unit, owner, variable, factor, and value: the vector's norm, or its components along or
about the axes of motion."""

COMPOSED = (
    *("body_angle", "body_position", "body_rotation", "body_momentum_linear", "body_momentum_angular"),
    *("momentum_linear", "momentum_angular", "impulse_linear", "impulse_angular"),
    *("hill_position", "hill_velocity", *ENERGIES),
)
"""Variables from which curves of bodies, momenta, orbits and energies are computed."""

TABULATED = tuple(
    (key, whose.rpartition(" ")[2])
    for _, _, whose, key, _, _ in (*TIP_ERRORS, *TIPS_TO_JOINTS, *WHEELS, *BASE_ERRORS, *THRUSTERS)
)
"""Variables whose curves have their own title, unit and form, with the dimension of their labels."""


@dataclass(frozen=True, eq=False)
class Signal:
    """Signal over time: name, values (nt,), and the colour of its tip or body.

    ``bound`` (nt,) is three times the standard deviation of this estimation error as stated by its filter.
    """

    name: str
    values: Array
    colour: tuple[str, int] | None = None
    bound: Array | None = None


@dataclass(frozen=True, eq=False)
class PlottedQuantity:
    """Signals of one kind, drawn on one axis."""

    title: str
    unit: str
    signals: Sequence[Signal]


def quantities(result: Result) -> list[PlottedQuantity]:
    """All signals of a result at all its times, by quantity; controlled quantities come first.

    This is the tip error; without tip control, the errors of bases, the orbit, and the momentum. A single
    body exchanges no momentum and may be the orbit's origin: its rotation precedes these.
    """
    bodies, momenta, orbit = _bodies(result), _momenta(result), _orbit(result)
    errors = _tabulated(result, BASE_ERRORS)
    alone = bodies if result.data.sizes["body"] == 1 else []
    first = _tabulated(result, TIP_ERRORS) if result.led_tips else [*errors, *alone, *orbit, *momenta]
    plotted = [*first, *_tabulated(result, TIPS_TO_JOINTS), *bodies, *momenta, *_tabulated(result, WHEELS)]
    plotted += [*errors, *_tabulated(result, THRUSTERS), *orbit]
    energies = [Signal(text, result.array(name)) for name, text in ENERGIES.items()]
    works = [Signal(work_text(work), result.array(str(work.name))) for work in works_of(result.data)]
    plotted += [PlottedQuantity("energy", "J", energies), PlottedQuantity("work since the start", "J", works)]
    by_title = {quantity.title: quantity for quantity in [*plotted, *_declared(result)] if quantity.signals}
    return list(by_title.values())


def chart_rows(result: Result, quantities: Iterable[PlottedQuantity]) -> Rows:
    """Rows for a chart: evenly spaced ones, and those of each signal's minimum and maximum."""
    time = result.array("time")
    rows = [pick_rows(time, rate_hz=1e9, most=MOST_SAMPLES)]
    for signal in (signal for quantity in quantities for signal in quantity.signals):
        finite = np.isfinite(signal.values)
        if finite.any():
            least = np.where(finite, signal.values, np.inf).argmin()
            greatest = np.where(finite, signal.values, -np.inf).argmax()
            rows.append(np.array([least, greatest], dtype=np.int64))
    return np.unique(np.concatenate(rows))


def signal_data(
    quantities: Iterable[PlottedQuantity], rows: Rows, limits: Limits = NO_LIMITS
) -> list[dict[str, Any]]:
    """Plain data of signals at some rows.

    Returns:
        list of dict: ``title``, ``unit`` and ``signals``, each with ``name``, ``colour`` and packed
            ``values``: a single value for a constant signal. Errors of estimates have the ``bound`` of three
            standard deviations. A colour is ``[kind, k]``: that of tip number k, of body number k, or of the
            total; null for a separate colour. A limited signal has ``limits``, lower and upper, null if
            unlimited.
    """
    return [
        {
            "title": quantity.title,
            "unit": quantity.unit,
            "signals": [
                {"name": signal.name, "colour": signal.colour}
                | {"values": packed(values[:1] if (values == values[0]).all() else values)}
                | ({} if signal.bound is None else {"bound": packed(signal.bound[rows])})
                | ({"limits": limits[place]} if (place := (quantity.title, signal.name)) in limits else {})
                for signal in quantity.signals
                for values in [signal.values[rows]]
            ],
        }
        for quantity in quantities
    ]


def _along(
    vectors: Array, names: Sequence[str], axes: Sequence[str], bounds: Array | None = None
) -> list[Signal]:
    """Signals of the components of k vectors along some axes.

    Args:
        vectors: Values (nt, k, 3).
        names: Name of each vector.
        axes: Axes, ``x``, ``y`` or ``z``.
        bounds: Bound of each value (nt, k, 3); None without bounds.
    """
    places = list(map("xyz".index, axes))
    return [
        Signal(f"{name} {axis}", vectors[:, k, i], bound=None if bounds is None else bounds[:, k, i])
        for k, name in enumerate(names)
        for i, axis in zip(places, axes, strict=True)
    ]


def _about(result: Result) -> list[str]:
    """World axes of rotation in the scene."""
    return ["z"] if "body_angle" in result.data else ["x", "y", "z"]


def _tabulated(
    result: Result, rows: Iterable[tuple[str, str, str, str, float, str]]
) -> Iterator[PlottedQuantity]:
    """Quantities of a table's rows whose variables exist in the result."""
    data, tips = result.data, [str(tip) for tip in result.array("tip")]
    axes = {"along": shown_axes(result), "about": _about(result)}
    for title, unit, whose, key, factor, form in rows:
        dim = whose.rpartition(" ")[2]
        if key not in data or dim not in data[key].dims:
            continue
        values, labels = result.array(key), result.array(dim)
        chosen: Any = np.ones(len(labels), dtype=bool)
        if whose == "controlled tip":
            chosen = np.isin(labels, result.led_tips)
        elif dim == "joint":
            chosen = (result.array("joint_kind") != "prismatic") == (whose == "turning joint")
        elif whose == "oriented grasp":  # the others know no angle between the tip and where it is mated
            chosen = np.isfinite(values).all(axis=(0, 2))
        elif whose == "acting body":  # of the others the variable is not a number
            chosen = ~np.isnan(values).reshape(len(values), len(labels), -1).all(axis=(0, 2))
        names = [
            result.scenario.body_label(str(label)) if dim == "body" else str(label)
            for label in labels[chosen]
        ]
        values = values[:, chosen] * factor
        if form in axes:
            signals = _along(values, names, axes[form])
        else:
            values = values if form == "value" else np.linalg.norm(values, axis=-1)
            colours: list[tuple[str, int] | None] = [None] * len(names)
            if dim in ("tip", "grasp"):  # a grasp has the colour of its tip
                tip_labels = [name if dim == "tip" else result.scenario.grasps[name].tip for name in names]
                colours = [("tip", tips.index(tip)) for tip in tip_labels]
            signals = list(map(Signal, names, values.T, colours))
        yield PlottedQuantity(title, unit, signals)


def _bodies(result: Result) -> list[PlottedQuantity]:
    rotations, translations = list[Signal](), list[Signal]()
    for k, name in enumerate(map(str, result.array("body"))):
        turned, (axes, moved) = rotation_deg(result, name)[1], translation_mm(result, name)
        rotation = turned[:, 0] if turned.shape[1] == 1 else np.linalg.norm(turned, axis=-1)
        rotations.append(Signal(result.scenario.body_label(name), rotation, ("body", k)))
        translations += [
            Signal(f"{result.scenario.body_label(name)} {axis}", moved[:, i]) for i, axis in enumerate(axes)
        ]
    return [
        PlottedQuantity("rotation since the start", "deg", rotations),
        PlottedQuantity("translation since the start", "mm", translations),
    ]


def _momenta(result: Result) -> list[PlottedQuantity]:
    """Momenta of every body and of all together, and the impulse from outside."""
    bodies = [result.scenario.body_label(str(name)) for name in result.array("body")]
    colours = [*(("body", k) for k in range(len(bodies))), ("all", 0), ("body", len(bodies))]
    names, momenta = [*bodies, "all together"], {}
    for kind in ("linear", "angular"):
        parts = [result.array(f"body_momentum_{kind}"), result.array(f"momentum_{kind}")[:, None]]
        if "impulse_linear" in result.data:
            parts.append(result.array(f"impulse_{kind}")[:, None])
        momenta[kind] = np.concatenate(parts, axis=1)
    if "impulse_linear" in result.data:
        names.append("given from outside")
    sizes = map(Signal, names, np.linalg.norm(momenta["linear"], axis=-1).T, colours)
    by_axis = _along(momenta["linear"], names, shown_axes(result))
    about = _along(momenta["angular"], names, _about(result))
    return [
        PlottedQuantity("linear momentum", "N s", list(sizes)),
        PlottedQuantity("linear momentum by axis", "N s", by_axis),
        PlottedQuantity("angular momentum by axis", "N m s", about),
    ]


def _orbit(result: Result) -> list[PlottedQuantity]:
    """Motion of bodies in radial, along-track and cross-track axes."""
    data, plotted = result.data, list[PlottedQuantity]()
    if "hill_position" not in data:
        return plotted
    axes = ("radial", "along-track", "cross-track")[: len(shown_axes(result))]
    for title, unit, factor in (("position", "m", 1.0), ("velocity", "mm/s", 1e3)):
        values = result.array(f"hill_{title}") * factor
        signals = [
            Signal(f"{result.scenario.body_label(str(body))} {axis}", values[:, k, i])
            for k, body in enumerate(result.array("body"))
            for i, axis in enumerate(axes)
        ]
        plotted.append(PlottedQuantity(f"{title} in Hill axes", unit, signals))
    return plotted


def _declared(result: Result) -> list[PlottedQuantity]:
    """Outputs without a curve so far, as elements declare them: text, unit and owner."""
    plotted = list[PlottedQuantity]()
    for key, variable in result.data.data_vars.items():
        name, (along, *dims) = str(key), variable.dims
        is_tabulated = any(name == key and dim in dims for key, dim in TABULATED)
        has_curve = is_tabulated or name in COMPOSED or "sign" in variable.attrs  # works have a sign
        if along != "time" or has_curve or not variable.attrs.get("plotted", 1):
            continue
        bounds: Array | None = None
        if dims and dims[0] != "axis":
            variable = variable.dropna(dims[0], how="all")
            # a filter states its error's standard deviation: 99.7 % of a normal error is within three of it
            stated = f"{name.removesuffix('_error')}_deviation"
            if name.endswith("_error") and stated in result.data:
                bounds = 3 * result.data[stated].sel({dims[0]: variable[dims[0]]}).values
            values, owners = (
                variable.values,
                [result.scenario.body_label(str(label)) for label in variable[dims[0]].values],
            )
        else:  # of the whole scene
            values, owners = variable.values[:, None], [name.replace("_", " ")]
        title, unit = str(variable.attrs["long_name"]), str(variable.attrs["units"])
        if name in ROTORS:
            factor, unit = unit_scale(unit, name)
            values = factor * values
        if values.ndim == 3:
            axes = _about(result) if unit in ABOUT_AXES else shown_axes(result)
            plotted.append(PlottedQuantity(title, unit, _along(values, owners, axes, bounds)))
        else:
            signals = [
                Signal(owner, values[:, k], bound=None if bounds is None else bounds[:, k])
                for k, owner in enumerate(owners)
            ]
            plotted.append(PlottedQuantity(title, unit, signals))
    return plotted
