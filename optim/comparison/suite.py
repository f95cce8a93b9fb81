"""The benchmark suite: tuning problems of many kinds, defined in ``suite.yaml``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from optim.comparison.benchmark_problem import BenchmarkProblem
from optim.comparison.compare import Comparison, compete, even_effort
from optim.comparison.suite_file import check_problems, read_suite
from optim.methods.settings import Effort
from optim.problem.scene_recipe import tuning_of
from optim.problem.tuning_problem import build_problem
from optim.robust.problem import Statistic, build_robust
from optim.search.session import SearchSession
from spacerobot.scenario.load import validate
from spacerobot.scene import Scene, build_scene, load_scene

NAME = "suite"
Plain = Mapping[str, Any]


def compare_suite(
    problems: Sequence[str] | None = None,
    *,
    methods: Sequence[str] | None = None,
    effort: Mapping[str, int | None] | None = None,
    session: SearchSession | None = None,
) -> Comparison:
    """Run methods on the problems of the suite.

    Args:
        problems: Names of the problems; all if None.
        methods: Names of the methods; the suite's if None.
        effort: ``budget``, ``runs``, ``starts`` and ``seed`` that replace the suite's; None keeps one.
        session: Workers, journals and callbacks; None uses threads of this process and no journals.

    Raises:
        SpaceRobotError: If there is no such problem.
    """
    suite, session = read_suite(), session or SearchSession()
    check_problems(problems or ())
    chosen = list(problems or suite["problems"])
    entries = _made(suite, chosen, methods or suite["methods"], dict(effort or {}), session)
    return compete(NAME, entries, session)


def scene_of(suite: Plain, name: str) -> Scene:
    """The scene of a problem, with its tuning section.

    Args:
        suite: Data of :func:`read_suite`.
        name: Name of the problem.
    """
    benchmark = suite["problems"][name]
    scenario_document = suite["scenes"].get(benchmark["scene"])
    variables = {variable: suite["variables"][variable] for variable in benchmark["tune"]}
    tuning = {"variables": variables, **suite["effort"], **benchmark["tuning"]}
    changes = {**benchmark.get("changes", {}), "tuning": tuning}
    if scenario_document is None:
        return load_scene(benchmark["scene"], changes)
    return build_scene(validate(dict(scenario_document), source="suite.yaml"), changes, source=None)


def _made(
    suite: Plain,
    chosen: Sequence[str],
    methods: Sequence[str],
    effort: Mapping[str, int | None],
    session: SearchSession,
) -> Iterator[tuple[BenchmarkProblem, Sequence[str], Effort]]:
    """Each problem, built when its turn comes."""
    for name in chosen:
        session.tell(f"{name}: building the closed loop")
        scene, robust = scene_of(suite, name), suite["problems"][name].get("robust")
        if robust is None:
            problem = build_problem(scene, workers=session.workers)
            entry = BenchmarkProblem(name, problem, problem)
        else:
            several = build_robust(scene, Statistic(**robust), workers=session.workers)
            entry = BenchmarkProblem(name, several, several.nominal)
        yield entry, methods, even_effort(tuning_of(scene), effort)
