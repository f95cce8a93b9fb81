"""Everything of a result that the animated page can plot over time, as plain data."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from spacerobot.arrays import Array
from spacerobot.result import Result
from spacerobot.result.ledger import work_text, works_of
from viz.drawing.motion import Rows, pick_rows
from viz.figures.bodies import rotation_deg, translation_mm
from viz.figures.style import called, shown_axes
from viz.page.limits import Limits
from viz.page.meshcat_scene import Packed, packed

NO_LIMITS: Limits = {}

MOST_SAMPLES = 1200
"""Samples over time, beside the extremes of each signal; a chart has about as many pixels."""

ENERGIES = {"energy_kinetic": "kinetic", "energy_spring": "springs of grips", "energy_potential": "potential"}

SHIPPED = {
    "base_": "attitude_error position_error",
    "body_": "angle momentum_angular momentum_linear orientation position rotation",
    "contact_": "force gap impulse loss normal_force point velocity",
    "energy_": "kinetic potential spring",
    "grasp_": "force gap impulse impulse_couple misalignment state torque",
    "grasp_capture": "_spin _velocity d_at",
    "hill_": "position velocity",
    "impulse_": "angular linear",
    "joint_": "position torque velocity",
    "momentum_": "angular linear",
    "orbit_": "anomaly radius",
    "thruster_": "force position",
    "tip_": "error orientation_error position reference velocity",
    "": "phase propellant q v z",
}
"""Variables that this module draws, or leaves out, by name: those of all elements that ship but wheels."""


@dataclass(frozen=True, eq=False)
class Signal:
    """One number over time: name, values (nt,), and the colour of the tip or body it belongs to."""

    name: str
    values: Array
    colour: tuple[str, int] | None = None


@dataclass(frozen=True, eq=False)
class PlottedQuantity:
    """Signals of one kind, drawn on one axis."""

    title: str
    unit: str
    signals: Sequence[Signal]


def quantities(result: Result) -> list[PlottedQuantity]:
    """All signals of a result at all its times, by quantity; what it is about comes first.

    That is the tip error; where nothing leads a tip the errors of bases, the orbit, and the momentum. A
    body that is alone exchanges no momentum and may be the orbit's origin: its rotation precedes them.
    """
    momenta, errors, orbit, bodies = (of(result) for of in (_momenta, _base_errors, _orbit, _bodies))
    alone = bodies if result.data.sizes["body"] == 1 else []
    first = _tip_errors(result) or [*errors, *alone, *orbit, *momenta]
    found = [*first, *_tips(result), *_grasps(result), *_contacts(result), *_joints(result)]
    found += [*bodies, *momenta, *_wheels(result), *errors, *_thrusters(result), *orbit]
    found += [*_energies(result), *_declared(result)]
    by_title = {quantity.title: quantity for quantity in found if quantity.signals}
    return list(by_title.values())


def chart_rows(result: Result, shown: Iterable[PlottedQuantity]) -> Rows:
    """Rows that a chart needs: an even spacing, and where each signal is least and greatest."""
    time = result.array("time")
    rows = [pick_rows(time, rate_hz=1e9, most=MOST_SAMPLES)]
    for signal in (signal for quantity in shown for signal in quantity.signals):
        finite = np.isfinite(signal.values)
        if finite.any():
            least, greatest = (
                np.where(finite, signal.values, np.inf),
                np.where(finite, signal.values, -np.inf),
            )
            rows.append(np.array([least.argmin(), greatest.argmax()], dtype=np.int64))
    return np.unique(np.concatenate(rows))


def signal_data(
    shown: Iterable[PlottedQuantity], rows: Rows, limits: Limits = NO_LIMITS
) -> list[dict[str, Any]]:
    """Plain data of signals at some rows.

    Returns
    -------
    list of dict
        ``title``, ``unit`` and ``signals``, each with its ``name``, ``colour`` and packed ``values``: one
        value where it never changes. A colour is ``[kind, k]``: that of the tip number k, of the body number
        k, or of all together; null for one of its own. One with limits tells its
        ``limits``, least and greatest, null where there is none.
    """
    return [
        {
            "title": quantity.title,
            "unit": quantity.unit,
            "signals": [
                {"name": signal.name, "colour": signal.colour, "values": _packed(signal.values[rows])}
                | ({"limits": limits[place]} if (place := (quantity.title, signal.name)) in limits else {})
                for signal in quantity.signals
            ],
        }
        for quantity in shown
    ]


def _packed(values: Array) -> Packed:
    return packed(values[:1] if (values == values[0]).all() else values)


def _size(vectors: Array, names: Sequence[str], colours: Sequence[tuple[str, int]]) -> list[Signal]:
    """Sizes of vectors (nt, k, 3)."""
    size = np.linalg.norm(vectors, axis=-1)
    return [Signal(name, size[:, k], colours[k]) for k, name in enumerate(names)]


def _along(vectors: Array, names: Sequence[str], axes: Sequence[str]) -> list[Signal]:
    """Components of vectors (nt, k, 3) along some axes."""
    return [
        Signal(f"{name} {axis}", vectors[:, k, "xyz".index(axis)])
        for k, name in enumerate(names)
        for axis in axes
    ]


def _about(result: Result) -> list[str]:
    """World axes about which anything can turn."""
    return ["z"] if "body_angle" in result.data else ["x", "y", "z"]


def _tip_errors(result: Result) -> list[PlottedQuantity]:
    """Of the tips that are led."""
    tips, axes = [str(tip) for tip in result.array("tip")], shown_axes(result)
    led = result.led_tips
    if not led:
        return []
    places = [tips.index(tip) for tip in led]
    colours = [("tip", place) for place in places]
    error = result.array("tip_error")[:, places] * 1e3
    turned = np.degrees(result.array("tip_orientation_error")[:, places])
    return [
        PlottedQuantity("tip error", "mm", _size(error, led, colours)),
        PlottedQuantity("tip error by axis", "mm", _along(error, led, axes)),
        PlottedQuantity("tip orientation error", "deg", _size(turned, led, colours)),
    ]


def _tips(result: Result) -> list[PlottedQuantity]:
    axes, led, names = shown_axes(result), result.led_tips, [str(tip) for tip in result.array("tip")]
    references = result.array("tip_reference")[:, [names.index(tip) for tip in led]]
    return [
        PlottedQuantity("tip position", "m", _along(result.array("tip_position"), names, axes)),
        PlottedQuantity("tip reference", "m", _along(references, led, axes)),
        PlottedQuantity("tip velocity", "mm/s", _along(result.array("tip_velocity") * 1e3, names, axes)),
    ]


def _grasps(result: Result) -> list[PlottedQuantity]:
    axes = shown_axes(result)
    names, tips = [str(grasp) for grasp in result.array("grasp")], [str(tip) for tip in result.array("tip")]
    colours = [("tip", tips.index(result.scenario.grasps[name].tip)) for name in names]
    force = result.array("grasp_force")
    return [
        PlottedQuantity("grip force", "N", _size(force, names, colours)),
        PlottedQuantity("grip force by axis", "N", _along(force, names, axes)),
        PlottedQuantity(
            "grip torque by axis", "N m", _along(result.array("grasp_torque"), names, _about(result))
        ),
        PlottedQuantity("gap of grips", "mm", _size(result.array("grasp_gap") * 1e3, names, colours)),
        PlottedQuantity("misalignment of grips", "deg", _misalignments(result, names, colours)),
    ]


def _misalignments(result: Result, names: Sequence[str], colours: Sequence[tuple[str, int]]) -> list[Signal]:
    """Angles between tips and where they are mated, of grasps that know it."""
    if "grasp_misalignment" not in result.data:
        return []
    turned = np.degrees(np.linalg.norm(result.data.grasp_misalignment, axis=-1))
    own = zip(names, turned.T, colours, strict=True)
    return [Signal(name, values, colour) for name, values, colour in own if np.isfinite(values).all()]


def _contacts(result: Result) -> list[PlottedQuantity]:
    data, axes = result.data, shown_axes(result)
    if "contact" not in data.dims:
        return []
    names = [str(contact) for contact in result.array("contact")]

    def each(variable: str, factor: float = 1.0) -> list[Signal]:
        return [Signal(n, data[variable].sel(contact=n).values * factor) for n in names]

    return [
        PlottedQuantity("contact force along the normal", "N", each("contact_normal_force")),
        PlottedQuantity("contact force by axis", "N", _along(result.array("contact_force"), names, axes)),
        PlottedQuantity("gap of contacts", "mm", each("contact_gap", 1e3)),
    ]


def _joints(result: Result) -> list[PlottedQuantity]:
    turns = result.array("joint_kind") != "prismatic"
    names = np.array([str(joint) for joint in result.array("joint")])
    kinds = (
        ("joint angle", "deg", "joint_position", turns, np.degrees(1.0)),
        ("joint rate", "deg/s", "joint_velocity", turns, np.degrees(1.0)),
        ("joint torque", "N m", "joint_torque", turns, 1.0),
        ("joint travel", "mm", "joint_position", ~turns, 1e3),
        ("joint speed", "mm/s", "joint_velocity", ~turns, 1e3),
        ("joint force", "N", "joint_torque", ~turns, 1.0),
    )
    found = []
    for title, unit, variable, chosen, factor in kinds:
        values = result.array(variable)[:, chosen] * factor
        found.append(
            PlottedQuantity(title, unit, [Signal(n, values[:, k]) for k, n in enumerate(names[chosen])])
        )
    return found


def _bodies(result: Result) -> list[PlottedQuantity]:
    axes, about = shown_axes(result), _about(result)
    names = [str(body) for body in result.array("body")]
    said, colours = [called(name) for name in names], [("body", k) for k in range(len(names))]
    turned = [rotation_deg(result, name)[1] for name in names]
    moved = [translation_mm(result, name)[1] for name in names]
    rotations = [v[:, 0] if len(about) == 1 else np.linalg.norm(v, axis=-1) for v in turned]
    return [
        PlottedQuantity(
            "rotation since the start",
            "deg",
            [Signal(n, v, c) for n, v, c in zip(said, rotations, colours, strict=True)],
        ),
        PlottedQuantity(
            "translation since the start",
            "mm",
            [
                Signal(f"{n} {axis}", values[:, k])
                for n, values in zip(said, moved, strict=True)
                for k, axis in enumerate(axes)
            ],
        ),
    ]


def _momenta(result: Result) -> list[PlottedQuantity]:
    """Of every body, of all together, and what came from outside."""
    axes = shown_axes(result)
    said = [called(str(name)) for name in result.array("body")]
    colours = [("body", k) for k in range(len(said))]
    momenta, given = {}, "impulse_linear" in result.data
    for kind in ("linear", "angular"):
        own, total = result.array(f"body_momentum_{kind}"), result.array(f"momentum_{kind}")
        outside = [result.array(f"impulse_{kind}")[:, None]] if given else []
        momenta[kind] = np.concatenate([own, total[:, None], *outside], axis=1)
    everyone = [*said, "all together", *(["given from outside"] if given else [])]
    together = [*colours, ("all", 0), *([("body", len(said))] if given else [])]
    return [
        PlottedQuantity("linear momentum", "N s", _size(momenta["linear"], everyone, together)),
        PlottedQuantity("linear momentum by axis", "N s", _along(momenta["linear"], everyone, axes)),
        PlottedQuantity(
            "angular momentum by axis", "N m s", _along(momenta["angular"], everyone, _about(result))
        ),
    ]


def _wheels(result: Result) -> list[PlottedQuantity]:
    data = result.data
    if "wheel" not in data.dims:
        return []
    names, about = [str(wheel) for wheel in result.array("wheel")], _about(result)
    kinds = (
        ("wheel speed", "rad/s", "wheel_speed", 1.0),
        ("wheel torque", "N m", "wheel_torque", 1.0),
        ("speed limit left to wheels", "%", "wheel_margin", 100.0),
    )
    carried = data.wheel_momentum.dropna("body", how="all")
    bodies = [called(str(body)) for body in carried.body.values]
    return [
        *(
            PlottedQuantity(
                title, unit, [Signal(n, result.array(key)[:, k] * scale) for k, n in enumerate(names)]
            )
            for title, unit, key, scale in kinds
            if key in data
        ),
        PlottedQuantity("angular momentum of wheels by axis", "N m s", _along(carried.values, bodies, about)),
    ]


def _base_errors(result: Result) -> list[PlottedQuantity]:
    """Of bases that are held."""
    data, found = result.data, list[PlottedQuantity]()
    kinds = (
        ("attitude error of bases by axis", "deg", "base_attitude_error", np.degrees(1.0), _about(result)),
        ("position error of bases by axis", "mm", "base_position_error", 1e3, shown_axes(result)),
    )
    for title, unit, key, factor, along in kinds:
        if key in data:
            held = data[key].dropna("body", how="all")
            names = [called(str(body)) for body in held.body.values]
            found.append(PlottedQuantity(title, unit, _along(held.values * factor, names, along)))
    return found


def _thrusters(result: Result) -> list[PlottedQuantity]:
    """Thruster forces and propellant consumption."""
    data = result.data
    if "thruster" not in data.dims:
        return []
    size = np.linalg.norm(result.array("thruster_force"), axis=-1)
    forces = [Signal(str(name), size[:, k]) for k, name in enumerate(result.array("thruster"))]
    spent = data.propellant.dropna("body", how="all") * 1e3
    masses = [Signal(called(str(body)), spent.sel(body=body).values) for body in spent.body.values]
    return [PlottedQuantity("thruster force", "N", forces), PlottedQuantity("propellant", "g", masses)]


def _orbit(result: Result) -> list[PlottedQuantity]:
    """Motion of bodies in radial, along-track and cross-track axes."""
    data, found = result.data, list[PlottedQuantity]()
    if "hill_position" not in data:
        return found
    axes = ("radial", "along-track", "cross-track")[: len(shown_axes(result))]
    for title, unit, factor in (("position", "m", 1.0), ("velocity", "mm/s", 1e3)):
        values = result.array(f"hill_{title}") * factor
        signals = [
            Signal(f"{called(str(body))} {axis}", values[:, k, i])
            for k, body in enumerate(result.array("body"))
            for i, axis in enumerate(axes)
        ]
        found.append(PlottedQuantity(f"{title} in Hill axes", unit, signals))
    return found


def _energies(result: Result) -> list[PlottedQuantity]:
    works = {work_text(work): result.array(str(work.name)) for work in works_of(result.data)}
    return [
        PlottedQuantity("energy", "J", [Signal(text, result.array(name)) for name, text in ENERGIES.items()]),
        PlottedQuantity(
            "work since the start", "J", [Signal(text, values) for text, values in works.items()]
        ),
    ]


def _declared(result: Result) -> list[PlottedQuantity]:
    """Outputs of kinds of one's own, as they declare them: text, unit, and who they are of."""
    known, found = (
        {head + tail for head, tails in SHIPPED.items() for tail in tails.split()},
        list[PlottedQuantity](),
    )
    for key, variable in result.data.data_vars.items():
        name, (along, *dims) = str(key), variable.dims
        by_wheel = name.startswith("wheel_") and "wheel" in result.data.dims
        if along != "time" or name in known or name.startswith("work_") or by_wheel:
            continue
        if dims and dims[0] != "axis":
            variable = variable.dropna(dims[0], how="all")
            values, owners = variable.values, [called(str(label)) for label in variable[dims[0]].values]
        else:  # of the whole scene
            values, owners = variable.values[:, None], [name.replace("_", " ")]
        title, unit = str(variable.attrs["long_name"]), str(variable.attrs["units"])
        if values.ndim == 3:
            found.append(PlottedQuantity(title, unit, _along(values, owners, shown_axes(result))))
        else:
            signals = [Signal(owner, values[:, k]) for k, owner in enumerate(owners)]
            found.append(PlottedQuantity(title, unit, signals))
    return found
