"""Reports of what presents itself by tables: margins in a folder, a batch in a file."""

import numpy as np
import pytest
import xarray as xr

import spacerobot as sr
from optim.evaluation import BatchResult
from optim.reliability.falsification import Falsification, WorstCase
from optim.reliability.probability import FailureProbability
from spacerobot.common.errors import ResultError
from spacerobot.common.tables import Table
from spacerobot.linear.loop_margins import FILE, UNITS
from spacerobot.result.events import event_table
from viz.report.report import ReportSection, page

PATH = "target.links.body.mass"


def write_margins(folder, stable=True, growth_rate=0.0):
    values = {"gain_up": 6.0, "gain_down": -np.inf, "phase": 14.1, "disk": 0.25, "crossover": 1.6}
    loops = {name: [[values.get(name, 0.0), values.get(name, 0.5)]] for name in UNITS}  # delays 0 and 0.5 s
    data = xr.Dataset(
        {name: (("instant", "loop"), rows) for name, rows in loops.items()}
        | {"stable": ("instant", [stable]), "growth_rate": ("instant", [growth_rate])},
        coords={
            "instant": ["2.5 s"],
            "loop": ["torque/arm/a<1>", "torque/arm/b"],
            "time": ("instant", [2.5]),
            "description": ("instant", ["continuous, 8 states"]),
        },
    )
    data.to_netcdf(folder / FILE)
    (folder / "figures").mkdir()
    (folder / "figures" / "bode_1.svg").write_text("<svg xmlns='http://www.w3.org/2000/svg'/>")
    (folder / "figures" / "other.svg").write_text("<svg/>")


@pytest.mark.parametrize(
    ("stable", "growth_rate", "words"),
    [
        (True, 0.03, "2.5 s: stable; the motion drifts at 0.03 1/s, no instability of the control."),
        (False, 4.25, "2.5 s: unstable: a mode grows at 4.25 1/s."),
    ],
)
def test_the_page_of_margins_distinguishes_unstable_loops_from_slow_drifts(
    tmp_path, stable, growth_rate, words
):
    write_margins(tmp_path, stable, growth_rate)
    sr.report(tmp_path, tmp_path / "page.html")
    assert words in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_margins_have_a_page_that_explains_a_delay_margin_of_zero(tmp_path):
    write_margins(tmp_path)
    sr.report(tmp_path, tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "2.5 s: stable. The least disk margin is 0.250, of torque/arm/a&lt;1&gt;" in text
    assert text.index("In short") < text.index("2.5 s: continuous, 8 states")
    assert "torque/arm/a&lt;1&gt;" in text
    assert text.count("0*") == 2  # in one row, and in the note
    assert "any additional delay makes it unstable" in text
    assert text.count("<figure") == 1
    assert "each broken at its point, 2.5 s" in text
    assert [row[3] for row in sr.load(tmp_path).content()[0].rows] == ["0*", "0.5"]
    with pytest.raises(ResultError, match="name it alone"):
        sr.report([tmp_path, tmp_path], tmp_path / "page.html")
    xr.Dataset().to_netcdf(tmp_path / FILE)
    with pytest.raises(ResultError, match="holds no"):
        sr.report(tmp_path, tmp_path / "page.html")


def test_pages_of_worst_cases_and_probabilities_begin_with_their_outcome(tmp_path):
    worst = WorstCase(6.25e-3, {"mass": 12.0}, {"mass": 99.0})
    searched = Falsification("tip_error_peak", "m", 5e-3, 2e-3, worst, worst, {}, "40 rollouts")
    probability = FailureProbability("tip_error_peak", "m", 5e-3, "line", 1.5e-4, 0.1, 100, 10, ())
    for result, words in (
        (searched, "The limit of tip_error_peak, 0.005 m, is exceeded. The worst value is 0.00625 m"),
        (
            probability,
            "exceeds 0.005 m with a probability of 0.00015; the 95 % confidence",
        ),
    ):
        result.save(tmp_path / "result.json")
        sr.report(tmp_path / "result.json", tmp_path / "page.html")
        text = (tmp_path / "page.html").read_text(encoding="utf-8")
        assert words in text
        assert text.index("In short") < text.index("<h2>Numbers")


def test_a_batch_has_a_page_with_each_quantity_over_what_varies(tmp_path):
    data = xr.Dataset(
        {
            "tip_error_rms": ((PATH, "tip_error_rms_of"), [[1e-3], [2e-3]], {"units": "m"}),
            "diverged_at": ((PATH,), [np.nan, np.nan]),
        },
        coords={PATH: [10.0, 20.0], "tip_error_rms_of": ["arm/tip"]},
        attrs={"scenario": "paper"},
    )
    BatchResult(data).save(tmp_path / "many.nc")
    sr.report(tmp_path / "many.nc", tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<title>Batch of paper (many.nc)<" in text
    assert "0.001 .. 0.0015 .. 0.002" in text
    assert text.count("<figure") == 1


def test_a_column_of_events_that_is_empty_is_left_out():
    captured = {"time_s": 1.0, "kind": "captured", "who": "left", "relative_velocity_m_s": [1e-3, 0, 0]}
    table = event_table([captured, {"time_s": 2.0, "kind": "phase", "who": "stop"}])
    assert table.headings == ["time [s]", "event", "relative speed [mm/s]"]
    assert table.rows == [["1.000000", "left captured", "1"], ["2.000000", "stop begins", ""]]


def test_a_narrow_page_breaks_names_between_their_parts(browser, tmp_path):
    """Each part of a dotted path is on one line; a number and a unit are not broken."""
    names = [
        "robots.chaser.controllers.x.gains",
        "d tip_error_rms / d robots.servicer.tips.right_tip.pid.kp",
        "measurement/servicer/right_tip.tip_position[0]",
    ]
    rows = [(name, f"-0.{k}e-08 deg/s, robots.chaser.controllers.x.gains") for k, name in enumerate(names)]
    section = ReportSection("numbers", "Numbers", lambda _: None)
    (tmp_path / "page.html").write_text(page("", [(section, Table.of_pairs(None, rows).html())]))
    browser.open((tmp_path / "page.html").as_uri(), 390, 844)
    browser.wait_for("document.readyState === 'complete'")
    parts = browser.evaluate(
        """(() => {
          const walk = document.createTreeWalker(document.querySelector("tbody"), NodeFilter.SHOW_TEXT)
          const range = document.createRange(), parts = []
          while (walk.nextNode())
            for (const word of walk.currentNode.data.matchAll(/\\S+/g)) {
              range.setStart(walk.currentNode, word.index)
              range.setEnd(walk.currentNode, word.index + word[0].length)
              parts.push([word[0], range.getClientRects().length])
            }
          return parts
        })()"""
    )
    texts = [text for text, _ in parts]
    assert {"robots.", "controllers.", "right_", "measurement/", "-0.0e-08", "deg/s,"} <= set(texts)
    assert [text for text, lines in parts if lines > 1] == []
