"""One call for each job: simulate, differentiate, tune, plan, run a campaign, draw, animate, report.

These functions are the public namespace (``import spacerobot as sr``). They join the library with the
packages ``optim`` and ``viz``, which are built on it, and import those when they are called.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spacerobot.api.results import CampaignResult, ComparisonResult, PlanResult
from spacerobot.files import StrPath
from spacerobot.result import Result
from spacerobot.scene import Scene, to_scene
from spacerobot.simulation import Backend, Progress
from spacerobot.simulation import simulate as _simulate

if TYPE_CHECKING:
    from optim.methods.settings import Effort
    from viz.figures import Drawing
    from viz.page.notebook import EmbeddedPage

Results = Result | Sequence[Result]


def simulate(
    scene: Scene | StrPath, *, backend: Backend = "auto", progress: Progress | None = None
) -> Result:
    """Simulate a scene; with model predictive control if a controller is of kind ``mpc``.

    Parameters
    ----------
    scene
        From :func:`load_scene`, or the name or file of its scenario.
    backend
        ``auto`` (compiled where a compiler is found), ``compiled`` or ``interpreted``.
    progress
        Called with a few words whenever a step that may take a while begins.

    Returns
    -------
    Result
        Also of a simulation that diverged, up to that time; ``result.summary["status"]`` says so.

    Raises
    ------
    CompileError
        If a compiled backend is required and cannot be had.
    DivergedError
        If there is no finite sample at all, no step keeps to the tolerance, or a grasp does not close.
    NoPlanError
        If model predictive control finds no first plan.
    ScenarioError
        If the scenario cannot be simulated by its engine, or its result does not fit into the memory.
    """
    scene = to_scene(scene)
    controllers = [one for robot in scene.scenario.robots.values() for one in robot.controllers.values()]
    if any(one.replanning is not None for one in controllers):
        from optim.planning.mpc.simulation import simulate_mpc

        return simulate_mpc(scene, backend=backend, progress=progress)
    return _simulate(scene, backend=backend, progress=progress)


def campaign(
    scene: Scene | StrPath,
    folder: StrPath | None = None,
    *,
    gains: Mapping[str, Mapping[str, Any]] | None = None,
    progress: Callable[[Any], object] | None = None,
) -> CampaignResult:
    """Run the Monte Carlo campaign of a scene's ``campaign`` section.

    Parameters
    ----------
    scene
        A scene whose scenario has a ``campaign`` section, or the scenario's name or file.
    folder
        Where samples are stored as they end, so that an interrupted campaign continues when it is called
        again; a temporary folder, removed with the result, if None.
    gains
        Sets of gains to compare, changes by dotted path by name; the section's if None.
    progress
        Called with an :class:`optim.campaign.Progress` when a phase begins and after every chunk.

    Raises
    ------
    ScenarioError
        If the section does not fit the scene.
    ResultError
        If the folder holds something else, is in use or cannot be written.
    """
    from optim.campaign import run_campaign

    kept = None if folder is not None else tempfile.TemporaryDirectory(prefix="spacerobot-campaign-")
    place = Path(folder) if folder is not None else Path(kept.name) / "campaign"  # type: ignore[union-attr]
    done = run_campaign(to_scene(scene), place, gains=gains, progress=progress)
    return CampaignResult(place, done.evaluator, not done.interrupted, kept)


def plan(
    scene: Scene | StrPath,
    folder: StrPath | None = None,
    *,
    warm_start: StrPath | None = None,
    backend: Backend = "auto",
    progress: Progress | None = None,
) -> PlanResult:
    """Solve the trajectory optimisation problem of a ``plan`` section, and verify the solution by replay.

    Parameters
    ----------
    scene
        A scene whose scenario has a ``plan`` section, or the scenario's name or file.
    folder
        Where ``plan.nc``, ``plan.json`` and ``followed.yaml``, the scenario that follows the plan, are
        written; nothing is written if None.
    warm_start
        Folder of an earlier plan, or its ``plan.nc``, as the first guess.
    backend
        ``auto`` (compiled where that pays), ``compiled`` or ``interpreted``.
    progress
        Called with a few words whenever a step that may take a while begins.

    Returns
    -------
    PlanResult
        Motion, cost and the result of the verification.

    Raises
    ------
    ScenarioError
        If the section does not fit the scene, or ``warm_start`` is no plan of such a scene.
    NoPlanError
        If no feasible motion was found, or the solution fails the verification.
    ResultError
        If the folder holds something else or cannot be written.
    """
    from optim.planning.output.plan_folder import SUMMARY
    from optim.planning.search.make_plan import make_plan
    from spacerobot.result import check_folder

    if folder is not None:
        check_folder(folder, SUMMARY)
    found = PlanResult.of(
        make_plan(to_scene(scene), backend=backend, progress=progress, warm_start=warm_start)
    )
    return found if folder is None else found.save(folder)


def compare(
    scene: Scene | StrPath,
    folder: StrPath | None = None,
    *,
    methods: Sequence[str] | None = None,
    variants: Sequence[str] | None = None,
    sets: Sequence[str] | None = None,
    effort: Effort | None = None,
) -> ComparisonResult:
    """Compare tuning methods on the problems of a scene's ``tuning`` section.

    Parameters
    ----------
    scene
        A scene whose scenario has a ``tuning`` section, or the scenario's name or file.
    folder
        Where journals are kept, so that an interrupted comparison continues, and ``comparison.json`` and each
        method's best design are written; nothing is written if None.
    methods, variants, sets
        Which; all that the section names if None.
    effort
        What the methods may do; the same budget for each if None.

    Raises
    ------
    ScenarioError
        If there is no tuning section, or it does not have what is named.
    ResultError
        If the folder holds something else or cannot be written.
    """
    from optim.comparison.compare import compare as run
    from optim.search.session import SearchSession
    from spacerobot.result import JOURNALS, check_folder

    if folder is not None:
        check_folder(folder, "comparison.json")
    session = SearchSession(None if folder is None else Path(folder) / JOURNALS)
    found = run(
        to_scene(scene), methods=methods, variants=variants, sets=sets, effort=effort, session=session
    )
    made = ComparisonResult.of(found)
    return made if folder is None else made.save(folder)


def figures(
    results: Results,
    folder: StrPath | None = None,
    *,
    names: Sequence[str] | None = None,
    formats: Sequence[str] = ("pdf", "png"),
    width: str = "double",
) -> dict[str, Drawing]:
    """Draw the figures of a result, or of several compared.

    Parameters
    ----------
    results
        One result or several.
    folder
        Where each figure is written as ``NAME.FORMAT``; nothing is written if None.
    names
        Which figures, as in :func:`viz.figures.figure_kinds`; all that apply if None.
    formats
        Of the files: ``pdf``, ``svg``, ``png``.
    width
        ``single`` (89 mm) or ``double`` (183 mm) column of a journal.

    Returns
    -------
    dict
        Matplotlib figures by name; each shows itself in a notebook.

    Raises
    ------
    ResultError
        If a name, a format or the width is unknown, the results cannot be compared, or a file cannot be
        written.
    """
    from viz.figures import draw_all, save_figures
    from viz.figures.style import drawn_for

    shown = _several(results)
    if folder is not None:
        save_figures(shown[0], Path(folder), *shown[1:], formats=formats, names=names, width=width)
    with drawn_for(width):
        return {name: drawing for name, _, drawing in draw_all(*shown, names=names)}


def animate(
    results: Results, path: StrPath | None = None, *, title: str | None = None
) -> EmbeddedPage | None:
    """Animate a result, or several side by side.

    Parameters
    ----------
    results
        One result or several.
    path
        File to write: ``.html`` (a page that works offline), or of the first result ``.gif`` or ``.mp4``
        (needs ffmpeg). If None, the animation is returned and shows itself in a notebook's cell.
    title
        Of the page.

    Raises
    ------
    ResultError
        If the format is unknown, the results cannot be compared, or the file cannot be written.
    """
    shown = _several(results)
    if path is None:
        from viz.page.notebook import embed

        return embed(*shown)
    target = Path(path)
    if target.suffix.lower() in (".html", ".htm"):
        from viz.page.page import animation_page

        _write_page(animation_page(*shown, title=title), shown, target)
    else:
        from viz.record import write_recording

        write_recording(shown[0], target)
    return None


def report(results: Results, path: StrPath, *, title: str | None = None) -> None:
    """Write one self-contained page about results: numbers, figures, animation, ledger, warnings.

    Parameters
    ----------
    results
        One result or several compared.
    path
        The page, ``.html``.
    title
        Its heading; made of the results' names if None.

    Raises
    ------
    ResultError
        If the results cannot be compared or the file cannot be written.
    """
    from viz.report.report import report as make_page

    shown = _several(results)
    _write_page(make_page(*shown, title=title), shown, Path(path))


def _write_page(text: str, results: Sequence[Result], path: Path) -> None:
    from spacerobot.files import write_text
    from spacerobot.result import note_derived

    write_text(path, text)
    note_derived([result.folder for result in results], [path])


def _several(results: Results) -> list[Result]:
    return [results] if isinstance(results, Result) else list(results)
