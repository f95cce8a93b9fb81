"""``python -m benchmarks.flexible [TABLE ...]``: flexible links, Exudyn and closed forms; missions.

Exudyn (``pip install exudyn``) models the beam by ANCF cable elements; without it its column is empty. The
free hub is a matrix of masses on the first node's coordinates (x, y, slope), exact for small motions.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.optimize import brentq

import spacerobot as sr
from benchmarks.table_row import markdown_head
from spacerobot.common.arrays import Array
from spacerobot.linear import linearise
from spacerobot.linear.loop_margins import loop_margins
from spacerobot.scenario.catalogue import find_scenario
from spacerobot.scenario.document import read_document
from spacerobot.scenario.load import validate
from spacerobot.scene import Scene, build_scene, load_scene

LENGTH, DENSITY, STIFFNESS = 5.0, 4.0, 2000.0
HUB_MASS, HUB_INERTIA, OFFSET = 120.0, 70.0, 0.5
MASS = DENSITY * LENGTH
URDF = f"""<robot name="satellite"><link name="hub"><inertial><mass value="{HUB_MASS}"/>
<inertia ixx="{HUB_INERTIA}" iyy="{HUB_INERTIA}" izz="{HUB_INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial>
</link>
<link name="beam"><inertial><origin xyz="{LENGTH / 2} 0 0"/><mass value="{MASS}"/>
<inertia ixx="0" iyy="{MASS * LENGTH**2 / 12}" izz="{MASS * LENGTH**2 / 12}" ixy="0" ixz="0" iyz="0"/>
</inertial></link><joint name="clamp" type="fixed"><parent link="hub"/><child link="beam"/>
<origin xyz="{OFFSET} 0 0"/></joint></robot>"""


def cantilever(count: int) -> Array:
    """Roots of ``1 + cos x cosh x = 0``: ``w = x^2 sqrt(E I / mu) / l^2``."""
    guesses = (np.arange(count) + 0.5) * np.pi
    return np.array([brentq(lambda x: 1 / np.cosh(x) + np.cos(x), g - 0.6, g + 0.6) for g in guesses])


def clamped_modes(count: int) -> dict[str, Any]:
    """Section of clamped modes of the beam: frequencies, and participation factors of a uniform cantilever.

    With the root x and ``s = (cos x + cosh x) / (sin x + sinh x)``, the mass-normalised shapes have
    ``integral = 2 s / x`` and ``first moment = 2 / x^2``, times sqrt(m) and sqrt(m) l.
    """
    x = cantilever(count)
    s = (np.cos(x) + np.cosh(x)) / (np.sin(x) + np.sinh(x))
    force, couple = 2 * s / x * np.sqrt(MASS), 2 / x**2 * np.sqrt(MASS) * LENGTH
    frequencies = x**2 * np.sqrt(STIFFNESS / DENSITY) / LENGTH**2 / (2 * np.pi)
    rows = [[0, float(f), 0, 0, 0, float(c)] for f, c in zip(force, couple, strict=True)]
    return {
        "kind": "modes",
        "link": "beam",
        "frequencies": frequencies.tolist(),
        "damping": [0.0] * count,
        "participation": rows,
    }


def beam(segments: int) -> dict[str, Any]:
    """Section of a beam of segments that bend in the plane."""
    ends = {"end": [LENGTH, 0, 0], "normal": [0, 0, 1], "segments": segments}
    return {"kind": "beam", "link": "beam", "bending_stiffness": STIFFNESS} | ends


def satellite(base: str, flexible: Mapping[str, Any]) -> Scene:
    """Scene of the hub with the beam."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "satellite.yaml"
        (Path(folder) / "satellite.urdf").write_text(URDF, encoding="utf-8")
        robot = {"urdf": "satellite.urdf", "base": {"joint": base}, "flexible": {"own": dict(flexible)}}
        source.write_text(yaml.safe_dump({"robots": {"satellite": robot}}), encoding="utf-8")
        return build_scene(validate(yaml.safe_load(source.read_text()), source=source), source=source)


def ours(base: str, flexible: Mapping[str, Any]) -> Array:
    """First two natural frequencies [Hz] of the linearised closed loop."""
    (system,) = linearise(satellite(base, flexible), backend="interpreted")
    return np.sort([m.pole.imag / (2 * np.pi) for m in system.modes if m.pole.imag > 1e-2])[:2]


def exudyn(base: str, elements: int = 32) -> Array | None:
    """First two natural frequencies [Hz] by Exudyn; None if it is not installed."""
    try:
        import exudyn as exu
        from exudyn.beams import GenerateBeamElementsAlongLine
        from exudyn.utilities import Cable2D, ObjectGenericODE2
    except ImportError:
        return None
    system = exu.SystemContainer().AddSystem()
    cable = Cable2D(
        physicsMassPerLength=DENSITY, physicsBendingStiffness=STIFFNESS, physicsAxialStiffness=1e8
    )
    fixed = [1, 1, 0, 1] if base == "fixed" else None
    line = [OFFSET, 0, 0], [OFFSET + LENGTH, 0, 0], elements, cable
    nodes = GenerateBeamElementsAlongLine(system, *line, groundConstraintsStart=fixed)["nodes"]
    if base != "fixed":
        shift = np.array([[1, 0, -OFFSET, 0], [0, 1, 0, -OFFSET], [0, 0, 0, 1]])
        mass = shift.T @ np.diag([HUB_MASS, HUB_MASS, HUB_INERTIA]) @ shift
        system.AddObject(ObjectGenericODE2(nodeNumbers=[nodes[0]], massMatrix=mass))
    system.Assemble()
    values = system.ComputeODE2Eigenvalues(useSparseSolver=False)[0]
    frequencies_hz = np.sqrt(np.maximum(values, 0)) / (2 * np.pi)
    return np.sort(frequencies_hz[frequencies_hz > 1e-2])[:2]


def frequencies() -> list[str]:
    """Rows of the table of frequencies."""
    exact = cantilever(2) ** 2 * np.sqrt(STIFFNESS / DENSITY) / LENGTH**2 / (2 * np.pi)
    head = ("beam", "model", "f1, Hz", "f2, Hz", "Exudyn f1, f2, Hz", "largest difference")
    rows = markdown_head(head)
    for base, title in (("fixed", "clamped"), ("planar", "on a free hub")):
        peer = exudyn(base)
        models = {f"beam, {n} segments": beam(n) for n in (4, 8, 16, 32)}
        if base == "planar":
            models |= {f"modes, {n}": clamped_modes(n) for n in (1, 2, 4)}
        for name, section in models.items():
            computed = ours(base, section)
            if name == "modes, 1":
                computed = computed[:1]
            cells = [f"{value:.5f}" for value in computed] + [""] * (2 - len(computed))
            theirs = "" if peer is None else ", ".join(f"{value:.5f}" for value in peer)
            difference = "" if peer is None else f"{np.abs(computed / peer[: len(computed)] - 1).max():.1e}"
            rows.append(f"| {title} | {name} | {' | '.join(cells)} | {theirs} | {difference} |")
        if base == "fixed":
            rows.append(f"| clamped | Euler and Bernoulli | {exact[0]:.5f} | {exact[1]:.5f} | | |")
    return rows


def panel(
    link: str, root: list[float], along: list[float], mass: float, length: float, f: float
) -> dict[str, Any]:
    """First bending mode of a uniform panel out of the x-y plane.

    Args:
        link: Link of the URDF whose mass includes the panel's.
        root, along: Position of its root [m], and direction from there to its end, axes of the link.
        mass, length: Mass [kg] and length [m] of the panel.
        f: Clamped frequency [Hz].
    """
    section = clamped_modes(1)["participation"][0]
    force = section[1] / np.sqrt(MASS) * np.sqrt(mass)
    couple = section[5] / np.sqrt(MASS) / LENGTH * np.sqrt(mass) * length * np.cross(along, [0, 0, 1])
    row = [0.0, 0.0, float(force), *couple.tolist()]
    values = {"frequencies": [f], "damping": [0.005], "participation": [row]}
    return {"kind": "modes", "link": link, "position": root} | values


def norm(values: Array) -> float:
    """Largest norm of vectors along the last axis."""
    return float(np.nanmax(np.linalg.norm(values, axis=-1)))


def envisat() -> list[str]:
    """Rows of Envisat, captured and stopped, with its solar array rigid and flexible."""
    head = ["array, Hz", "capture, s", "rest, s", "force at the grip, N", "torque at the grip, N m"]
    head += ["servicer turns, deg", "end of the array moves, mm", "in the last 10 s, mm"]
    rows = markdown_head(head)
    for f in (None, 0.2, 0.1, 0.05):
        scene = captor(f)
        data = sr.simulate(scene, backend="interpreted").data
        time, end_motion = data["time"].values, ["", ""]
        if f:  # the mass-normalised shape is 2 / sqrt(m) at the end
            end = 1e3 * ENDS["Envisat"] * np.abs(data["modal_coordinate"].values)
            end_motion = [f"{end.max():.1f}", f"{end[time > time[-1] - 10].max():.1f}"]
        cells = [f"{f:g}" if f else "rigid", f"{np.nanmax(data['grasp_captured_at'].values):.2f}"]
        cells += [f"{time[-1]:.1f}", f"{norm(data['grasp_force'].values):.2f}"]
        cells += [f"{norm(data['grasp_torque'].values):.2f}"]
        cells += [f"{np.degrees(norm(data['body_rotation'].values[:, 0])):.3f}", *end_motion]
        rows.append(f"| {' | '.join(cells)} |")
    return rows


def ets7() -> list[str]:
    """Rows of the chaser with wheels and rigid or flexible panels: attitude and margins as the hand moves."""
    head = ["panels, Hz", "hand error, um", "base turns, mdeg", "turned 8 s after the motion, mdeg"]
    head += ["modes with little damping, Hz", "disk margin about x", "delay margin, s"]
    rows = markdown_head(head)
    for f in (None, 1.0, 0.25, 0.1):
        scene = chaser(f)
        data = sr.simulate(scene, backend="interpreted").data
        turned = 1e3 * np.degrees(np.linalg.norm(data["body_rotation"].values[:, 0], axis=-1))
        (linear,) = linearise(scene, [10.0], backend="interpreted")
        loop = next(one for one in loop_margins(linear) if one.name == "torque/wheels/root[3]")
        modes = sorted(m.pole.imag / (2 * np.pi) for m in linear.modes if m.pole.imag > 0 and m.damping < 0.1)
        modes_text = ", ".join(f"{mode:.3f}" for mode in modes if mode > 0.05)
        cells = [f"{f:g}" if f else "rigid", f"{1e3 * 1e3 * norm(data['tip_error'].values):.3f}"]
        cells += [f"{turned.max():.3f}", f"{turned[data['time'].values > 48].max():.3f}", modes_text]
        rows.append(f"| {' | '.join([*cells, f'{loop.disk:.3f}', f'{loop.delay:.3f}'])} |")
    return rows


def chaser(f: float | None) -> Scene:
    """Scene of ETS-VII's chaser with wheels, and panels with a clamped frequency [Hz], rigid if None."""
    source = find_scenario("ets7")
    document = read_document(source)
    panels = {
        name: panel("base", [0, 1.05 * side, 0], [0, side, 0], 60.0, 5.8, f or 1.0)
        for name, side in (("left", 1), ("right", -1))
    }
    robot = document["robots"]["wheels"] | ({"flexible": panels} if f else {})
    return build_scene(validate(document | {"robots": {"wheels": robot}}, source=source), source=source)


def captor(f: float | None) -> Scene:
    """Scene of Envisat and its servicer, and an array with a clamped frequency [Hz], rigid if None."""
    array = panel("body", [4.2, 0, -3.4], [1, 0, 0], 340.0, 14.0, f or 1.0)
    changes: dict[str, Any] = {"target.flexible": {"array": array}} if f else {}
    return load_scene("envisat", changes | {"simulation.output_step": FINE_S})


def station(rigid: str) -> Scene:
    """Scene of ``ssrms-flexible`` with some of ``booms, joints`` rigid."""
    changes: dict[str, Any] = {"simulation.output_step": FINE_S}
    if "booms" in rigid:
        changes["robots.ssrms.flexible"] = {}
    if "joints" in rigid:
        changes |= {"robots.ssrms.actuators": {}, "robots.ssrms.sensors": {}}
    return load_scene("ssrms-flexible", changes)


MISSIONS: tuple[tuple[str, str, tuple[float, ...], Callable[[], Scene]], ...] = (
    ("SSRMS", "nothing", (0.0, 57.0, 125.0), lambda: station("booms, joints")),
    ("SSRMS", "booms", (0.0, 57.0, 125.0), lambda: station("joints")),
    ("SSRMS", "joints", (0.0, 57.0, 125.0), lambda: station("booms")),
    ("SSRMS", "booms and joints", (0.0, 57.0, 125.0), lambda: station("")),
    ("ETS-VII", "nothing", (10.0,), lambda: chaser(None)),
    ("ETS-VII", "panels, 0.1 Hz", (10.0,), lambda: chaser(0.1)),
    ("Envisat", "nothing", (), lambda: captor(None)),
    ("Envisat", "array, 0.05 Hz", (), lambda: captor(0.05)),
)
"""Missions, flexible parts, times [s] at which margins of torques are computed, and scenes."""
FINE_S = 0.01
"""Output step of missions with captures, whose largest forces last less than 0.1 s."""
ENDS = {"ETS-VII": 2 / np.sqrt(60.0), "Envisat": 2 / np.sqrt(340.0)}
"""Deflection of the end of a panel of uniform mass by its mass-normalised coordinate [kg^(-1/2)]."""


def missions() -> Iterator[str]:
    """Rows of each mission, rigid and flexible; the cost is a rollout's time relative to the rigid one."""
    head = ["mission", "flexible", "capture, s", "tip error, mm", "base turns, mdeg", "joint torque, N m"]
    head += ["force at the grip, N", "torque, N m", "end bends, mm (in the last 5 s)", "at rest, s"]
    yield from markdown_head([*head, "least disk margin", "delay margin, s", "cost"])
    rigid_s = 1.0
    for mission, flexible, at, make in MISSIONS:
        scene = make()
        sr.simulate(scene)  # compiled, for the time
        result = sr.simulate(scene)
        data, cells = result.data, [mission, flexible]
        timing = result.summary["timing_s"]["rollout"]
        rigid_s = timing if flexible == "nothing" else rigid_s
        grips, turns = bool(scene.grasps), scene.robots[0].root_joint > 0
        cells.append(f"{np.nanmax(data['grasp_captured_at'].values):.2f}" if grips else "")
        follows = mission != "Envisat"  # its tip has no reference
        cells.append(f"{1e3 * norm(data['tip_error'].values):.3g}" if follows else "")
        turned = 1e3 * np.degrees(norm(data["body_rotation"].values[:, 0]))
        cells += [f"{turned:.6g}" if turns else "", f"{np.abs(data['joint_torque'].values).max():.4g}"]
        for part in ("grasp_force", "grasp_torque"):
            cells.append(f"{norm(data[part].values):.3g}" if grips else "")
        bent = np.zeros((data.sizes["time"], 0))
        if "deflection" in data:
            bent = 1e3 * np.linalg.norm(data["deflection"].values, axis=-1)
        if "modal_coordinate" in data:
            bent = 1e3 * ENDS[mission] * np.abs(data["modal_coordinate"].values)
        last = bent[data["time"].values > data["time"].values[-1] - 5]
        cells.append(f"{bent.max():.3g} ({last.max():.3g})" if bent.size else "")
        cells.append(f"{data['time'].values[-1]:.1f}" if grips else "")
        loops = [
            loop
            for linear in (linearise(scene, at) if at else ())
            for loop in loop_margins(linear, [name for name in linear.inputs if name.startswith("torque/")])
        ]
        cells += [f"{min(one.disk for one in loops):.2f}" if loops else ""]
        cells += [f"{min(one.delay for one in loops):.2g}" if loops else ""]
        yield f"| {' | '.join([*cells, f'{timing / rigid_s:.1f}'])} |"


TABLES: Mapping[str, Callable[[], Iterable[str]]] = {
    table.__name__: table for table in (frequencies, ets7, envisat, missions)
}

if __name__ == "__main__":
    for name in sys.argv[1:] or TABLES:
        for row in TABLES[name]():
            print(row, flush=True)
        print()
