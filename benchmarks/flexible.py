"""``python -m benchmarks.flexible``: flexible links beside Exudyn and closed forms, and missions with panels.

Exudyn (``pip install exudyn``) models the beam by ANCF cable elements; without it its column is empty. The
free hub is a matrix of masses on the first node's coordinates (x, y, slope), exact for small motions.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.optimize import brentq

import spacerobot as sr
from benchmarks.table_row import markdown_head
from spacerobot.arrays import Array
from spacerobot.linear import linearise
from spacerobot.linear.loop_margins import loop_margins
from spacerobot.scenario.catalogue import find_scenario
from spacerobot.scenario.load import read_document, validate
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
    """Section of segments that bend in the plane."""
    ends = {"end": [LENGTH, 0, 0], "normal": [0, 0, 1], "segments": segments}
    return {"kind": "beam", "link": "beam", "bending_stiffness": STIFFNESS} | ends


def satellite(base: str, flexible: Mapping[str, Any]) -> Scene:
    """Hub and beam."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "satellite.yaml"
        (Path(folder) / "satellite.urdf").write_text(URDF, encoding="utf-8")
        robot = {"urdf": "satellite.urdf", "base": {"joint": base}, "flexible": {"own": dict(flexible)}}
        source.write_text(yaml.safe_dump({"robots": {"satellite": robot}}), encoding="utf-8")
        return build_scene(validate(yaml.safe_load(source.read_text()), source=source), source=source)


def ours(base: str, flexible: Mapping[str, Any]) -> Array:
    """First two natural frequencies [Hz] of the linearised closed loop."""
    (found,) = linearise(satellite(base, flexible), backend="interpreted")
    return np.sort([m.pole.imag / (2 * np.pi) for m in found.modes if m.pole.imag > 1e-2])[:2]


def exudyn(base: str, elements: int = 32) -> Array | None:
    """The same by Exudyn; None if it is not installed."""
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
        moved = np.array([[1, 0, -OFFSET, 0], [0, 1, 0, -OFFSET], [0, 0, 0, 1]])
        mass = moved.T @ np.diag([HUB_MASS, HUB_MASS, HUB_INERTIA]) @ moved
        system.AddObject(ObjectGenericODE2(nodeNumbers=[nodes[0]], massMatrix=mass))
    system.Assemble()
    values = system.ComputeODE2Eigenvalues(useSparseSolver=False)[0]
    found = np.sqrt(np.maximum(values, 0)) / (2 * np.pi)
    return np.sort(found[found > 1e-2])[:2]


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
            found = ours(base, section)
            if name == "modes, 1":
                found = found[:1]
            cells = [f"{value:.5f}" for value in found] + [""] * (2 - len(found))
            theirs = "" if peer is None else ", ".join(f"{value:.5f}" for value in peer)
            apart = "" if peer is None else f"{np.abs(found / peer[: len(found)] - 1).max():.1e}"
            rows.append(f"| {title} | {name} | {' | '.join(cells)} | {theirs} | {apart} |")
        if base == "fixed":
            rows.append(f"| clamped | Euler and Bernoulli | {exact[0]:.5f} | {exact[1]:.5f} | | |")
    return rows


def panel(
    link: str, root: list[float], along: list[float], mass: float, length: float, f: float
) -> dict[str, Any]:
    """First bending mode of a uniform panel out of the x-y plane.

    Parameters
    ----------
    link
        Link of the URDF whose mass includes the panel's.
    root, along
        Where it is attached [m], and the direction from there to its end, axes of the link.
    mass, length
        Of the panel [kg, m].
    f
        Clamped frequency [Hz].
    """
    section = clamped_modes(1)["participation"][0]
    force = section[1] / np.sqrt(MASS) * np.sqrt(mass)
    couple = section[5] / np.sqrt(MASS) / LENGTH * np.sqrt(mass) * length * np.cross(along, [0, 0, 1])
    row = [0.0, 0.0, float(force), *couple.tolist()]
    values = {"frequencies": [f], "damping": [0.005], "participation": [row]}
    return {"kind": "modes", "link": link, "position": root} | values


def norm(values: Array) -> float:
    """Greatest length of vectors along the last axis."""
    return float(np.nanmax(np.linalg.norm(values, axis=-1)))


def envisat() -> list[str]:
    """Envisat captured and brought to rest, with its solar array rigid and flexible."""
    mass, length = 340.0, 14.0
    head = ["array, Hz", "capture, s", "rest, s", "force at the grip, N", "torque at the grip, N m"]
    head += ["servicer turns, deg", "end of the array moves, mm", "in the last 10 s, mm"]
    rows = markdown_head(head)
    for f in (None, 0.2, 0.1, 0.05):
        array = panel("body", [4.2, 0, -3.4], [1, 0, 0], mass, length, f or 1.0)
        scene = load_scene("envisat", {"target.flexible": {"array": array}} if f else {})
        data = sr.simulate(scene, backend="interpreted").data
        time, moved = data["time"].values, ["", ""]
        if f:  # the mass-normalised shape is 2 / sqrt(m) at the end
            end = 2e3 / np.sqrt(mass) * np.abs(data["modal_coordinate"].values)
            moved = [f"{end.max():.1f}", f"{end[time > time[-1] - 10].max():.1f}"]
        cells = [f"{f:g}" if f else "rigid", f"{np.nanmax(data['grasp_captured_at'].values):.2f}"]
        cells += [f"{time[-1]:.1f}", f"{norm(data['grasp_force'].values):.2f}"]
        cells += [f"{norm(data['grasp_torque'].values):.2f}"]
        cells += [f"{np.degrees(norm(data['body_rotation'].values[:, 0])):.3f}", *moved]
        rows.append(f"| {' | '.join(cells)} |")
    return rows


def ets7() -> list[str]:
    """The chaser with wheels, its panels rigid and flexible: attitude and margins while the hand moves."""
    source = find_scenario("ets7")
    document = read_document(source)
    chaser = document["robots"]["wheels"]
    head = ["panels, Hz", "hand error, um", "base turns, mdeg", "turned 8 s after the motion, mdeg"]
    head += ["modes with little damping, Hz", "disk margin about x", "delay margin, s"]
    rows = markdown_head(head)
    for f in (None, 1.0, 0.25, 0.1):
        panels = {
            name: panel("base", [0, 1.05 * side, 0], [0, side, 0], 60.0, 5.8, f or 1.0)
            for name, side in (("left", 1), ("right", -1))
        }
        robot = chaser | ({"flexible": panels} if f else {})
        scene = build_scene(validate(document | {"robots": {"wheels": robot}}, source=source), source=source)
        data = sr.simulate(scene, backend="interpreted").data
        turned = 1e3 * np.degrees(np.linalg.norm(data["body_rotation"].values[:, 0], axis=-1))
        (linear,) = linearise(scene, [10.0], backend="interpreted")
        loop = next(one for one in loop_margins(linear) if one.name == "torque/wheels/root[3]")
        modes = sorted(m.pole.imag / (2 * np.pi) for m in linear.modes if m.pole.imag > 0 and m.damping < 0.1)
        told = ", ".join(f"{mode:.3f}" for mode in modes if mode > 0.05)
        cells = [f"{f:g}" if f else "rigid", f"{1e3 * 1e3 * norm(data['tip_error'].values):.3f}"]
        cells += [f"{turned.max():.3f}", f"{turned[data['time'].values > 48].max():.3f}", told]
        rows.append(f"| {' | '.join([*cells, f'{loop.disk:.3f}', f'{loop.delay:.3f}'])} |")
    return rows


BOOM_STIFFNESS = 5e6
"""Of the SSRMS's booms [N m^2]: assumed, that of a carbon-fibre tube, 0.35 m wide and 3 mm thick, 100 GPa."""
SLOW: dict[str, Any] = {
    "pid": {"kp": 2000, "ki": 100, "feedback": "inertial"},
    "orientation_pid": {"kp": 25000, "ki": 1500, "feedback": "inertial"},
}
"""Gains of the loaded arm, a tenth of those of the scenario, whose loops excite the booms."""


def booms() -> dict[str, Any]:
    """Sections of the SSRMS's booms, one segment each, 25 kg/m; damping 2 % at 1.3 Hz."""
    own = {"kind": "beam", "segments": 1, "bending_stiffness": BOOM_STIFFNESS, "damping_time": 5e-3}
    own |= {"mass_per_length": 25.0}
    upper = own | {"link": "link_3", "start": [0, -0.2375, 0], "end": [7.11, -0.2375, 0]}
    return {"upper": upper, "lower": own | {"link": "link_4", "end": [7.11, 0, 0]}}


def ssrms() -> list[str]:
    """The SSRMS captures and stops its load, with rigid and with flexible booms, both with slow gains."""
    head = "| booms | capture, s | force at the grapple, N | torque, N m | joint torque, N m "
    head += "| upper, lower boom bend, mm | largest after 50 s, mm | time to 10 % of the peak, s |"
    rows, tip = [head, "|" + "---|" * 8], "robots.ssrms.tips.end_effector"
    changes: dict[str, Any] = {f"{tip}.{key}.feedback": "base" for key in SLOW}
    for phase in ("stop", "carry", "halt"):
        changes |= {f"phases.{phase}.{tip}.{key}": gains for key, gains in SLOW.items()}
    changes |= {"simulation.duration": 115, "simulation.step": 0.01}
    for name, more in (("rigid", {}), ("flexible", {"robots.ssrms.flexible": booms()})):
        data = sr.simulate(load_scene("ssrms", changes | more), backend="interpreted").data
        caught, moved = float(np.nanmax(data["grasp_captured_at"].values)), [""] * 3
        if more:
            since = data["time"].values - caught
            bent = 1e3 * np.linalg.norm(data["deflection"].values, axis=-1)[since > 0]
            since, peak = since[since > 0], bent.max(axis=0)
            lasts = [since[bent[:, k] > 0.1 * peak[k]].max() for k in range(2)]
            late = bent[since > 50].max(axis=0)
            moved = [", ".join(f"{value:.2f}" for value in peak), ", ".join(f"{value:.2f}" for value in late)]
            moved += [", ".join(f"{value:.0f}" for value in lasts)]
        loads = [norm(data[f"grasp_{part}"].values) for part in ("force", "torque")]
        loads += [float(np.abs(data["joint_torque"].values[data["time"].values > caught]).max())]
        cells = [name, f"{caught:.2f}", *(f"{value:.1f}" for value in loads), *moved]
        rows.append(f"| {' | '.join(cells)} |")
    return rows


if __name__ == "__main__":
    for table in (frequencies, ets7, envisat, ssrms):
        print("\n".join(table()), "\n", flush=True)
