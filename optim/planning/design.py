"""How a plan's least cost changes with the design: derivatives at the solution, without planning again.

Where the Lagrangian of cost, constraints and limits is stationary, the derivative of the least cost
by any number of the scenario is that of the Lagrangian at the same unknowns and multipliers (the envelope
theorem). That one is taken by central differences: numbers of a scenario enter it by building the scene.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from optim.planning.formulate import formulate
from optim.planning.functions import build_instants
from optim.planning.make import Planned
from optim.planning.motion import Motion
from optim.planning.program import Program
from optim.planning.stage import Problem
from spacerobot.arrays import Array
from spacerobot.errors import ScenarioError
from spacerobot.scenario.load import to_document
from spacerobot.scenario.paths import get
from spacerobot.scene import build_scene

STEP = 1e-5
"""Of the central differences, relative to a number, or of it where that is smaller than one thousandth."""
SMALL = 1e-3


def cost_slopes(planned: Planned, paths: Sequence[str]) -> dict[str, float]:
    """Derivative of a plan's least cost by numbers of its scenario, in the scenario's own units.

    Parameters
    ----------
    planned
        The plan.
    paths
        Dotted paths, such as ``robots.arm.links.link_2.mass`` or ``plan.limits.torque``.

    Returns
    -------
    dict
        By path. To first order; where a limit becomes active or is no longer so, it jumps.

    Raises
    ------
    ScenarioError
        If there is no such number, or the plan has several phases.
    """
    if len(planned.course.motions) > 1:
        raise ScenarioError(
            "slopes are told of plans of one phase", source=planned.scene.source, where="plan.phases"
        )
    document, pressed = to_document(planned.scene.scenario), _multipliers(planned)
    found = {}
    for path in paths:
        value = get(document, path)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ScenarioError(f"found {value!r}, allowed: a number", where=path)
        step = STEP * max(abs(value), SMALL)
        ahead, behind = (_lagrangian(planned, pressed, (path, value + side)) for side in (step, -step))
        found[path] = (ahead - behind) / (2 * step)
    return found


def _multipliers(planned: Planned) -> Array:
    """Of the unknowns' limits; of what is fixed, which the solver leaves out, what makes the slope vanish."""
    motion, solved = planned.motion, planned.solved
    program = _program(motion.problem, motion)
    low, high = program.bounds()
    jacobian = program.jacobian_pattern.copy()
    jacobian.data = program.jacobian(solved.w)
    slope = program.gradient(solved.w) + jacobian.T @ solved.multipliers
    return np.where(low == high, -slope, solved.bound_multipliers)


def _program(problem: Problem, motion: Motion) -> Program:
    return Program(problem, build_instants(problem, "interpreted"), motion.lobatto, motion.intervals)


def _lagrangian(planned: Planned, bounds: Array, change: tuple[str, float]) -> float:
    """At a plan's unknowns and multipliers, for another value of a number."""
    scene = build_scene(planned.scene.scenario, dict([change]), source=planned.scene.source)
    program, solved = _program(formulate(scene), planned.motion), planned.solved
    limits = _pressed(solved.multipliers, program.constraints(solved.w), program.limits())
    return program.objective(solved.w) + limits + _pressed(bounds, solved.w, program.bounds())


def _pressed(multipliers: Array, values: Array, sides: tuple[Array, Array]) -> float:
    """Multipliers times how far values are beyond the limits that they belong to."""
    limit = np.where(multipliers > 0, sides[1], sides[0])
    held = np.isfinite(limit)
    return float(multipliers[held] @ (values - limit)[held])
