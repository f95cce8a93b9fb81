"""Figures, animations and reports of results and studies."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from spacerobot.api.load import STUDIES, load
from spacerobot.api.results import PlanResult
from spacerobot.api.study import Playback, Study
from spacerobot.common.errors import ResultError
from spacerobot.common.files import StrPath
from spacerobot.common.tabular import Tabular
from spacerobot.result import Result
from spacerobot.simulation import Progress

if TYPE_CHECKING:
    from spacerobot.linear import MarginAnalysis
    from viz.figures import Drawing
    from viz.page.live import LiveViewer
    from viz.page.notebook import EmbeddedPage

Source = Result | Study
Sources = Source | StrPath | Sequence[Source | StrPath]
"""One or several results, or their folders."""


def figures(
    results: Sources | MarginAnalysis,
    folder: StrPath | None = None,
    *,
    names: Sequence[str] | None = None,
    formats: Sequence[str] = ("pdf", "png"),
    width: str = "double",
) -> dict[str, Drawing]:
    """Draw the figures of one or several results, of a plan, of a study of plans, or of stability margins.

    Args:
        results: One or several results, or their folders; a plan, alone or with the result that follows it; a
            Pareto front; a design study; margins of :func:`spacerobot.margins`.
        folder: Folder for the files ``NAME.FORMAT``; nothing is written if None.
        names: Names of the figures, as in :func:`viz.figures.figure_kinds`; all that apply if None.
        formats: Formats of the files: ``pdf``, ``svg``, ``png``.
        width: ``single`` (89 mm) or ``double`` (183 mm) column of a journal.

    Returns:
        dict: Matplotlib figures by name, which notebooks display.

    Raises:
        ResultError: If a name, a format or the width is unknown, the results cannot be compared, or a file
            cannot be written.
    """
    from spacerobot.linear import MarginAnalysis
    from spacerobot.result import note_derived
    from viz.figure_formats import check_formats

    check_formats(formats)
    from viz.figures import draw_all
    from viz.figures.margins import margin_figures
    from viz.figures.style import drawn_for, write_drawings

    first: Source | MarginAnalysis
    first, *others = (results,) if isinstance(results, MarginAnalysis) else opened(results)
    if names and not isinstance(first, Result):
        name, source = (first.name, first.folder) if isinstance(first, Study) else ("margin analysis", None)
        message = f"the figures of a {name} are drawn together; leave out --only (names)"
        raise ResultError(message, source=source)
    simulated = _only_results([first, *others] if isinstance(first, Result) else others)
    with drawn_for(width):
        if isinstance(first, MarginAnalysis):
            drawings = margin_figures(first)
        elif isinstance(first, Result):
            drawings = {name: drawing for name, _, drawing in draw_all(*simulated, names=names)}
        else:
            drawings = first.drawings(simulated)
        if folder is not None:
            written = write_drawings(drawings.items(), Path(folder), formats)
            note_derived([result.folder for result in simulated], written)
    return drawings


def animate(
    results: Sources,
    path: StrPath | None = None,
    *,
    title: str | None = None,
    speed: float | None = None,
    at: float | None = None,
    progress: Progress | None = None,
) -> EmbeddedPage | None:
    """Animate one or several results, a plan and its simulation, a comparison, or a campaign.

    Args:
        results: One or several results, or their folders; one campaign, comparison or plan; a result and its
            plan.
        path: File to write: ``.html`` (a page that works offline), ``.gif``, ``.mp4`` (needs ffmpeg) or
            ``.png`` (one picture). Recordings and pictures have the first result only. If None, the animation
            is returned.
        title: Title of the page.
        speed: Speed of a recording relative to real time; if None, the recording takes at most 20 s.
        at: Time of a picture [s]; the first capture if None.
        progress: Callback with a short text, called when a step that may take long begins.

    Returns:
        EmbeddedPage: Animation that a notebook displays; None if a file was written.

    Raises:
        ResultError: If the format is unknown, the results cannot be compared, or the file cannot be written.
    """
    from spacerobot.common.files import write_text
    from spacerobot.result import note_derived
    from viz.page.notebook import EmbeddedPage
    from viz.page.page import page

    sources, target = opened(results), None if path is None else Path(path)
    is_page = target is None or target.suffix.lower() in (".html", ".htm")
    if not is_page and len(sources) == 1 and isinstance(sources[0], Result):
        played = Playback({}, _only_results(sources))  # a recording does not use the page's data
    else:
        played = playback(sources, progress, title)
    if target is None:
        return EmbeddedPage(page(played.data | {"autoplay": False}))
    if is_page:
        write_text(target, page(played.data))
        note_derived([result.folder for result in played.results], [target])
    elif target.suffix.lower() == ".png":
        from viz.recording.record import write_poster

        write_poster(played.results[0], target, at=at)
    else:
        from viz.recording.record import write_recording

        write_recording(played.results[0], target, speed=speed, progress=progress)
    return None


def view(
    results: Sources,
    *,
    port: int = 7000,
    on_start: Callable[[LiveViewer], object] | None = None,
) -> LiveViewer:
    """Serve the animation of :func:`animate` to a browser on this computer.

    Args:
        results: As for :func:`animate`.
        port: First port to try; busy ports are skipped.
        on_start: Callback with the viewer, called when its page can be opened. The page of a campaign then
            shows the spread of the metrics; its worst samples are added after their simulation.

    Returns:
        LiveViewer: Server, which runs until its ``close`` or the end of its ``with`` block. Its ``open``
            opens a browser.

    Raises:
        ResultError: If the results cannot be compared or played.
        SpaceRobotError: If no port is free.
    """
    from viz.page.live import LiveViewer

    sources = opened(results)
    first = sources[0].first_view() if len(sources) == 1 and isinstance(sources[0], Study) else None
    data = playback(sources).data if first is None else first
    viewer = LiveViewer(port)
    try:
        viewer.show_data(data)
        if on_start is not None:
            on_start(viewer)
        if first is not None:
            viewer.show_data(playback(sources, viewer.tell).data)
    except BaseException:
        viewer.close()
        raise
    return viewer


def report(
    results: Sources | Tabular, path: StrPath, *, title: str | None = None, progress: Progress | None = None
) -> None:
    """Write a self-contained HTML page with numbers, figures, animation, conservation ledger and warnings.

    Args:
        results: One or several results, or folders of one or several results; one campaign, comparison or
            plan; or the file or folder of margins, a batch, a gradient, a failure probability, a
            falsification or an identification.
        path: HTML file to write.
        title: Heading of the page; the name of the scenario, and the names of several results, if None.
        progress: Callback with a short text, called when a step that may take long begins.

    Raises:
        ResultError: If the results cannot be compared or the file cannot be written.
    """
    from spacerobot.common.files import write_text
    from spacerobot.result import note_derived
    from viz.report.report import report as results_page

    if isinstance(results, Tabular) and not isinstance(results, Source):
        write_text(Path(path), _tables_page(results, None, title))
        return
    named = _listed(results)
    tabular = _tabular(named)
    if tabular is not None:
        write_text(Path(path), _tables_page(*tabular, title))
        return
    for source in named:
        name = _study_name(source)
        if name and len(named) > 1:
            folder = Path(source) if isinstance(source, str | os.PathLike) else source.folder
            raise ResultError(f"a {name} has a page of its own; name it alone", source=folder)
    sources = opened(named, several=True)
    study = sources[0]
    if not isinstance(study, Result):
        write_text(Path(path), study.page(progress or (lambda _: None)))
        return
    results_shown = _only_results(sources)
    write_text(Path(path), results_page(*results_shown, title=title))
    note_derived([result.folder for result in results_shown], [path])


def _tables_page(result: Tabular, source: Path | None, title: str | None) -> str:
    """Page with the tables and figures of a result without a page of its own."""
    from viz.report.tables_report import tables_report

    return tables_report(result, title or _heading(result), source.resolve().name if source else "")


def _tabular(named: Sequence[Source | StrPath]) -> tuple[Tabular, Path] | None:
    """Result of a file, or of a folder of margins, and its path; None if no source is one.

    Raises:
        ResultError: If there are other sources besides it.
    """
    for source in named:
        if not isinstance(source, str | os.PathLike):
            continue
        if not (Path(source).is_file() or (Path(source) / "margins.nc").is_file()):
            continue
        loaded = load(source)
        if isinstance(loaded, Source):
            continue
        if len(named) > 1:
            raise ResultError(f"{loaded!r} has a page of its own; name it alone", source=Path(source))
        return loaded, Path(source)
    return None


def _heading(result: Tabular) -> str:
    """Name of a result's class in words, and that of its scenario if it is known."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(result).__name__.removesuffix("Result")).lower()
    words = {"saved margins": "stability margins", "margin analysis": "stability margins"}.get(words, words)
    data = getattr(result, "data", None)
    scenario = getattr(result, "scenario", "") if data is None else data.attrs.get("scenario", "")
    return f"{words[:1].upper()}{words[1:]}" + (f" of {scenario}" if scenario else "")


def playback(sources: Sources, progress: Progress | None = None, title: str | None = None) -> Playback:
    """Data of the animated page, and the results in it.

    Raises:
        ResultError: If the results cannot be compared or played.
    """
    from viz.page.animation import animation

    inputs = opened(sources)
    first, last = inputs[0], inputs[-1]
    if len(inputs) == 2 and isinstance(first, Result) and isinstance(last, PlanResult):
        played = last.followed_by(first)
    elif isinstance(first, Study) and len(inputs) == 1:
        played = first.playback(progress or (lambda _: None))
    else:
        results = _only_results(inputs)
        return Playback(animation(*results, title=title), results)
    return played if title is None else replace(played, data=played.data | {"title": title})


def opened(sources: Sources, *, several: bool = False) -> list[Source]:
    """Results and studies, those of folders loaded.

    Args:
        sources: Results or folders, one or several.
        several: Whether a folder may contain several results in subfolders.

    Raises:
        ResultError: If a folder has no result, or there are no sources.
    """
    opened_sources: list[Source] = []
    for source in _listed(sources):
        if isinstance(source, Source):
            opened_sources.append(source)
        elif several and _holds_results(Path(source)):
            from viz.report.report import find_results

            opened_sources += find_results([source])
        else:
            result = load(source)
            opened_sources.append(result if isinstance(result, Source) else Result.load(source))
    if not opened_sources:
        raise ResultError("no results named")
    return opened_sources


def _listed(sources: Sources) -> Sequence[Source | StrPath]:
    """Results and folders as a list."""
    listed = [sources] if isinstance(sources, Source | str | os.PathLike) else sources
    for source in listed if isinstance(listed, Iterable) else [listed]:
        if not isinstance(source, Source | str | os.PathLike):
            allowed = "results, plans, studies, or their folders"
            raise ResultError(f"found {type(source).__name__}, allowed: {allowed}", where="results")
    return list(listed)


def _study_name(source: Source | StrPath) -> str | None:
    """Kind of a study or of a study's folder; None for the result of a simulation."""
    if isinstance(source, Source):
        return source.name if isinstance(source, Study) else None
    return next((kind.name for kind in STUDIES if (Path(source) / kind.file).is_file()), None)


def _holds_results(folder: Path) -> bool:
    """Whether a folder contains results in subfolders, and is not itself a result or study.

    Raises:
        ResultError: If a subfolder is a study.
    """
    from spacerobot.result.store import DATA, JOBS

    if not folder.is_dir() or (folder / DATA).is_file() or any((folder / file).is_file() for file in JOBS):
        return False
    for inside in sorted(folder.glob("*/")):
        if (name := _study_name(inside)) is not None:
            message = f"holds a {name}, {inside.name}, among results; name the results, or it alone"
            raise ResultError(message, source=folder)
    return True


def _only_results(sources: Sequence[Source]) -> list[Result]:
    """The sources, all results of simulations.

    Raises:
        ResultError: If a source is a study.
    """
    for source in sources:
        if not isinstance(source, Result):
            raise ResultError(
                f"a {source.name} cannot be shown with others; name it alone", source=source.folder
            )
    return [source for source in sources if isinstance(source, Result)]
