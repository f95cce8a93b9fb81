"""A planning problem on the bench; what is asked of a search, and what it leaves, as plain data."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

from optim.planning.early import check_momentum, check_reach, check_start
from optim.planning.formulate import formulate, plan_of
from optim.planning.functions import Instants, build_instants
from optim.planning.lobatto import Lobatto
from optim.planning.motion import Motion
from optim.planning.solve import Solved
from optim.planning.stage import Problem
from optim.planning.verdict import Verdict
from optim.problem.scenes import SceneRecipe
from spacerobot.scenario.plan import Planning
from spacerobot.scene import Scene

Tell = Callable[[str], None]

ITERATIONS = 50
"""Of one solve, about, with its refinement."""
COMPILED = 30_000
"""Instants from which on it takes less time to compile a problem's functions than to interpret them."""


@dataclass(frozen=True)
class Solve:
    """One run of the solver.

    Attributes
    ----------
    start, intervals
        Which start it came from, and its mesh.
    cost, status, converged
        Where it ended, the solver's word for it, and whether it is a solution.
    iterations, evaluations_s, seconds
        Its steps, time [s] spent in the problem's functions and altogether.
    costs, violations
        Cost, and greatest violation of a constraint, at each iteration.
    """

    start: int
    intervals: int
    cost: float
    status: str
    converged: bool
    iterations: int
    evaluations_s: float
    seconds: float
    costs: tuple[float, ...]
    violations: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Attempt:
    """What a search leaves.

    Attributes
    ----------
    solves
        Every run of the solver, in turn.
    solved, intervals, cost
        The best solution, its mesh and its cost; None where there is none.
    verdict
        On it, where it was refined.
    blame
        What stands against a solution, where there is none.
    """

    solves: tuple[Solve, ...]
    solved: Solved | None
    intervals: int
    cost: float
    verdict: Verdict | None
    blame: str


@dataclass(frozen=True, eq=False)
class Ask:
    """What is asked of a search.

    Attributes
    ----------
    duration
        Least, greatest and first guess of the duration [s].
    weights
        Of the terms of the cost, and of ``time``.
    start
        Which first guess it begins with, where it begins with no motion.
    near
        Attempt of the same bench whose motion is begun with.
    solved
        Whether that is a solution of what is asked for, which is left to be refined.
    refine
        Whether the mesh is refined until the verdict is good.
    """

    duration: tuple[float, float, float]
    weights: Mapping[str, float]
    start: int = 0
    near: Attempt | None = None
    solved: bool = False
    refine: bool = True

    @property
    def key(self) -> str:
        """Hash of it."""
        plain = [self.duration, dict(self.weights), self.start, self.solved, self.refine]
        digest = hashlib.sha256(json.dumps(plain, sort_keys=True).encode())
        if self.near is not None and self.near.solved is not None:
            digest.update(self.near.solved.w.tobytes() + str(self.near.intervals).encode())
        return digest.hexdigest()


@dataclass(frozen=True)
class Recipe:
    """What builds a bench in another process.

    Attributes
    ----------
    scene
        The scene, its plan section in it.
    backend
        ``auto``, ``compiled`` or ``interpreted``.
    """

    scene: SceneRecipe
    backend: str

    @property
    def key(self) -> str:
        """Hash of it."""
        text = json.dumps(dataclasses.asdict(self), sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()

    def build(self) -> Bench:
        """The bench."""
        return Bench.of(self.scene.build(), self.backend)


@dataclass(frozen=True, eq=False)
class Bench:
    """A planning problem ready to be solved, for any limits of its duration and any weights.

    Attributes
    ----------
    scene, plan, problem, instants, lobatto, backend
        The scene, its section, the problem, its functions, the collocation, and what evaluates it.
    tell
        Told in a few words what begins.
    """

    scene: Scene
    plan: Planning
    problem: Problem
    instants: Instants
    lobatto: Lobatto
    backend: str
    tell: Tell = field(default=lambda _: None)

    @classmethod
    def of(
        cls, scene: Scene, backend: str = "auto", tell: Tell = lambda _: None, *, motions: int = 1
    ) -> Bench:
        """The bench of a scene.

        Parameters
        ----------
        scene
            With a ``plan`` section.
        backend
            ``auto``, ``compiled`` or ``interpreted``; ``auto`` compiles where so much is solved that it pays.
        tell
            Told in a few words what begins.
        motions
            How many are to be planned, each from all starts.

        Raises
        ------
        ScenarioError
            If its plan section asks for what cannot be.
        """
        plan, problem = plan_of(scene), formulate(scene)
        check_start(problem)
        check_momentum(problem, plan)
        check_reach(problem, plan, {tip.label: tip for tip in scene.tips})
        instants_in_all = motions * plan.starts * plan.intervals * plan.order // 2 * ITERATIONS
        if backend == "auto" and instants_in_all < COMPILED:
            backend = "interpreted"
        compiling = backend != "interpreted"
        tell(
            "compiling the problem's functions, or finding them compiled" if compiling else "differentiating"
        )
        instants = build_instants(problem, backend)
        return cls(scene, plan, problem, instants, Lobatto.of_order(plan.order), backend, tell)

    @property
    def recipe(self) -> Recipe:
        """What builds it in another process."""
        return Recipe(SceneRecipe.of(self.scene), self.backend)

    @cached_property
    def exact(self) -> Instants:
        """The problem's functions by CasADi, to judge by."""
        return (
            self.instants
            if self.instants.backend == "interpreted"
            else build_instants(self.problem, "interpreted")
        )

    def asked(self, **changes: object) -> Ask:
        """What the section asks for."""
        ask = Ask(self.problem.duration, self.problem.weights)
        return dataclasses.replace(ask, **changes)  # type: ignore[arg-type]

    def problem_of(self, ask: Ask) -> Problem:
        """The problem with the duration and weights that are asked for."""
        return dataclasses.replace(self.problem, duration=ask.duration, weights=ask.weights)

    def motion(self, ask: Ask, attempt: Attempt) -> Motion:
        """The motion of a solution."""
        assert attempt.solved is not None
        problem, solved = self.problem_of(ask), attempt.solved
        z = solved.w[:-1].reshape(-1, problem.stage.z.numel())
        return Motion(problem, self.lobatto, attempt.intervals, float(solved.w[-1]), z)
