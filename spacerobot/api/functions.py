"""One call for each job: simulate, plan, run a campaign, compare tuning methods.

These functions are the public namespace (``import spacerobot as sr``). They join the library with the
packages ``optim`` and ``viz``, which are built on it, and import those when they are called.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from spacerobot.api.options import PlanOptions, SearchOptions, journals, search_session
from spacerobot.api.results import CampaignResult, ComparisonResult, PlanResult
from spacerobot.common.files import StrPath
from spacerobot.result import Result
from spacerobot.scene import Scene, to_scene
from spacerobot.simulation import Backend, Progress
from spacerobot.simulation import simulate as _simulate

if TYPE_CHECKING:
    from optim.campaign import CampaignProgress
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
    """Simulate a scene; controllers with a Python update, such as ``mpc``, are updated on the way.

    Args:
        scene: From :func:`load_scene`, or the name or file of its scenario.
        backend: ``auto`` (compiled where a compiler is found), ``compiled`` or ``interpreted``.
        progress: Called with a few words whenever a step that may take a while begins.
        controller: Shared library built from ``spacerobot export controller``, which then takes the place of
            the periodic controllers, estimators and detections; or such a controller behind a link. A library
            runs with the rights of this process: load only what you built yourself.

    Returns:
        Result: Also of a simulation that diverged, up to that time; ``result.summary["status"]`` says so.

    Raises:
        CompileError: If a compiled backend is required and cannot be had.
        DivergedError: If there is no finite sample at all, no step keeps to the tolerance, or a grasp does
            not close.
        NoPlanError: If model predictive control finds no first plan.
        ScenarioError: If the scenario cannot be simulated by its engine, or its result does not fit into the
            memory.
        SpaceRobotError: If a controller cannot be loaded, or was exported from another scenario.
    """
    return _simulate(to_scene(scene), backend=backend, progress=progress, controller=controller)


def campaign(
    scene: Scene | StrPath,
    folder: StrPath | None = None,
    *,
    gains: Mapping[str, Mapping[str, Any]] | Sequence[str] | None = None,
    progress: Callable[[CampaignProgress], object] | None = None,
    threads: int | None = None,
    dask: str | None = None,
) -> CampaignResult:
    """Run the Monte Carlo campaign of a scene's ``campaign`` section.

    Args:
        scene: A scene whose scenario has a ``campaign`` section, or the scenario's name or file.
        folder: Folder in which samples are stored as they end, so that an interrupted campaign continues when
            it is called again; a temporary folder, removed with the result, if None.
        gains: Sets of gains to compare: changes by dotted path, by name; or names of the section's sets,
            ``scenario`` for the scenario's own gains, and ``NAME=DIR`` for those of a result. The section's
            sets if None.
        progress: Called when a phase begins and after every chunk.
        threads: Number of threads; one for each usable core if None. Results do not depend on it.
        dask: Address of a Dask cluster that rolls out, as ``local:4``; this process if None. Results do not
            depend on it.

    Raises:
        ScenarioError: If the section does not fit the scene, or there is no such set of gains.
        ResultError: If the folder holds something else, is in use or cannot be written.
    """
    from optim.campaign import LocalExecutor, run_campaign
    from optim.campaign.cluster import DaskExecutor
    from optim.campaign.rollouts.gain_sets import gain_sets

    scene = to_scene(scene)
    sets = gains if gains is None or isinstance(gains, Mapping) else gain_sets(scene, gains)
    temporary = None if folder is not None else tempfile.TemporaryDirectory(prefix="spacerobot-campaign-")
    place = Path(folder) if folder is not None else Path(temporary.name) / "campaign"  # type: ignore[union-attr]
    executor = LocalExecutor(threads) if dask is None else DaskExecutor(dask)
    run = run_campaign(scene, place, gains=sets, executor=executor, progress=progress)
    return CampaignResult(place, run.evaluator, not run.interrupted, temporary)


def plan(
    scene: Scene | StrPath,
    folder: StrPath | None = None,
    *,
    warm_start: StrPath | None = None,
    sensitivities: Sequence[str] = (),
    **options: Unpack[PlanOptions],
) -> PlanResult:
    """Solve the trajectory optimisation problem of a ``plan`` section, and verify the solution by replay.

    Args:
        scene: A scene whose scenario has a ``plan`` section, or the scenario's name or file.
        folder: Folder for ``plan.nc``, ``plan.json`` and ``followed.yaml``, the scenario that follows the
            plan; an interrupted search continues there. Nothing is written if None.
        warm_start: Folder of an earlier plan, or its ``plan.nc``, as the first guess.
        sensitivities: Dotted paths of the scenario's numbers by which the optimal cost is differentiated,
            without planning again; ``summary["cost_sensitivities"]`` has the derivatives, per unit of the
            scenario.
        **options: See :class:`~spacerobot.api.options.PlanOptions`.

    Returns:
        PlanResult: Motion, cost and the result of the verification.

    Raises:
        ScenarioError: If the section does not fit the scene, ``warm_start`` is no plan of such a scene, or
            there is no number by which to differentiate.
        NoPlanError: If no feasible motion was found, or the solution fails the verification.
        ResultError: If the folder holds something else or cannot be written.
    """
    from optim.planning.output.plan_folder import SUMMARY
    from optim.planning.search.make_plan import make_plan
    from spacerobot.result import check_folder

    if folder is not None:
        check_folder(folder, SUMMARY)
    planned = make_plan(to_scene(scene), warm_start=warm_start, folder=journals(folder), **options)
    result = PlanResult.of(planned, sensitivities)
    return result if folder is None else result.save(folder)


def compare(
    scene: Scene | StrPath,
    folder: StrPath | None = None,
    *,
    methods: Sequence[str] | None = None,
    variants: Sequence[str] | None = None,
    sets: Sequence[str] | None = None,
    effort: Effort | None = None,
    **options: Unpack[SearchOptions],
) -> ComparisonResult:
    """Compare tuning methods on the problems of a scene's ``tuning`` section.

    Args:
        scene: A scene whose scenario has a ``tuning`` section, or the scenario's name or file.
        folder: Folder of the journals, so that an interrupted comparison continues, of ``comparison.json``,
            ``comparison.md``, figures and each method's best design; nothing is written if None.
        methods, variants, sets: Names of methods, variants and sets of variables; all that the section names
            if None.
        effort: Budget of the methods; the same for each if None.
        **options: See :class:`~spacerobot.api.options.SearchOptions`.

    Raises:
        ScenarioError: If there is no tuning section, or it does not have what is named.
        ResultError: If the folder holds something else or cannot be written.
    """
    from optim.comparison.compare import compare as run

    session = _comparison_session(folder, options)
    comparison = run(
        to_scene(scene), methods=methods, variants=variants, sets=sets, effort=effort, session=session
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
    """Compare tuning methods on the benchmark problems that ship.

    Args:
        folder: As of :func:`compare`.
        problems, methods: Names of problems and methods; all problems and the suite's methods if None.
        effort: ``budget``, ``runs``, ``starts`` and ``seed`` in place of the suite's; None leaves one.
        **options: See :class:`~spacerobot.api.options.SearchOptions`.

    Raises:
        SpaceRobotError: If there is no such problem.
        ResultError: If the folder holds something else or cannot be written.
    """
    from optim.comparison.suite import compare_suite as run

    session = _comparison_session(folder, options)
    return _compared(run(problems, methods=methods, effort=effort, session=session), folder, options)


def _comparison_session(folder: StrPath | None, options: SearchOptions) -> SearchSession:
    """Session of a comparison whose output folder is free for one."""
    from spacerobot.result import check_folder

    if folder is not None:
        check_folder(folder, "comparison.json")
    return search_session(folder, options)


def _compared(comparison: Comparison, folder: StrPath | None, options: SearchOptions) -> ComparisonResult:
    """Result of a comparison, written with its document and figures if there is a folder."""
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
