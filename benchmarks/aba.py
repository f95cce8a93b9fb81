"""Forward dynamics: the symbolic algorithm, compiled, against ``pin.aba`` called from Python."""

from __future__ import annotations

import ctypes
import math

import casadi as ca
import numpy as np
import pinocchio as pin

from benchmarks.table_row import Row
from benchmarks.timing import cpu_time_of, paired
from spacerobot.compiled import compile_functions, numpy_function
from spacerobot.description.find import find_urdf
from spacerobot.description.planar import planar_arm_urdf
from spacerobot.dynamics import ArticulatedBody, Inertias, forward_kinematics

CALLS = 2000
SLOPE_TARGET = 1.1
LINKS = (8, 32, 128)
REPEAT = """
extern "C" void repeat(const real* const* arg, real* const* res, int64_t calls) {
  for (int64_t i = 0; i < calls; ++i) call_aba(arg, res);
}
"""
"""Repeated calls of the function without Python, whose constant share would reduce the slope."""


def rows() -> list[Row]:
    """One row for each robot, and the slope of cost over links in a log-log plot."""
    table, cost = [], {}
    for links in LINKS:
        model = pin.buildModelFromXML(planar_arm_urdf(links=links), pin.JointModelPlanar())
        cost[links], row = _measure(f"planar arm of {links} links", model)
        table.append(row)
    servicer = find_urdf("servicer.urdf").read_text(encoding="utf-8")
    table.append(_measure("servicer", pin.buildModelFromXML(servicer, pin.JointModelFreeFlyer()))[1])
    a, b = LINKS[0], LINKS[-1]
    slope = math.log(cost[b] / cost[a]) / math.log(b / a)
    gradient = Row(
        "symbolic ABA, slope of cost over links",
        "linear",
        f"{slope:.2f}",
        "1.00",
        slope,
        f"at most {SLOPE_TARGET}",
        slope <= SLOPE_TARGET,
        f"{a} to {b} links, without the calls from Python",
    )
    return [*table, gradient]


def _measure(name: str, model: pin.Model) -> tuple[float, Row]:
    q, v, tau = (ca.SX.sym(n, size) for n, size in (("q", model.nq), ("v", model.nv), ("tau", model.nv)))
    kinematics = forward_kinematics(model, q, v)
    body = ArticulatedBody.factorise(model, kinematics, Inertias.from_model(model))
    function = ca.Function("aba", [q, v, tau], [ca.densify(body.acceleration(tau))], ["q", "v", "tau"], ["a"])
    library = compile_functions({"aba": function}, tail=REPEAT)
    rng, data = np.random.default_rng(0), model.createData()
    state = [pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq)), rng.normal(size=model.nv)]
    state.append(rng.normal(size=model.nv))
    out = np.empty(model.nv)
    call = library.entry("call_aba")
    arguments = (ctypes.c_void_p * 3)(*[a.ctypes.data for a in state])
    results = (ctypes.c_void_p * 1)(out.ctypes.data)
    call(arguments, results)
    exact = pin.aba(model, data, *state)
    difference = float(np.abs(out - exact).max() / np.abs(exact).max())

    quick = numpy_function(function)

    def ours() -> None:
        for _ in range(CALLS):
            quick(*state)

    def theirs() -> None:
        for _ in range(CALLS):
            pin.aba(model, data, *state)

    times = paired(ours, theirs, turns=9, calls=(CALLS, CALLS))
    repeat = library.entry("repeat")
    native = (
        min(cpu_time_of(lambda: repeat(arguments, results, ctypes.c_int64(CALLS))) for _ in range(30)) / CALLS
    )
    return native, Row(
        f"symbolic ABA, {name}",
        "pin.aba from Python",
        f"{times.first_s * 1e6:.2f} us",
        f"{times.second_s * 1e6:.2f} us",
        times.ratio,
        "faster",
        times.ratio > 1,
        f"{native * 1e6:.2f} us without the call from Python; {function.n_instructions()} operations; "
        f"agree to {difference:.0e}",
        {"native_s": native},
    )
