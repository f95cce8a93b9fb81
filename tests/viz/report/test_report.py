"""The report: complete, escaped, self-contained, and true."""

import dataclasses
import itertools
import re
import time

import numpy as np
import pytest
import typer
from matplotlib.backends.backend_agg import FigureCanvasAgg
from typer.testing import CliRunner

from optim.methods.run_method import MethodOutcome
from optim.problem.problem import EvaluationCost
from optim.search.search import SearchRun
from optim.tuning import TuningResult
from spacerobot.common.errors import ResultError
from spacerobot.common.registry import COMMANDS
from spacerobot.common.tables import content_html
from spacerobot.result.result import Result
from viz.figures import draw_all, figure_kinds
from viz.figures.collect import with_common_tips
from viz.figures.docking import docking
from viz.figures.labels import differences
from viz.figures.phases import shade
from viz.figures.storyboard import storyboard
from viz.figures.style import panels
from viz.report.report import SECTIONS, ReportSection, find_results, write_report
from viz.report.report import report as report_page
from viz.report.verdict import verdict


@pytest.fixture(scope="module")
def comparison(paper, blind):
    return report_page(blind, paper)


def test_it_holds_every_section_that_applies(comparison, paper):
    named = re.findall(r'<section id="(\w+)">', comparison)
    absent = "warnings", "events", "tuning"
    assert named == [section.name for section in SECTIONS if section.name not in absent]
    assert comparison.count("data:image/svg+xml") == 3 + 2 * 5
    for assumption in paper.summary["assumptions"]:
        assert assumption.split("'")[0] in comparison


def test_its_numbers_are_the_summarys(comparison, paper):
    error = paper.summary["tip_error"]["rpr1/tip"]
    assert f"{error['x']['min_m'] * 1e3:+.3f} .. {error['x']['max_m'] * 1e3:+.3f}" in comparison
    row = next(row for row in comparison.split("<tr>") if "amnesia</th>" in row and "Fig. 7" in row)
    verdicts = re.findall("[✓✗]", row)
    assert verdicts == ["✗", "✓", "✓", "✓"]  # robot 1 reaches -1.63 mm in x, the paper -1.18
    rows = comparison[comparison.index('id="paper"') :]
    alone = next(row for row in rows.split("<tr>") if "pid</th>" in row)
    assert "-144 .. 0" in alone
    assert not re.findall("[✓✗]", alone)  # Fig. 7 is of the amnesia controller


def test_it_opens_without_a_network_and_plays(browser, comparison, tmp_path):
    path = tmp_path / "report.html"
    path.write_text(comparison, encoding="utf-8")
    sizes = (1400, 900), (800, 600)
    browser.open(path.as_uri(), *sizes[0])
    browser.wait_for("document.readyState === 'complete'")
    for size in sizes:
        browser.resize(*size)
        browser.wait_for(f"window.innerWidth === {size[0]}")
        browser.drawn()
        assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        assert browser.evaluate(
            "[...document.images].every((image) => image.complete && image.naturalWidth > 0)"
        )
        browser.evaluate("document.querySelector('.playable').scrollIntoView()")
        browser.evaluate("document.querySelector('.playable input:not(:checked)')?.click()")
        end = time.monotonic() + 15
        # the player's blue panels and gold bases, drawn by the scripts of a page within the page
        while _share_of_gold(browser.picture()) < 0.005:
            assert time.monotonic() < end, "the animation did not appear"
    assert browser.errors == []
    assert [
        url for url in browser.requests if not url.startswith(("file:", "data:", "blob:", "about:"))
    ] == []


def _share_of_gold(picture):
    return ((picture[:, :, 0] - picture[:, :, 2] > 90) & (picture[:, :, 1] > 110)).mean()


def test_texts_from_files_are_escaped(paper, undrawn):
    evil = "<script>alert(1)</script>"
    scenario = paper.scenario.model_copy(update={"description": evil})
    summary = dict(paper.summary) | {"assumptions": [evil]}
    text = report_page(Result(scenario, paper.data, summary), title=evil)
    assert evil not in text
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in text


def test_it_is_headed_by_the_scenario_and_names_the_folder(paper, blind, undrawn):
    def heading(*results):
        page = report_page(*results, sections=SECTIONS[:1])
        return re.findall(r"<title>(.*)</title>|<header><p>(.*)</p><h1>(.*)</h1>", page)

    assert heading(paper) == [("paper (amnesia)", "", ""), ("", "spacerobot report of amnesia", "paper")]
    several = "paper: pid · amnesia"
    assert heading(blind, paper) == [(several, "", ""), ("", "spacerobot report", several)]


def test_a_diverged_result_says_so_first(diverged):
    text = report_page(diverged, sections=SECTIONS[:2])
    assert "diverged after 0.42 s of 10 s" in text
    assert text.index('id="warnings"') < text.index('id="verdict"')


def test_only_the_papers_robots_are_held_against_its_figures(paper, monkeypatch):
    """Of own robots neither a heading nor a caption refers to the paper."""
    monkeypatch.setattr("viz.report.sections.to_bytes", lambda *_: b"<svg/>")
    drawn = [(kind.name, kind, None) for kind in figure_kinds()]
    monkeypatch.setattr("viz.report.sections.draw_all", lambda *_, **__: drawn)
    scenario = paper.scenario.model_copy(update={"name": "mine"})
    own = "".join(
        re.findall(r"<(?:h\d|figcaption)>[^<]*", report_page(dataclasses.replace(paper, scenario=scenario)))
    )
    theirs = report_page(paper)
    assert not re.search(r"[Pp]aper|Fig\.", own)
    assert "(the paper&#x27;s Fig. 5)" in theirs
    assert "Against the paper" in theirs
    numbers = [int(number) for number in re.findall(r"<figcaption>Figure (\d+)\. ", own)]
    assert numbers == list(range(1, len(drawn) + 1))


def test_events_have_a_table_where_there_are_any(docked, paper, undrawn):
    rows = re.findall(r"<td>left ([^<]*)</td>", report_page(docked))
    assert [row for row in rows if row in ("captured", "released")] == ["captured", "released"]
    assert 'id="events"' not in report_page(paper)


def test_others_may_add_sections(paper):
    extra = ReportSection("tuning", "Tuning", lambda subject: f"<p>{subject.labels[0]}</p>")
    text = report_page(paper, sections=[extra, ReportSection("none", "None", lambda _: None)])
    assert re.findall(r'<section id="(\w+)">', text) == ["tuning"]


def test_differences_are_the_changed_leaves():
    a, b = {"x": {"y": 1, "z": [1, 2]}}, {"x": {"y": 2, "z": [1, 2]}, "w": None}
    assert differences([a, b]) == [("x.y", ["1", "2"]), ("w", ["-", "none"])]
    knots = [{"knots": [0.125 * k + shift for k in range(200)]} for shift in (0.0, 1.0)]
    ((path, texts),) = differences(knots)
    assert path == "knots"
    assert texts[0].startswith("[0.0, 0.125, 0.25, ")
    assert all(text.endswith(", ... (200 values)") and len(text) < 90 for text in texts)


def test_folders_of_results_are_found(paper, blind, tmp_path):
    (tmp_path / "all").mkdir()
    for result in (paper, blind):
        (tmp_path / "all" / result.folder.name).symlink_to(result.folder)
    assert [r.folder.name for r in find_results([tmp_path / "all"])] == ["amnesia", "pid"]
    with pytest.raises(ResultError, match="no such folder"):
        find_results([tmp_path / "none"])


def test_a_folder_that_cannot_be_written_is_one_clear_line(paper, tmp_path, undrawn):
    (tmp_path / "file").write_text("")
    with pytest.raises(ResultError, match=r"file.report\.html: cannot be written"):
        write_report(dataclasses.replace(paper), tmp_path / "file" / "report.html")


def test_the_commands_write_what_they_say(paper, blind, tmp_path, undrawn):
    app = typer.Typer()
    for name in ("animate", "figures", "report"):
        COMMANDS.find(name).join(app)
    run = CliRunner().invoke
    first, second = str(blind.folder), str(paper.folder)
    page = tmp_path / "page.html"
    assert run(app, ["animate", first, "--compare", second, "--html", str(page)]).exit_code == 0
    assert page.stat().st_size > 1e6
    out = tmp_path / "figures"
    assert (
        run(app, ["figures", first, "--out", str(out), "--format", "svg", "--only", "joints"]).exit_code == 0
    )
    assert [path.name for path in out.iterdir()] == ["joints.svg"]
    done = run(app, ["report", first, "--out", str(tmp_path / "r.html")])
    assert "r.html" in done.output.replace("\n", "")
    assert (tmp_path / "r.html").exists()


def test_it_begins_with_the_verdict_and_a_picture(docked, diverged, undrawn):
    """The outcome is read before anything else; the picture is there without a script, and on paper."""
    text = report_page(docked)
    (capture,) = (event["time_s"] for event in docked.summary["events"] if event["kind"] == "captured")
    assert f"Captured: left at {capture:.4g} s." in verdict(docked)
    body = text[text.index("<main>") :]
    assert body.index(verdict(docked)) < body.index("data:image/png") < body.index("<table")
    assert "no description" not in text
    assert verdict(diverged).startswith("Not completed: diverged after 0.42 s")


def test_results_with_other_tips_are_compared_in_those_they_share(paper, blind):
    alone = dataclasses.replace(blind, data=blind.data.isel(tip=[1]))
    both = with_common_tips((paper, alone))
    assert [list(result.data.tip.values) for result in both] == [["rpr2/tip"]] * 2
    names = [name for name, *_ in draw_all(paper, alone, names=["tip_errors"])]
    assert names == ["tip_errors"]
    assert with_common_tips((paper, paper)) == (paper, paper)
    assert with_common_tips((paper, dataclasses.replace(blind, data=blind.data.isel(tip=[])))) == ()


def test_names_of_phases_do_not_lie_over_each_other():
    figure, axes = panels(1, 1)
    shade(
        axes[0, 0], [("approach", 0, 0.1), ("stop", 0.1, 0.2), ("carry", 0.2, 9), ("part", 9, 10)], named=True
    )
    axes[0, 0].set_xlim(0, 10)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    boxes = [text.get_window_extent() for text in axes[0, 0].texts]
    assert len(boxes) == 4
    for one, other in itertools.combinations(boxes, 2):
        assert not one.overlaps(other)


def test_frames_are_shown_once(paper, docked, monkeypatch):
    """Evenly spaced where nothing happens, else at the events; not both, which would be almost the same."""
    monkeypatch.setattr("viz.report.sections.to_bytes", lambda *_: b"<svg/>")

    def shown(result):
        return {"docking", "storyboard"} & set(re.findall(r'<figure id="(\w+)">', report_page(result)))

    assert shown(paper) == {"docking"}
    assert shown(docked) == {"storyboard"}


def test_names_of_bodies_stay_inside_their_panel(paper, docked):
    for drawing in (docking(paper), storyboard(docked)):
        FigureCanvasAgg(drawing).draw()
        panel = drawing.axes[0]
        for text in panel.texts:
            assert not text.get_window_extent().overlaps(panel._left_title.get_window_extent()), text


def test_it_is_readable_on_a_phone(browser, flat, docked, paper, tmp_path):
    """Figures fit, and a click enlarges them; a table of two columns is broken into lines; nothing is cut."""
    path = tmp_path / "report.html"
    write_report(docked, path)
    browser.open(path.as_uri(), 390, 844)
    browser.wait_for("document.readyState === 'complete'")
    assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    # figures fit; a click enlarges one until its letters are readable, and it scrolls in its box
    assert browser.evaluate("[...document.querySelectorAll('figure img')].every((i) => i.width <= 390)")
    browser.evaluate("document.querySelector('figure label').click()")
    assert browser.evaluate("document.querySelector('figure img').width >= 600")
    assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    assert browser.evaluate(
        "[...document.querySelectorAll('#numbers .wide')].every((box) => box.scrollWidth <= box.clientWidth)"
    )
    # nothing lies over the play button
    assert browser.evaluate(
        "(() => { const b = document.querySelector('.playable span'); b.scrollIntoView({block: 'center'});"
        " const r = b.getBoundingClientRect();"
        " return document.elementFromPoint(r.x + r.width / 2, r.y + r.height / 2) === b })()"
    )


def test_a_tuned_result_reports_its_gains(paper, tmp_path, undrawn):
    result = paper.save(tmp_path / "tuned")
    cost, point = EvaluationCost(rollouts=3, slopes=5), np.array([0.3, 0.0])
    run = SearchRun("nlp", 0, 1, point, 0.0005, 0.0, cost, 1.5, "settled", "no further improvement")
    tuning = TuningResult(
        {"kp": 285.89, "kd": 0.0},
        0.0005,
        "settled",
        "no further improvement",
        result.scene(),
        MethodOutcome("nlp", (run,)),
        reading=("minimax", 1e3, "mm"),
    )
    tuning.save(result.folder)
    file = result.folder / "tuning.json"
    text = report_page(result)
    section = text[text.index('<section id="tuning">') :]
    assert section.startswith('<section id="tuning">')
    assert content_html(tuning.content()) in section
    assert "nlp: minimax 0.5 mm" in section
    assert re.search(r"kd</th><td>0, at its lower bound", section)
    file.write_text("{}")
    with pytest.raises(ResultError, match=r"tuning\.json: holds no tuning that can be read"):
        report_page(result)
