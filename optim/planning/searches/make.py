"""A plan from beginning to end: formulated, solved from several starts, refined, judged."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.polynomial import Polynomial

from optim.planning.searches.bench import Ask, Attempt, Bench, Solve
from optim.planning.searches.choices import Tried, best_of
from optim.planning.searches.kept import Kept
from optim.planning.searches.tasks import Task, carry_out
from optim.planning.searches.warm_start import stored_motion
from optim.planning.solver.solve import Solved
from optim.planning.transcription.motion import Course, Motion
from optim.planning.verification.verdict import Verdict
from spacerobot.errors import NoPlanError
from spacerobot.files import StrPath
from spacerobot.scene import Scene

Progress = Callable[[str], None]
PLAN = "plan"
"""Name of the task that ends with the plan."""


@dataclass(frozen=True, eq=False)
class Planned:
    """A motion, what was done for it, and what is to be thought of it.

    Attributes
    ----------
    scene, course
        The scene and its motion, in one phase or several.
    names
        Of the scenario's phases; one of no name where the plan tells no phases.
    cost, terms
        Cost, and its parts by name.
    solves
        Every run of the solver, in turn.
    solved
        Where the solver ended, with its multipliers.
    verdict
        On the motion.
    backend
        ``compiled`` or ``interpreted``: what evaluated the problem's functions.
    tried
        Candidates among which the plan chose, where it had a choice; its scene has what was chosen.
    pairs, kept_apart
        How many pairs of links were checked for collisions, and the names of those for which the plan was
        made again with a keep-out zone, which its scene has.
    """

    scene: Scene
    course: Course
    names: tuple[str, ...]
    cost: float
    terms: Mapping[str, float]
    solves: tuple[Solve, ...]
    solved: Solved
    verdict: Verdict
    backend: str
    tried: tuple[Tried, ...] = ()
    pairs: int = 0
    kept_apart: tuple[tuple[str, str], ...] = ()

    def __repr__(self) -> str:
        """Scenario, duration and cost, in one line."""
        duration = f"{self.course.duration_s:.4g} s"
        return f"<Planned {self.scene.scenario.name}: {duration}, cost {self.cost:.6g}, {self.backend}>"

    @property
    def motion(self) -> Motion:
        """The motion in the first phase."""
        return self.course.motions[0]


def make_plan(
    scene: Scene,
    *,
    backend: str = "auto",
    progress: Progress | None = None,
    folder: StrPath | None = None,
    dask: str | None = None,
    warm_start: StrPath | None = None,
) -> Planned:
    """Plan what a scene's ``plan`` section asks for.

    Parameters
    ----------
    scene
        The scene.
    backend
        ``auto``, ``compiled`` or ``interpreted``.
    progress
        Called with a few words whenever something that may take a while begins.
    folder
        Where searches are kept as they end, so that a killed plan goes on where it was; nowhere if None.
    dask
        Address of a cluster, as for :func:`optim.workers.cluster.connect`, whose workers search from several
        starts at once; this process alone if None. No number but times depends on it.
    warm_start
        A plan's folder, or its ``plan.nc``, whose motion is the first guess of the first start, with its
        multipliers where they fit; see :func:`optim.planning.searches.warm_start.stored_motion`.

    Raises
    ------
    ScenarioError
        If the section asks for what cannot be, or ``warm_start`` is no plan of such a scene.
    NoPlanError
        If no motion was found, naming what stands against it, or the one found does not hold.
    """
    folder = None if folder is None else Path(folder)

    def of(each: Scene, words: str) -> tuple[float, Planned]:
        """Plan of one candidate, and its cost."""
        tell = progress or (lambda _: None)
        bench = Bench.of(each, backend, (lambda text: tell(f"{words}: {text}")) if words else tell)
        near = None if warm_start is None else stored_motion(bench, Path(warm_start))
        tasks = plan_tasks(bench, bench.asked(near=near))
        found = carry_out(bench, tasks, kept_in(folder, bench), dask)
        fault = fault_of(found[PLAN], bench.plan.starts)
        if fault is not None:
            raise NoPlanError(fault, source=scene.source, where="plan")
        plan = planned(bench, bench.asked(), found)
        return plan.cost, plan

    best, tried = best_of(scene, of)
    return dataclasses.replace(best, tried=tried)


def plan_tasks(bench: Bench, ask: Ask, name: str = PLAN) -> dict[str, Task]:
    """Searches from every start on the first mesh, and the one, so named, that refines the best of them.

    A motion that is asked to be begun with is the first start's.
    """
    starts = tuple(f"{name}, start {k + 1}" for k in range(bench.plan.starts))
    tasks = {
        start: Task(
            lambda _, k=k: dataclasses.replace(  # type: ignore[misc]
                ask, start=k, near=None if k else ask.near, refine=False
            )
        )
        for k, start in enumerate(starts)
    }

    def best(found: Mapping[str, Attempt]) -> Ask:
        """Refine the start that ended best."""
        k = min(range(len(starts)), key=lambda k: found[starts[k]].cost)
        return dataclasses.replace(ask, start=k, near=found[starts[k]], solved=True)

    return tasks | {name: Task(best, starts)}


def kept_in(folder: Path | None, bench: Bench) -> Kept:
    """Where attempts of a problem are kept."""
    return Kept(folder, bench.recipe.key)


def fault_of(attempt: Attempt, starts: int = 1) -> str | None:
    """Why there is no plan; None if there is one."""
    names = ", ".join(dict.fromkeys(f"{one.first} and {one.second}" for one in attempt.apart))
    told = f"; `collision_avoidance` keeps apart {names}" if names else ""
    if attempt.solved is None:
        many = f" from {starts} starts" if starts > 1 else ""
        return f"no plan was found{many}: {attempt.blame}{told}"
    assert attempt.verdict is not None
    faults = attempt.verdict.faults()
    if faults and attempt.blame:
        faults.append(attempt.blame)
    return f"the plan is refused: {'; '.join(faults)}{told}" if faults else None


def planned(bench: Bench, ask: Ask, found: Mapping[str, Attempt], name: str = PLAN) -> Planned:
    """The plan that a task ended with."""
    attempt = found[name]
    assert attempt.verdict is not None
    assert attempt.solved is not None
    course = bench.course(ask, attempt)
    terms, bench = _terms(course), bench.keeping_apart(attempt.apart)
    solves = [one for task, a in found.items() if task.startswith(f"{name}, start") for one in a.solves]
    return Planned(
        bench.scene,
        course,
        (bench.name, *(one.name for one in bench.later))
        if bench.later
        else (bench.name,) * len(course.motions),
        sum(terms.values()),
        terms,
        (*solves, *attempt.solves),
        attempt.solved,
        attempt.verdict,
        bench.instants.backend,
        pairs=len(bench.pairs),
        kept_apart=tuple(dict.fromkeys((one.first, one.second) for one in attempt.apart)),
    )


def _terms(course: Course) -> dict[str, float]:
    """Parts of the cost by name, of all phases."""
    found: dict[str, float] = {}
    for motion in course.motions:
        for name, value in integrals(motion).items():
            found[name] = found.get(name, 0.0) + motion.problem.weights[name] * value
    return found


def integrals(motion: Motion) -> dict[str, float]:
    """Integrals over the motion of the terms of the cost, what its end costs, and the duration, without their
    weights; magnitudes that the search rounds off as they are.
    """
    problem = motion.problem
    found: dict[str, float] = {}
    weights = motion.lobatto.quadrature(motion.mesh)
    for name, term in problem.terms.items():
        values = ca.Function("term", [problem.stage.z], [ca.densify(term)])(motion.z.T).full()
        found[name] = float(weights @ np.array(values).ravel()) * motion.duration_s
    for name, forces in problem.magnitudes.items():  # smooth in the search, which is less than they are
        found[name] = integral_of_magnitudes(motion, forces)
    for name, end in problem.ends.items():
        found[name] = float(ca.Function("end", [problem.stage.z], [end])(motion.z[-1]))
    return found | ({"time": motion.duration_s} if problem.time_weight else {})


def integral_of_magnitudes(motion: Motion, forces: ca.SX) -> float:
    """Integral of the magnitudes of driving forces [N s].

    Forces are polynomials in each interval: between their roots the magnitude's integral is exact.

    Parameters
    ----------
    motion
        The motion.
    forces
        Expression in its instants, linear in what drives it (n x 1) [N].
    """
    lobatto, found = motion.lobatto, 0.0
    drive = np.array(ca.Function("forces", [motion.problem.stage.z], [ca.densify(forces)])(motion.z.T).full())
    for n, width in enumerate(motion.mesh.widths):
        inside = slice(n * (lobatto.points - 1), (n + 1) * (lobatto.points - 1) + 1)
        for values in drive[:, inside]:
            force = Polynomial(np.transpose(lobatto.basis) @ values)
            roots = force.roots()
            ends = np.unique([*np.clip(roots[np.abs(roots.imag) < 1e-09].real, 0, 1).tolist(), 0.0, 1.0])
            found += width * float(np.abs(np.diff(force.integ()(ends))).sum())
    return float(found * motion.duration_s)


def statistics(planned: Planned) -> list[dict[str, Any]]:
    """What each run of the solver took, plain."""
    return [dict(vars(one)) for one in planned.solves]
