"""Warm starts: the motion of a stored plan as the initial guess of another search."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from optim.planning.formulation.grasps import wrench_axes
from optim.planning.search.held_joints import balancing_drives
from optim.planning.search.plan_solver import PlanSolver, SolveResult
from optim.planning.solver.ipopt import Solution
from optim.planning.transcription.lobatto import Lobatto
from optim.planning.transcription.mesh import Mesh
from optim.planning.transcription.motion import Motion, PhasedMotion
from spacerobot.common.errors import ScenarioError
from spacerobot.elements.references.plan_file import numbers, open_plan, phase_rows

FILE = "plan.nc"
MULTIPLIERS = ("multiplier", "bound_multiplier")


def stored_motion(solver: PlanSolver, path: Path) -> SolveResult:
    """Trajectory of a stored plan as an initial result.

    Configuration, velocity, acceleration and grasp wrenches are read from the file. The drive is computed
    from the equations of motion of this scene, which may have other masses. The file's mesh is used if its
    order is the section's and it has between `intervals` and `max_intervals` intervals; otherwise the motion
    is interpolated on the section's first mesh. Multipliers are used if the file's mesh is, and their numbers
    are those of the constraints and unknowns.

    Args:
        solver: The problem.
        path: A plan's folder, or its ``plan.nc``.

    Returns:
        SolveResult: Result with the trajectory; without multipliers if they do not fit.

    Raises:
        ScenarioError: If the file is not a plan of this scene; the message names the difference.
    """
    file = path / FILE if path.is_dir() else path
    plan = open_plan(file, ("q", "v", "acceleration", "configuration", "velocity"))
    problems = solver.problems_of(solver.request())
    model, names = problems[0].stage.scene.model, list(solver.names)
    rows = phase_rows(plan) if len(names) > 1 else {"": (0, plan.sizes["time"] - 1)}
    bodies = {str(name).partition("/")[0] for name in model.names[1:]}
    joints = {str(name) for name in model.names[1:]}
    labels = {str(label).partition("[")[0] for label in plan.configuration.values}
    _same(file, "bodies", {label.partition("/")[0] for label in labels}, bodies)
    _same(file, "joints", labels, joints)
    stored = list(phase_rows(plan))
    _same(file, "phases", stored if stored[1:] else [], names if names[1:] else [])
    sizes = plan.sizes["configuration"], plan.sizes["velocity"]
    if sizes != (model.nq, model.nv):
        raise ScenarioError(
            f"a plan of another scene: {sizes[0]} entries of configuration and {sizes[1]} of velocity, where "
            f"this scene has {model.nq} and {model.nv}",
            source=file,
        )
    motions = []
    for problem, (first, last) in zip(problems, (rows[name] for name in names), strict=True):
        phase_plan = plan.isel(time=slice(first, last + 1))
        # forces may jump at knots, states are continuous
        rises = np.append(np.diff(phase_plan.time.values) > 0, True)
        phase_plan = phase_plan.isel(time=rises)
        stage, times, points = problem.stage, phase_plan.time.values, int(phase_plan.attrs.get("points", 0))
        readable = 3 <= points <= 5 and len(times) >= points and (len(times) - 1) % (points - 1) == 0
        if not (readable and np.isfinite(times).all()):
            raise ScenarioError(
                "not a plan whose motion is known between its points; plan again", source=file
            )
        knots = np.asarray(times - times[0], dtype=float)[:: points - 1]
        q = numbers(phase_plan, "q", ("time", "configuration"))
        v, a = (numbers(phase_plan, name, ("time", "velocity")) for name in ("v", "acceleration"))
        axes = [f"{grip.name}.{axis}" for grip in stage.grips for axis in wrench_axes(stage.scene, grip)]
        w = np.zeros((len(times), len(axes)))
        if axes:
            there = [str(name) for name in phase_plan.grip.values] if "grip" in phase_plan.coords else []
            _same(file, "grasps that hold", [axis for axis in axes if axis in there], axes)
            w = numbers(phase_plan, "grip_wrench", ("time", "grip"))[:, [there.index(axis) for axis in axes]]
        drive, parts = (np.zeros((len(times), one.numel())) for one in (stage.u, stage.s))
        z = np.hstack([q, v, a, drive, w, parts])
        drives = stage.q.numel() + stage.v.numel() + stage.a.numel()
        z[:, drives : drives + stage.u.numel()] = balancing_drives(problem, z)
        mesh = Mesh(tuple(float(knot) for knot in knots / knots[-1]))
        lobatto = Lobatto.of_order(2 * points - 2)
        motions.append(Motion(problem, lobatto, mesh, float(knots[-1]), z).split_forces())
    phased_motion = PhasedMotion(tuple(motions), tuple(np.zeros(link.impulses) for link in solver.links))
    fits = all(
        motion.lobatto.points == solver.lobatto.points
        and one.plan.intervals <= motion.intervals <= solver.plan.max_intervals
        for motion, one in zip(motions, solver.phases, strict=True)
    )
    if not fits:
        phased_motion = phased_motion.on(solver.lobatto, solver.meshes(solver.plan.intervals))
    program = solver.program(solver.request(), phased_motion.meshes)
    multipliers, of_bounds = (
        np.asarray(plan[name].values, dtype=float).ravel() if name in plan.variables else np.empty(0)
        for name in MULTIPLIERS
    )
    complete = fits and (multipliers.size, of_bounds.size) == (program.rows, program.size)
    if not (complete and np.isfinite(multipliers).all() and np.isfinite(of_bounds).all()):
        multipliers = of_bounds = np.empty(0)
    barrier = float(plan.attrs.get("barrier", 0.0))
    solution = Solution(
        phased_motion.unknowns, multipliers, of_bounds, "stored", True, 0, 0.0, 0.0, 1.0, barrier
    )
    return SolveResult((), solution, phased_motion.meshes, np.inf, None, "")


def _same(file: Path, what: str, there: Iterable[str], here: Iterable[str]) -> None:
    """Refuse names that differ between a file and the scene."""
    alone = [
        f"{', '.join(sorted(set(names) - set(other))[:3])} only {where}"
        for names, other, where in ((there, here, "in the file"), (here, there, "in this scene"))
        if set(names) - set(other)
    ]
    if alone:
        raise ScenarioError(f"a plan of another scene: its {what} differ, {', '.join(alone)}", source=file)
