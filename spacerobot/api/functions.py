"""Functions of the public namespace: simulation, planning, Monte Carlo campaigns, comparison of tuning
methods.

The functions import the packages ``optim`` and ``viz``, which depend on ``spacerobot``, when they are called.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from spacerobot.api.options import CampaignOptions, PlanOptions, SearchOptions, journals, search_session
from spacerobot.api.results import CampaignResult, ComparisonResult, PlanResult
from spacerobot.common.files import StrPath
from spacerobot.result import Result
from spacerobot.scene import Scene, to_scene
from spacerobot.simulation import Backend, Progress
from spacerobot.simulation import simulate as _simulate

if TYPE_CHECKING:
    from optim.comparison.compare import Comparison
    from optim.methods.settings import Effort
    from optim.search.session import SearchSession
    from spacerobot.flightcode.controller_library import OnboardController


def simulate(
    scene: Scene | StrPath,
    *,
    backend: Backend = "auto",
    progress: Progress | None = None,
    controller: StrPath | OnboardController | None = None,
) -> Result:
    """Simulate a scene.

    Args:
        scene: Scene from :func:`load_scene`, or the name or file of its scenario.
        backend: ``auto`` (chosen by the estimated time), ``compiled`` or ``interpreted``.
        progress: Callback with a short text, called when a step that may take long begins.
        controller: Shared library built from ``spacerobot export controller``, or a link to such a controller
            on other hardware. It replaces the periodic controllers, estimators and detections. A library runs
            with the rights of this process: load only what you built yourself.

    Returns:
        Result: Signals up to the end, or up to the time of divergence (``result.summary["status"]``).

    Raises:
        CompileError: If a compiled backend is required and there is no compiler.
        DivergedError: If no sample is finite, no step satisfies the tolerance, or a grasp does not close.
        NoPlanError: If model predictive control finds no initial plan.
        ScenarioError: If the scenario's engine cannot simulate it, or its result exceeds the memory.
        SpaceRobotError: If a controller cannot be loaded, or was exported from another scenario.
    """
    return _simulate(to_scene(scene), backend=backend, progress=progress, controller=controller)


def campaign(
    scene: Scene | StrPath,
    folder: StrPath | None = None,
    *,
    gains: Mapping[str, Mapping[str, Any]] | Sequence[str] | None = None,
    samples: int | None = None,
    **options: Unpack[CampaignOptions],
) -> CampaignResult:
    """Run the Monte Carlo campaign of a scene's ``campaign`` section.

    Args:
        scene: A scene whose scenario has a ``campaign`` section, or the scenario's name or file.
        folder: Folder in which finished samples are stored. A second call with the folder of an interrupted
            campaign continues it. A temporary folder, removed with the result, if None.
        gains: Sets of gains to compare: a mapping from their names to changes by dotted path; or a list of
            names of the section's sets, ``scenario`` (the scenario's own gains) and ``NAME=DIR`` (gains of a
            result). The section's sets if None.
        samples: Number of samples in place of the section's; that of a grid follows from its levels.
        **options: See :class:`~spacerobot.api.options.CampaignOptions`.

    Raises:
        ScenarioError: If the section is inconsistent with the scene, a set of gains is unknown, or
            ``samples`` is stated for a grid.
        ResultError: If the folder has other content, is in use or cannot be written.
    """
    from optim.campaign import LocalExecutor, run_campaign
    from optim.campaign.cluster import DaskExecutor
    from optim.campaign.rollouts.gain_sets import gain_sets
    from optim.campaign.sampling.parameter_space import with_samples

    scene = to_scene(scene)
    if samples is not None:
        scene = with_samples(scene, samples)
    sets = gains if gains is None or isinstance(gains, Mapping) else gain_sets(scene, gains)
    temporary = None if folder is not None else tempfile.TemporaryDirectory(prefix="spacerobot-campaign-")
    place = Path(folder) if folder is not None else Path(temporary.name) / "campaign"  # type: ignore[union-attr]
    dask = options.get("dask")
    executor = LocalExecutor(options.get("threads")) if dask is None else DaskExecutor(dask)
    run = run_campaign(scene, place, gains=sets, executor=executor, progress=options.get("progress"))
    return CampaignResult(place, run.evaluator, not run.interrupted, temporary)


def plan(
    scene: Scene | StrPath,
    folder: StrPath | None = None,
    *,
    warm_start: StrPath | None = None,
    sensitivities: Sequence[str] = (),
    **options: Unpack[PlanOptions],
) -> PlanResult:
    """Solve the trajectory optimisation problem of a ``plan`` section and verify the solution by replay.

    Args:
        scene: A scene whose scenario has a ``plan`` section, or the scenario's name or file.
        folder: Folder for ``plan.nc``, ``plan.json`` and ``followed.yaml``, the scenario that follows the
            plan. A second call with the folder of an interrupted search continues it. Nothing is written if
            None.
        warm_start: Folder of an earlier plan, or its ``plan.nc``, as the initial guess.
        sensitivities: Dotted paths of numbers with respect to which the optimal cost is differentiated.
            ``summary["cost_sensitivities"]`` has the derivatives, per unit of the scenario.
        **options: See :class:`~spacerobot.api.options.PlanOptions`.

    Returns:
        PlanResult: Motion, cost and the result of the verification.

    Raises:
        ScenarioError: If the section is inconsistent with the scene, ``warm_start`` is not a plan of such a
            scene, or a path of ``sensitivities`` is not a number.
        NoPlanError: If no feasible motion was found, or the solution fails the verification.
        ResultError: If the folder has other content or cannot be written.
    """
    from optim.planning.search.make_plan import make_plan
    from optim.problem.scenario_numbers import numbers_at
    from spacerobot.result import check_folder

    if folder is not None:
        check_folder(folder, PlanResult.job)
    scene = to_scene(scene)
    numbers_at(scene, sensitivities)  # a wrong path is refused before the search
    planned = make_plan(scene, warm_start=warm_start, folder=journals(folder), **options)
    result = PlanResult.of(planned, sensitivities)
    return result if folder is None else result.save(folder)


def compare(
    scene: Scene | StrPath,
    folder: StrPath | None = None,
    *,
    methods: Sequence[str] | None = None,
    variants: Sequence[str] | None = None,
    sets: Sequence[str] | None = None,
    effort: Effort | Mapping[str, int | None] | None = None,
    **options: Unpack[SearchOptions],
) -> ComparisonResult:
    """Compare tuning methods on the problems of a scene's ``tuning`` section.

    Args:
        scene: A scene whose scenario has a ``tuning`` section, or the scenario's name or file.
        folder: Folder for ``comparison.json``, ``comparison.md``, figures, the best design of each method,
            and journals from which an interrupted comparison continues. Nothing is written if None.
        methods, variants, sets: Names of methods, variants and sets of variables; all of the section if None.
        effort: Numbers of evaluations, runs and starts; or ``budget``, ``runs``, ``starts`` and ``seed`` by
            name, which replace those of the section. Without a budget, that of each run is the section's
            ``budget`` if ``full`` is true, otherwise its ``baseline_budget`` if that is smaller.
        **options: See :class:`~spacerobot.api.options.SearchOptions`.

    Raises:
        ScenarioError: If there is no tuning section, or it lacks a named method, variant or set.
        ResultError: If the folder has other content or cannot be written.
    """
    from optim.comparison.compare import compare as run

    session = _comparison_session(folder, options)
    comparison = run(
        to_scene(scene),
        methods=methods,
        variants=variants,
        sets=sets,
        effort=effort,
        session=session,
    )
    return _compared(comparison, folder, options)


def compare_suite(
    folder: StrPath | None = None,
    *,
    problems: Sequence[str] | None = None,
    methods: Sequence[str] | None = None,
    effort: Mapping[str, int | None] | None = None,
    **options: Unpack[SearchOptions],
) -> ComparisonResult:
    """Compare tuning methods on the shipped benchmark problems.

    Args:
        folder: As for :func:`compare`.
        problems, methods: Names of problems and methods; all problems and the suite's methods if None.
        effort: Values that replace the suite's ``budget``, ``runs``, ``starts`` and ``seed``; those that are
            missing or None stay.
        **options: See :class:`~spacerobot.api.options.SearchOptions`.

    Raises:
        SpaceRobotError: If a problem is unknown.
        ResultError: If the folder has other content or cannot be written.
    """
    from optim.comparison.suite import compare_suite as run

    session = _comparison_session(folder, options)
    return _compared(run(problems, methods=methods, effort=effort, session=session), folder, options)


def _comparison_session(folder: StrPath | None, options: SearchOptions) -> SearchSession:
    """Search session of a comparison, after a check of its output folder."""
    from spacerobot.result import check_folder

    if folder is not None:
        check_folder(folder, ComparisonResult.job)
    return search_session(folder, options)


def _compared(comparison: Comparison, folder: StrPath | None, options: SearchOptions) -> ComparisonResult:
    """Result of a comparison; with a folder, it is written together with a document and figures."""
    result = ComparisonResult.of(comparison)
    if folder is None:
        return result
    from optim.comparison.tables import markdown
    from spacerobot.common.files import write_text
    from viz.figures.comparison import write_figures

    notify = options.get("notify") or (lambda _: None)
    notify("simulating and saving the best designs")
    result = result.save(folder)
    write_text(Path(folder) / "comparison.md", markdown(result.summary))
    notify("drawing")
    write_figures(result.summary, Path(folder))
    return result
