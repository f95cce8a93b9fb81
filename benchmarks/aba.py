"""Forward dynamics: the symbolic algorithm, compiled, against ``pin.aba`` called from Python."""

from __future__ import annotations

import ctypes
import math

import casadi as ca
import numpy as np
import pinocchio as pin

from benchmarks.row import Row
from benchmarks.timing import paired
from spacerobot.compiled import compile_functions
from spacerobot.description.find import find_urdf
from spacerobot.description.planar import planar_arm_urdf
from spacerobot.dynamics import ArticulatedBody, Inertias, forward_kinematics

CALLS = 2000
SLOPE_TARGET = 1.1
LINKS = (8, 32, 128)


def rows() -> list[Row]:
    """One row for each robot, and the slope of cost over links."""
    found, cost = [], {}
    for links in LINKS:
        model = pin.buildModelFromXML(planar_arm_urdf(links=links), pin.JointModelPlanar())
        cost[links], row = _measure(f"planar arm of {links} links", model)
        found.append(row)
    servicer = find_urdf("servicer.urdf").read_text(encoding="utf-8")
    found.append(_measure("servicer", pin.buildModelFromXML(servicer, pin.JointModelFreeFlyer()))[1])
    return [*found, _slope(cost)]


def _measure(name: str, model: pin.Model) -> tuple[float, Row]:
    q, v, tau = (ca.SX.sym(n, size) for n, size in (("q", model.nq), ("v", model.nv), ("tau", model.nv)))
    kinematics = forward_kinematics(model, q, v)
    body = ArticulatedBody.factorise(model, kinematics, Inertias.from_model(model).lumped(model))
    function = ca.Function("aba", [q, v, tau], [ca.densify(body.acceleration(tau))], ["q", "v", "tau"], ["a"])
    library = compile_functions({"aba": function})
    rng, data = np.random.default_rng(0), model.createData()
    given = [pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq)), rng.normal(size=model.nv)]
    given.append(rng.normal(size=model.nv))
    out = np.empty(model.nv)
    call = library.entry("call_aba")
    arguments = (ctypes.c_void_p * 3)(*[a.ctypes.data for a in given])
    results = (ctypes.c_void_p * 1)(out.ctypes.data)
    call(arguments, results)
    exact = pin.aba(model, data, *given)
    difference = float(np.abs(out - exact).max() / np.abs(exact).max())

    def ours() -> None:
        for _ in range(CALLS):
            call(arguments, results)

    def theirs() -> None:
        for _ in range(CALLS):
            pin.aba(model, data, *given)

    times = paired(ours, theirs, turns=9, calls=(CALLS, CALLS))
    return times.first_s, Row(
        f"symbolic ABA, {name}",
        "pin.aba from Python",
        f"{times.first_s * 1e6:.2f} us",
        f"{times.second_s * 1e6:.2f} us",
        times.ratio,
        "faster",
        times.ratio > 1,
        f"{function.n_instructions()} instructions; agree to {difference:.0e}",
    )


def _slope(cost: dict[int, float]) -> Row:
    a, b = LINKS[0], LINKS[-1]
    slope = math.log(cost[b] / cost[a]) / math.log(b / a)
    return Row(
        "symbolic ABA, slope of cost over links",
        "linear",
        f"{slope:.2f}",
        "1.00",
        slope,
        f"at most {SLOPE_TARGET}",
        slope <= SLOPE_TARGET,
        f"{a} to {b} links, one call from Python each",
    )
