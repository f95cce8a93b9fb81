"""What is printed can be read in a narrow terminal: every column is there, lines break between words."""

from __future__ import annotations

import ast
import inspect
import io
import itertools
import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from optim.campaign.analysis import tables as campaign_tables
from optim.comparison.sweep import SweepResult
from optim.methods.run_method import MethodOutcome
from optim.planning.output.front_folder import front_table
from optim.planning.output.plan_tables import sensitivity_table, solver_table
from optim.planning.output.study_folder import study_tables
from optim.robust.problem import RobustTuningResult, Statistic
from spacerobot.cli import app, output
from spacerobot.cli.commands import compare
from spacerobot.common import text_tables
from spacerobot.common.tables import Table, Tree
from spacerobot.common.tabular import Tabular
from spacerobot.result.events import HEADINGS, event_rows
from spacerobot.simulation.paper import VARIANTS, PaperComparison

REPOSITORY = Path(__file__).parents[2]
WIDTHS = (80, 100)


@pytest.fixture
def tables(monkeypatch):
    """Every table and every list of pairs that was made, as headings and rows."""
    made, table, pairs = [], text_tables.TextTable, text_tables.pairs

    def recorded(title, headings, rows, keys):
        made.append((headings, rows))
        return table(title, headings, rows, keys)

    def noted(rows, width):
        made.append(((), rows))
        return pairs(rows, width)

    monkeypatch.setattr(text_tables, "TextTable", recorded)
    monkeypatch.setattr(text_tables, "pairs", noted)
    return made


def printed(monkeypatch, width, act):
    made = Console(width=width, record=True, highlight=False)
    monkeypatch.setattr(output, "console", lambda: made)
    act(made)
    return made.export_text().rstrip().splitlines()


def test_prose_breaks_between_words_and_indents(monkeypatch):
    text = "robots.rpr2.base: placed at (1.8042, 0.0000, 0.0000) m so that grasp 'right' closes [m]"
    lines = printed(monkeypatch, 40, lambda console: text_tables.prose(text, console, indent=2))
    assert all(len(line) <= 40 for line in lines)
    assert " ".join(line.strip() for line in lines) == text
    assert [line[: len(line) - len(line.lstrip())] for line in lines] == ["  ", "    ", "    "]


def test_cells_that_break_lines_themselves_keep_them(monkeypatch):
    rows = [["largest tip error, rpr1/tip x [mm]", "1.65\n(1.56..1.71)", "2.02\n(1.91..)"]]
    made = text_tables.TextTable(None, ("", "50 %", "95 %"), rows)
    lines = printed(monkeypatch, 44, lambda console: console.print(made))
    assert any("(1.56..1.71)" in line and "(1.91..)" in line for line in lines)


def check_shown(lines, width, headings, rows):
    """Every word of a table is printed whole, and no line is wider than the terminal."""
    assert all(len(line) <= width for line in lines), [line for line in lines if len(line) > width]
    words = set(re.split(r"\s+", "\n".join(lines)))
    missing = {word for row in (headings, *rows) for cell in row for word in cell.split()} - words
    assert not missing


WORD = st.text("abcxyz0123456789.-[]/*", min_size=1, max_size=22)
CELL = st.lists(WORD, max_size=8).map(" ".join)


@settings(max_examples=40, deadline=None)
@given(st.integers(1, 14).flatmap(lambda n: st.lists(st.lists(CELL, min_size=n, max_size=n), min_size=1)))
def test_every_word_of_every_table_is_shown(grid):
    headings, *rows = grid
    for width in WIDTHS:
        console = Console(width=width, record=True, highlight=False, file=io.StringIO())
        console.print(text_tables.TextTable(None, headings, rows))
        check_shown(console.export_text().splitlines(), width, headings, rows)


def test_a_table_that_is_cut_repeats_what_names_its_rows(monkeypatch):
    rows = [["problem-a", "1 %", *["123456789"] * 9], ["problem-b", "5 %", *["987654321"] * 9]]
    made = text_tables.TextTable(None, ["problem", "to", *(f"method-{k}" for k in range(9))], rows, keys=2)
    lines = printed(monkeypatch, 80, lambda console: console.print(made))
    assert sum("problem-a   1 %" in line for line in lines) == 2


def test_a_table_that_fits_only_with_narrow_gaps_is_not_cut(monkeypatch):
    columns = [f"heading-{k:03}" for k in range(6)]
    made = text_tables.TextTable(None, columns, [["123456789.0"] * 6])
    for width, gap, count in ((86, 3, 1), (80, 2, 1), (70, 3, 2)):
        lines = printed(monkeypatch, width, lambda console: console.print(made))
        (first, *others) = [line for line in lines if "heading" in line]
        assert ("heading-000" + " " * gap + "heading-001") in first
        assert len(others) == count - 1


def test_gaps_become_narrow_before_cells_wrap(monkeypatch):
    made = text_tables.TextTable(None, ["a", "b"], [["one two three four five", "one two three four"]])
    for width, count in ((48, 1), (46, 1), (43, 2)):
        lines = printed(monkeypatch, width, lambda console: console.print(made))
        assert sum("o" in line or "f" in line for line in lines[2:]) == count, width


def test_files_and_next_commands_are_on_lines_of_their_own_where_they_do_not_fit(monkeypatch, capsys):
    text = "figures in out/margins; `spacerobot report out/margins` makes a page of them"
    for width, lines in (("80", [text]), ("60", text.replace("; ", "\n").splitlines())):
        monkeypatch.setenv("COLUMNS", width)
        output.print_next(text)
        assert capsys.readouterr().out.splitlines() == lines


def test_a_title_of_pairs_is_not_wrapped_to_the_width_of_the_rows(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    output.show([Table.of_pairs("a title that is longer than the rows", [("name", "1")])])
    assert "a title that is longer than the rows" in capsys.readouterr().out


LONG = "robots.servicer_with_a_name.tips.gripper"
EVENT = {
    "time_s": 123.456789,
    "kind": "entered",
    "who": "left_of_the_servicer",
    "relative_velocity_m_s": [1.23456, 0, 0],
    "impulses_n_s": {"a": [-12.3456789, 0, 0]},
    "energy_lost_j": 1.23456e-7,
}
ESTIMATE = {"value": 0.123456, "low": 0.0123456, "high": 0.98765}
METRIC = {
    "metric": "tip_error_peak",
    "of": f"{LONG} x",
    "unit": "m",
    "largest": 0.98765,
    "percentiles": [{"percent": p, **ESTIMATE} for p in (1, 5, 50, 95, 99, 99.9)],
}
CAMPAIGN = {
    "name": "mine",
    "samples": 100,
    "total": 100,
    "design": "sobol",
    "confidence": 0.95,
    "intervals": True,
    "caveats": [],
    "parameters": ["object_mass", "object_inertia"],
    "against": [
        {"first": "scenario", "second": LONG, "fails_alone": {"scenario": 3, LONG: 4}},
        {"first": "scenario", "second": LONG, "metric": "tip_error_peak", "first_is_better": ESTIMATE},
    ],
    "gains": {
        "scenario": {
            "failure": dict.fromkeys(("any", *filter(None, campaign_tables.marks())), ESTIMATE),
            "captured": ESTIMATE,
            "metrics": [METRIC, METRIC],
            "map": {
                "first": [k + 0.12345 for k in range(12)],
                "second": [k + 0.54321 for k in range(12)],
                "failed": [["", "diverged", "impulse", "capture_time"] * 3] * 12,
            },
        }
    },
}
NUMBER = {"unit": "N m s/rad", "lower": -1234.56, "upper": 1234.56, "start": 0.000123456}
DESIGN = {
    "scenario": "mine",
    "cost": {"start": 1234.56789, "optimum": 1000.123},
    "trials": [{"iterations": 3}],
    "status": "converged",
    "variables": {
        LONG: NUMBER | {"optimum": -0.000765432, "slope": 1.2345e-5, "where": "at its upper bound"}
    },
    "sweeps": {LONG: [{"values": [1.23456], "failure": "no feasible plan was found: " * 4}]},
}
FRONT = {
    "scenario": "mine",
    "terms": ["time", "base_rotation"],
    "headings": {"time": "duration", "base_rotation": "root mean square of the base's rotation"},
    "units": {"time": "s", "base_rotation": "rad"},
    "points": [
        {
            "name": "point-1",
            "status": "refused",
            "values": {"time": 12.3456},
            "changes": {LONG: 1.2345},
            "failure": "no feasible plan was found: " * 4,
        }
    ],
}
TRIAL = {"step": "K_p until it swings", "gain": LONG, "largest_error_m": 1.2345e-5, "swings_hz": 12.345}
RUN = SimpleNamespace(summary={"target": {"max_rotation_deg": 123.4}})


def shown_comparison(name):
    return lambda: compare.show_comparison(json.loads((REPOSITORY / "docs" / "data" / name).read_text()))


def shown(*content):
    return lambda: output.show(content)


def shown_campaign():
    own = CAMPAIGN["gains"]["scenario"]
    output.show(
        [
            campaign_tables.failure_table(CAMPAIGN),
            campaign_tables.percentile_table("scenario", own, CAMPAIGN),
            campaign_tables.outcome_table("scenario", own["map"], CAMPAIGN["parameters"]),
            campaign_tables.pair_table(CAMPAIGN),
        ]
    )


def shown_paper():
    error = {axis: {"min_m": -1.23456789, "max_m": 1.23456789} for axis in "xy"}
    summary = {
        "target": {"max_rotation_deg": 123.4},
        "tip_error": {"rpr1/tip": error, "rpr2/tip": error},
    }
    output.show(PaperComparison({VARIANTS[-1]: SimpleNamespace(summary=summary)}))


def shown_robust():
    designs = {name: np.array([1.23457e-5, np.nan, 2.34561e-5]) for name in ("start", "nominal", "robust")}
    outcome = MethodOutcome("nlp", ())
    output.show(RobustTuningResult({LONG: 1.0}, 1.0, {}, outcome, designs, designs, None, Statistic()))


def shown_command(*arguments):
    return lambda: app.command_line()(arguments, standalone_mode=False)


SOLVE = {"start": 8, "intervals": 128, "cost": 12345.678901, "iterations": 3000, "seconds": 123.456}
SETTING = {"setting": "crossover", "value": 0.5} | dict.fromkeys(("best", "median", "worst"), 1.23457e-5)
TABLES = {
    "campaign": shown_campaign,
    "compare": shown_comparison("comparison-paper.json"),
    "compare suite": shown_comparison("comparison-suite.json"),
    "design": shown(*study_tables(DESIGN)),
    "front": shown(front_table(FRONT)),
    "kinds": shown_command("kinds"),
    "kinds of one": shown_command("kinds", "thrusters"),
    "paper": shown_paper,
    "plan": shown(solver_table({"solver_runs": [SOLVE | {"status": "Maximum_CpuTime_Exceeded"}]})),
    "plan slopes": shown(sensitivity_table({"cost_sensitivities": {LONG: -1.23456e-05}})),
    "robust": shown_robust,
    "run": shown_command("run", "drift", "--backend=interpreted", "--set", "simulation.duration=5"),
    "run events": shown(Table("events", HEADINGS, event_rows([EVENT]))),
    "scenarios": shown_command("scenarios"),
    "sweep": lambda: output.show(SweepResult((SETTING,))),
    "tune": shown(
        MethodOutcome("manual", (SimpleNamespace(method="manual", log=[TRIAL], objective=1.0),)).trials()
    ),
}


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", TABLES)
def test_no_table_loses_a_column(tables, monkeypatch, capsys, name, width):
    monkeypatch.setenv("COLUMNS", str(width))
    TABLES[name]()
    lines = capsys.readouterr().out.splitlines()
    assert tables
    for headings, rows in tables:
        check_shown(lines, width, headings, rows)


def test_every_command_prints_tables_in_the_way_that_fits_the_width():
    for path in (REPOSITORY / "spacerobot" / "cli").rglob("*.py"):
        if path.name != "output.py":
            imports = [n for n in ast.walk(ast.parse(path.read_text())) if isinstance(n, ast.ImportFrom)]
            assert not any(str(n.module).startswith("rich.t") for n in imports), path.name


@pytest.mark.parametrize("width", WIDTHS)
def test_a_pipe_is_as_wide_as_columns_says(monkeypatch, capsys, width):
    monkeypatch.setenv("COLUMNS", str(width))
    shown_command("scenarios")()
    longest = max(map(len, capsys.readouterr().out.splitlines()))
    assert width - 20 < longest <= width


def test_a_pipe_of_no_stated_width_is_wide(monkeypatch, capsys):
    monkeypatch.delenv("COLUMNS", raising=False)
    shown_command("scenarios")()
    assert max(map(len, capsys.readouterr().out.splitlines())) == text_tables.PLAIN_WIDTH


def test_a_printed_result_is_what_the_command_prints(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    content = ["a sentence", Table.of_pairs("title", [("name", "value")]), Tree("root", "text", ["leaf"])]
    content.append(Table(None, ("first", "second"), [("1", "[m]")]))

    class Shown(Tabular):
        def content(self):
            return content

        def notices(self):
            return ("a notice",)

    output.show(content)
    lines = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert str(Shown()).splitlines() == [*lines, "warning: a notice"]
    assert "name  value" in lines
    assert "  1       [m]" in lines


GUIDES = str.maketrans("", "", "\u2502\u251c\u2514\u2500")


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", ["docking", "servicer-wheels"])
def test_check_shows_every_word_of_trees_and_prose(monkeypatch, capsys, name, width):
    """The same words in the same order as in a terminal that is as wide as its longest line."""

    def shown(columns):
        monkeypatch.setenv("COLUMNS", str(columns))
        shown_command("check", name)()
        printed = capsys.readouterr().out
        assert max(map(len, printed.splitlines())) <= columns
        return printed.translate(GUIDES).split()

    assert shown(width) == shown(4000)


HELPS = [name for name, command in app.command_line().commands.items() if not hasattr(command, "commands")]


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", HELPS)
def test_help_wraps_paragraphs_and_shows_every_word(monkeypatch, capsys, name, width):
    """The command line is made anew: the lines of examples depend on the width."""
    monkeypatch.setenv("COLUMNS", str(width))
    app.command_line.cache_clear()
    shown_command(name, "--help")()
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert not any("\u2026" in line for line in lines)
    text = inspect.getdoc(sys.modules[f"spacerobot.cli.commands.{name.replace('-', '_')}"].command)
    for paragraph in text.split("\n\n"):
        words = paragraph.split()
        if paragraph.startswith("    "):
            shown = " ".join(lines).replace("\\ ", "")
            assert " ".join(words) in shown
            continue
        begin = next(k for k, line in enumerate(lines) if line and " ".join(words).startswith(line))
        block = lines[begin : lines.index("", begin)]
        assert " ".join(block) == " ".join(words)
        # no line ends where its next word would have fitted
        for line, below in itertools.pairwise(block):
            assert len(line) + 1 + len(below.split()[0]) > width - 2


def test_progress_of_a_batch_job_is_a_line_now_and_then(monkeypatch, capsys):
    """Without a terminal: the step at that time, without the spinner."""
    times = iter((0.0, 10.0, 31.0, 31.0, 40.0))
    monkeypatch.setattr("spacerobot.cli.output.time", SimpleNamespace(monotonic=lambda: next(times)))
    with output.progress("reading") as tell:
        tell("first step")
        tell("second step: 40 %")
        tell("third step")
    assert capsys.readouterr().err == "second step: 40 %\n"
