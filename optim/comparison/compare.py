"""Tuning methods compared on the problems of a scenario."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from optim.comparison.benchmark_problem import BenchmarkProblem, ProblemComparison, compare_on_problem
from optim.comparison.design_evaluator import build_design_evaluator
from optim.methods.settings import Effort, effort_of
from optim.problem.scene_recipe import check_choices, tuning_of
from optim.problem.tuning_problem import build_problem
from optim.search.session import SearchSession
from spacerobot.common.registry import TUNING_METHODS
from spacerobot.scenario import Tuning
from spacerobot.scene import Scene
from spacerobot.scene.memory import check_size


@dataclass(frozen=True)
class Comparison:
    """Tuning methods compared on several benchmark problems.

    Attributes:
        name: Name of the scenario, or of the suite.
        problems: Comparison on each problem.
        wall_s: Elapsed time [s].
        interrupted: Whether it was stopped before its end.
    """

    name: str
    problems: tuple[ProblemComparison, ...]
    wall_s: float
    interrupted: bool = False

    def __repr__(self) -> str:
        """Name and problems, in one line."""
        return f"<Comparison {self.name}: {', '.join(benchmark.name for benchmark in self.problems)}>"


def compare(
    scene: Scene,
    *,
    methods: Sequence[str] | None = None,
    variants: Sequence[str] | None = None,
    sets: Sequence[str] | None = None,
    effort: Effort | Mapping[str, int | None] | None = None,
    session: SearchSession | None = None,
) -> Comparison:
    """Run methods on the problems of a scene's tuning section.

    Args:
        scene: The scene.
        methods, variants, sets: Names of methods, variants and sets of variables; all that the section names
            if None.
        effort: Budget of the methods; or changes of the section's, as for :func:`even_effort`.
        session: Workers, journals and callbacks; None uses threads of this process and no journals.

    Returns:
        Comparison: One problem for each variant and set of variables; after Ctrl-C, the results so far.

    Raises:
        ScenarioError: If there is no tuning section, it has no such variant or set of variables, or the
            result of a design does not fit into memory.
    """
    tuning, session = tuning_of(scene), session or SearchSession()
    check_size(scene)
    if not isinstance(effort, Effort):
        effort = even_effort(tuning, effort)
    check_choices(scene, sets=sets or (), variants=variants or ())
    chosen = [
        (variant, name)
        for variant in [*(variants or tuning.variants)] or [None]
        for name in [*(sets or tuning.sets)] or [None]
    ]
    method_names = methods or tuning.methods or tuple(TUNING_METHODS.entries())
    return compete(
        scene.scenario.name, ((e, method_names, effort) for e in _entries(scene, chosen, session)), session
    )


def even_effort(tuning: Tuning, changes: Mapping[str, int | None] | None = None) -> Effort:
    """Effort with the same budget for the GA and the other evolutionary methods.

    Args:
        tuning: Tuning section.
        changes: ``budget``, ``runs``, ``starts`` and ``seed`` that replace the section's; None keeps one.
            Without a budget, that of each run is the section's ``budget`` if ``full`` is true, otherwise its
            ``baseline_budget`` if that is smaller.
    """
    budgets = dict(changes or {})
    full = budgets.pop("full", False)
    budget = budgets.get("budget") or (tuning.budget if full else min(tuning.budget, tuning.baseline_budget))
    return effort_of(tuning, **(budgets | {"budget": budget, "baseline_budget": budget}))


def compete(
    name: str, problems: Iterable[tuple[BenchmarkProblem, Sequence[str], Effort]], session: SearchSession
) -> Comparison:
    """Compare methods on several problems in turn.

    Args:
        name: Name of the comparison.
        problems: Problem, methods and effort of each comparison; a generator builds them one at a time.
        session: Workers, journals and callbacks.
    """
    begin, comparisons = time.perf_counter(), list[ProblemComparison]()
    for entry, methods, effort in problems:
        comparisons.append(compare_on_problem(entry, methods, effort, session))
        if comparisons[-1].interrupted:
            return Comparison(name, tuple(comparisons), time.perf_counter() - begin, True)
    return Comparison(name, tuple(comparisons), time.perf_counter() - begin)


def _entries(
    scene: Scene, chosen: Sequence[tuple[str | None, str | None]], session: SearchSession
) -> Iterable[BenchmarkProblem]:
    tuning, judge, judged = tuning_of(scene), None, object()
    for variant, name in chosen:
        if judge is None or judged != variant:
            session.tell(f"{variant or 'tuning'}: building the closed loop that evaluates designs")
            judge, judged = (
                build_design_evaluator(scene, variant=variant, threads=session.workers.threads),
                variant,
            )
        session.tell(f"{variant or 'tuning'}, {name or 'all variables'}: building the closed loop")
        variables = tuning.sets[name] if name is not None else None
        problem = build_problem(scene, variables=variables, variant=variant, workers=session.workers)
        title = "-".join(part for part in (variant, name) if part) or "tuning"
        yield BenchmarkProblem(title, problem, problem, judge)
