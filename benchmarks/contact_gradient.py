"""Jacobian of one step with a contact, compiled, against published times of Le Lidec et al.

Le Lidec et al. (2024), End-to-end and highly efficient differentiable simulation for robotics, arXiv
2409.07107, state 5 us for an arm of 7 degrees of freedom and 95 us for a robot of 36, for the derivatives of
a step with rigid contact and friction by implicit differentiation, on another machine.
"""

from __future__ import annotations

import ctypes
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import yaml

from benchmarks.table_row import Row
from benchmarks.timing import cpu_time_of
from spacerobot.closedloop.closed_loop import ClosedLoop
from spacerobot.closedloop.commanded import CommandInput, build_commanded_loop
from spacerobot.common.arrays import Array
from spacerobot.compiled import compile_functions
from spacerobot.description.find import find_urdf
from spacerobot.scenario.load import validate
from spacerobot.scene import Scene, build_scene

STEP_S = 1e-3
CALLS = 200
PUBLISHED_S = {7: 5e-6, 36: 95e-6}
"""Published times by the number of degrees of freedom [s]."""
LIMBS, JOINTS = 5, 6
REPEAT = """
extern "C" void repeat(const real* const* arg, real* const* res, int64_t calls) {
  for (int64_t i = 0; i < calls; ++i) call_jacobian(arg, res);
}
"""
_LINK = """<link name="{name}"><inertial><origin xyz="0 0 0.1"/><mass value="{mass}"/>
<inertia ixx="0.03" iyy="0.03" izz="0.01" ixy="0.001" ixz="0" iyz="0.002"/></inertial></link>"""
_JOINT = """<joint name="j{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/>
<origin xyz="{place}" rpy="0.1 0.2 0.3"/><axis xyz="{axis}"/>
<limit lower="-3" upper="3" effort="50" velocity="5"/></joint>"""


def rows() -> list[Row]:
    """Rows of the arm and of the tree."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        arm = find_urdf("panda_arm.urdf").read_text(encoding="utf-8")
        (place / "tree.urdf").write_text(_tree(), encoding="utf-8")
        (place / "arm.urdf").write_text(arm, encoding="utf-8")
        (place / "floor.urdf").write_text(f'<robot name="floor">{_LINK.format(name="floor", mass=9)}</robot>')
        return [
            _measured(_scene(place, "arm.urdf", "fixed", "panda_link7")),
            _measured(_scene(place, "tree.urdf", "free_flyer", f"l{LIMBS - 1}_{JOINTS - 1}")),
        ]


def _tree() -> str:
    """URDF of a base with five limbs of six joints: 36 degrees of freedom with a floating base."""
    parts = [_LINK.format(name="base", mass=20)]
    for limb in range(LIMBS):
        parent = "base"
        for joint in range(JOINTS):
            name, axis = f"l{limb}_{joint}", ("1 0 0", "0 1 0", "0 0 1")[joint % 3]
            place = f"{0.2 * limb} 0.1 0" if joint == 0 else "0 0 0.2"
            parts.append(_LINK.format(name=name, mass=2))
            parts.append(_JOINT.format(name=name, parent=parent, place=place, axis=axis))
            parent = name
    return f'<robot name="tree">{"".join(parts)}</robot>'


def _scene(folder: Path, urdf: str, base: str, link: str) -> Scene:
    """Scene of a robot whose last link touches a plane."""
    document: dict[str, Any] = {
        "name": "touching",
        "robots": {"robot": {"urdf": urdf, "base": {"joint": base}, "tips": {link: {}}}},
        "target": {"urdf": "floor.urdf", "base": {"joint": "fixed", "position": [0, 0, 0]}},
        "pads": {
            "fist": {"link": f"robot/{link}", "kind": "sphere", "radius": 0.05},
            "ground": {"link": "target/floor", "kind": "plane"},
        },
        "contacts": {
            "touch": {
                "between": ["fist", "ground"],
                "stiffness": 1e5,
                "restitution": 0.5,
                "restitution_speed": 0.1,
                "friction": 0.5,
                "may_overlap": True,
            }
        },
        "simulation": {"duration": 1, "step": STEP_S, "output_step": 0.1},
    }
    source = folder / "scenario.yaml"
    source.write_text(yaml.safe_dump(document), encoding="utf-8")
    scene = build_scene(validate(document, source=source), {}, source=source)
    # the plane is moved to the last link, one millimetre deep
    loop, _ = build_commanded_loop(scene, ["robot"])
    x, c = loop.setup(loop.parameter_values)
    tip = dict(zip(loop.outputs.name_out(), loop.outputs(0, x, loop.at(0, x, c)), strict=True))[
        "tip_position"
    ]
    height = float(tip[2]) - 0.049
    return build_scene(
        validate(document, source=source), {"target.base.position": [0, 0, height]}, source=source
    )


def _measured(scene: Scene) -> Row:
    """Row of the Jacobian of a semi-implicit Euler step by position, velocity and torques."""
    loop, commands = build_commanded_loop(scene, ["robot"])
    nq, nv = loop.nq, loop.nv
    x, c = ca.SX.sym("x", loop.nx), ca.SX.sym("c", loop.dynamics.size1_in("c"))
    start, first = loop.setup(loop.parameter_values)
    constants = np.array(ca.DM(loop.at(0.0, start, first))).ravel()
    start = start.full().ravel()
    acceleration = loop.dynamics(0.0, x, c)[nq : nq + nv]
    v = x[nq : nq + nv] + STEP_S * acceleration
    rates = loop.dynamics(0.0, ca.vertcat(x[:nq], v, x[nq + nv :]), c)[:nq]
    step = ca.vertcat(x[:nq] + STEP_S * rates, v)
    places = _places(loop, commands)
    jacobian = ca.jacobian(step, ca.vertcat(x[: nq + nv], c[places]))
    function = ca.Function("jacobian", [x, c], [ca.densify(ca.cse(jacobian))], ["x", "c"], ["J"])
    library = compile_functions({"jacobian": function}, tail=REPEAT)
    result = np.empty(function.numel_out(0))
    point = [start, constants]
    arguments = (ctypes.c_void_p * 2)(*[values.ctypes.data for values in point])
    results = (ctypes.c_void_p * 1)(result.ctypes.data)
    repeat = library.entry("repeat")
    repeat(arguments, results, ctypes.c_int64(1))
    error = _difference(step, (x, c), point, places, result.reshape(-1, nq + nv).T)
    seconds = min(cpu_time_of(lambda: repeat(arguments, results, ctypes.c_int64(CALLS))) for _ in range(15))
    seconds /= CALLS
    published = PUBLISHED_S[nv]
    return Row(
        f"Jacobian of a contact step, {nv} degrees of freedom",
        "Le Lidec et al. 2024 as published, other machine",
        f"{seconds * 1e6:.1f} us",
        f"{published * 1e6:.0f} us",
        published / seconds,
        note=f"by position, velocity and {len(places)} torques; {function.n_instructions()} operations; ours "
        f"elastic (Hunt and Crossley) with one sphere, theirs rigid with its complementarity problem solved; "
        f"central differences agree to {error:.0e}",
        numbers={"ours_s": seconds, "published_s": published},
    )


def _places(loop: ClosedLoop, commands: Sequence[CommandInput]) -> list[int]:
    """Indices in c of the commanded torques."""
    _, nominal = loop.setup(loop.parameter_values)
    places = []
    for command in commands:
        values = np.array(loop.parameter_values, dtype=float)
        values[loop.index(command.path)] += 1.0
        _, changed = loop.setup(values)
        places += [int(place) for place in np.flatnonzero((changed - nominal).full().ravel())]
    return places


def _difference(
    step: ca.SX, symbols: tuple[ca.SX, ca.SX], point: Sequence[Array], places: Sequence[int], jacobian: Array
) -> float:
    """Largest difference of a Jacobian from central differences, relative to its largest entry."""
    function, width = ca.Function("step", list(symbols), [step]), 1e-6
    columns = [(0, k) for k in range(jacobian.shape[1] - len(places))] + [(1, k) for k in places]
    difference = np.empty_like(jacobian)
    for column, (which, k) in enumerate(columns):
        ends = []
        for sign in (1, -1):
            shifted = [values.copy() for values in point]
            shifted[which][k] += sign * width
            ends.append(function(*shifted).full().ravel())
        difference[:, column] = (ends[0] - ends[1]) / (2 * width)
    return float(np.abs(jacobian - difference).max() / np.abs(jacobian).max())
