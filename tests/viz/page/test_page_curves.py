"""Curves of the page: zoom, limits, phase portraits, tables, pictures; and a browser without WebGL."""

import base64
import csv
import io
import re
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from PIL import Image

import viz
from spacerobot.result.result import Result
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.page.limits import joint_limits
from viz.page.page import animation_page, write_animation
from viz.page.signals import quantities

SAVED = "HTMLAnchorElement.prototype.click = function () { window.saved = [this.download, this.href]; }"
TEXTS = """
URL.createObjectURL = (blob) => {
  blob.text().then((text) => { window.lastText = text; });
  return 'blob:x';
}
"""
SPAN = """
((b, s) => [
  b.left + parseFloat(s.getPropertyValue('--axis')), b.right - parseFloat(s.getPropertyValue('--edge')),
  b.top + 40,
])(document.querySelector('.panel canvas').getBoundingClientRect(), getComputedStyle(chart))
"""


@pytest.fixture
def shown(browser, tmp_path, paper):
    """Function that opens the paper's page."""

    def show(fragment="#t=5&play=0&signals=tip error", size=(1280, 800)):
        path = tmp_path / "page.html"
        path.write_text(animation_page(paper), encoding="utf-8")
        browser.open(f"{path.as_uri()}{fragment}", *size)
        browser.wait_for("document.body?.dataset.ready === 'true'")
        browser.evaluate(SAVED)
        return browser

    return show


def test_what_is_seen_of_the_curves_is_saved_as_a_table(shown, paper, flat):
    page = shown()
    page.evaluate(TEXTS)
    page.evaluate("document.getElementById('table').click()")
    page.wait_for("window.lastText")
    rows = list(csv.reader(io.StringIO(page.evaluate("window.lastText"))))
    assert rows[0] == ["time [s]", "tip error rpr1/tip [mm]", "tip error rpr2/tip [mm]"]
    values = np.array(rows[1:], dtype=float)
    error = np.linalg.norm(paper.data.tip_error.values, axis=-1) * 1e3
    assert values[:, 0] == pytest.approx(paper.data.time.values, abs=1e-6)
    assert values[:, 1:] == pytest.approx(error, rel=1e-6, abs=1e-9)
    for _ in range(3):
        page.evaluate("document.getElementById('nearer').click()")
    page.evaluate("window.lastText = ''; document.getElementById('table').click()")
    page.wait_for("window.lastText")
    seen = np.array(list(csv.reader(io.StringIO(page.evaluate("window.lastText"))))[1:], dtype=float)[:, 0]
    wide = 10 / 1.5**3
    assert (seen[0], seen[-1]) == pytest.approx((5 - wide / 2, 5 + wide / 2), abs=0.03)
    page.evaluate("document.querySelector('.u-over').dispatchEvent(new MouseEvent('dblclick'))")
    page.evaluate("window.lastText = ''; document.getElementById('table').click()")
    page.wait_for("window.lastText")
    assert page.evaluate("window.lastText").count("\n") == 1 + len(paper.data.time)
    assert page.errors == []


def test_curves_of_runs_with_other_times_are_drawn_in_one_plot(browser, paper, tmp_path, flat):
    """Between its own samples a run has no values where the other one has; its curve goes on."""
    data = paper.data.isel(time=slice(0, None, 7))
    coarse = Result(paper.scenario, data.assign(tip_error=0.5 * data.tip_error), paper.summary)
    inked = []
    for results in ((paper,), (paper, coarse)):
        (tmp_path / "page.html").write_text(animation_page(*results), encoding="utf-8")
        browser.open(f"{(tmp_path / 'page.html').as_uri()}#t=0&play=0&signals=tip error:rpr1/tip", 1000, 800)
        browser.wait_for("document.body?.dataset.ready === 'true'")
        browser.drawn()
        canvas = "document.querySelector('.panel canvas')"
        pixels = f"{canvas}.getContext('2d').getImageData(0, 0, {canvas}.width, {canvas}.height).data"
        blue = "((d) => d.filter((v, i) => i % 4 === 2 && v > d[i - 2] + 40).length)"
        inked.append(browser.evaluate(f"{blue}({pixels})"))
    assert inked[1] > 1.25 * inked[0] > 500
    assert browser.errors == []


def test_the_wheel_zooms_about_the_pointer_and_clicks_still_lead_to_their_time(shown, flat):
    page = shown()
    left, right, y = page.evaluate(SPAN)
    x = left + 0.3 * (right - left)
    for _ in range(4):
        page.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=-100)
    page.picture()
    for kind, at in (("mousePressed", x), ("mouseReleased", x)):
        page.call("Input.dispatchMouseEvent", type=kind, x=at, y=y, button="left", buttons=1, clickCount=1)
    assert float(page.evaluate("document.body.dataset.time")) == pytest.approx(3.0, abs=0.02)
    x = left + 0.8 * (right - left)
    for kind in ("mousePressed", "mouseReleased"):
        page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)
    assert float(page.evaluate("document.body.dataset.time")) == pytest.approx(3 + 5 / 1.25**4, abs=0.02)


def test_one_signal_over_another_and_a_picture_of_the_curves(shown, flat):
    page = shown("#t=5&play=0&phase=joint angle: rpr1/joint_1|joint rate: rpr1/joint_1")
    assert not page.evaluate("portrait.hidden")
    pen = "document.querySelector('#portrait canvas').getContext('2d')"
    assert page.evaluate(f"new Set({pen}.getImageData(0, 0, 280, 220).data).size") > 10
    page.evaluate("document.getElementById('plot').click()")
    kind, data = page.evaluate("window.saved[1]").split(",", 1)
    image = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))
    assert kind == "data:image/png;base64"
    assert np.ptp(image.astype(int), axis=(0, 1)).min() > 60
    page.evaluate("document.querySelector('#portrait .close').click()")
    page.wait_for("!location.hash.includes('phase')")
    assert page.errors == []


def test_limits_of_joints_are_those_of_the_urdf():
    limits = joint_limits(load_scene("servicer"))
    assert limits["joint torque", "servicer/left_joint_1"] == (-200.0, 200.0)
    assert limits["joint angle", "servicer/left_joint_2"] == pytest.approx((-120.0, 120.0), abs=1e-3)


def test_without_webgl_all_but_the_scene_works(shown, flat):
    page = shown()
    assert "cannot draw in three dimensions" in page.evaluate("pane.innerText")
    assert "t = 5.00 s" in page.evaluate("readout.innerText")
    page.evaluate("document.getElementById('play').click()")
    page.wait_for("Number(document.body.dataset.time) > 5.1")
    assert page.evaluate("document.querySelectorAll('.panel canvas').length") == 1
    assert page.errors == []


def test_many_curves_have_colours_of_their_own_that_can_be_read():
    """At least 3:1, as graphics need, against the ground in either scheme."""
    web = Path(viz.__file__).parent / "web"
    text = (web / "shapes.js").read_text(encoding="utf-8")
    listed = re.search(r"const TIP_COLOURS = \[(.*?)\];", text, re.S)[1]
    colours = np.array([[int(c[k : k + 2], 16) for k in (0, 2, 4)] for c in re.findall(r"#(\w{6})", listed)])
    share = float(
        re.search(r"Math.round\(([\d.]+) \* parseInt", (web / "theme.js").read_text(encoding="utf-8"))[1]
    )
    assert len(colours) == 24
    runs = re.search(r"const RUN_COLOURS = \[(.*), \.\.\.TIP_COLOURS.slice\(6\)\];", text)[
        1
    ]  # these over each other
    first = [[int(c[k : k + 2], 16) for k in (0, 2, 4)] for c in re.findall(r"#(\w{6})", runs)]
    for several in (colours, np.array([*first, *colours[6:]])):
        apart = np.linalg.norm(several[:, None] - several[None], axis=-1) + 999 * np.eye(24)
        assert apart.min() > 35
    for ground, shown in ((0x14, 0x1B, 0x23), colours), ((0xF5, 0xF7, 0xFA), share * colours):
        own, behind = _luminance(shown), _luminance(np.array(ground))
        ratio = (np.maximum(own, behind) + 0.05) / (np.minimum(own, behind) + 0.05)
        assert ratio.min() >= 3


def _luminance(rgb):
    part = rgb / 255
    return np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]


PLOTS = "uPlot.sync('time').plots"  # one for each panel
SPANS = f"{PLOTS}.map((plot) => [plot.scales.y.min, plot.scales.y.max])"
TITLES = "[...document.querySelectorAll('.panel')].map((e) => e.querySelector('.curves').innerText)"


def _drag(page, dragged, onto):
    page.evaluate(
        "((from, to) => { const data = new DataTransfer(), event = (kind) => new DragEvent(kind, "
        "{ dataTransfer: data, bubbles: true, cancelable: true }); from.dispatchEvent(event('dragstart')); "
        f"to.dispatchEvent(event('dragover')); to.dispatchEvent(event('drop')); }})({dragged}, {onto})"
    )


def test_a_signal_is_dragged_into_a_panel_of_its_unit_or_gets_one_of_its_own(shown, flat):
    page = shown("#t=5&play=0&signals=tip error;gap of grips;joint torque:rpr1/joint_1")
    last = "[...document.querySelectorAll('.panel')].at({}).querySelectorAll('.curves [draggable]')[0]"
    _drag(page, last.format(0), "document.querySelectorAll('.panel')[1]")
    words = page.evaluate(TITLES)
    assert len(words) == 3
    assert "rpr1 tip" not in words[0]
    assert "tip error rpr1 tip" in words[1]
    assert len(set(page.evaluate(f"{PLOTS}[1].series.slice(1).map(({{ _stroke }}) => _stroke)"))) == 3
    _drag(page, last.format(2), "document.querySelectorAll('.panel')[0]")  # another unit: below that panel
    assert "joint torque" in page.evaluate(TITLES)[1]
    wanted = "tip error:rpr2/tip;joint torque:rpr1/joint_1;gap of grips|tip error:rpr1/tip"
    page.wait_for(f"decodeURIComponent(location.hash).replace(/\\+/g, ' ').includes('signals={wanted}')")
    fragment = page.evaluate("location.hash")
    words = page.evaluate(TITLES)
    assert shown(fragment).evaluate(TITLES) == words
    assert page.errors == []


def test_a_panel_shows_the_range_of_what_is_seen_and_logarithms(shown, paper, flat):
    page = shown("#t=5&play=0&signals=tip error;tip error by axis:rpr1/tip x")
    error = np.linalg.norm(paper.data.tip_error.values, axis=-1) * 1e3
    assert page.evaluate(SPANS)[0][0] == 0
    assert error.max() <= page.evaluate(SPANS)[0][1] < 1.1 * error.max()
    for _ in range(5):
        page.evaluate("document.getElementById('nearer').click()")
    begin, end = page.evaluate(f"(({{ min, max }}) => [min, max])({PLOTS}[0].scales.x)")
    inside = (paper.data.time.values >= begin) & (paper.data.time.values <= end)
    seen = error[inside].max()
    assert seen <= page.evaluate(SPANS)[0][1] < 1.1 * seen < 0.95 * error.max()
    page.evaluate("document.querySelector('.panel .curves button:nth-of-type(2)').click()")
    least, most = page.evaluate(SPANS)[0]
    assert page.evaluate(f"{PLOTS}[0].scales.y.distr") == 3
    assert 0 < least <= error[inside].min()
    assert most >= seen
    page.wait_for("location.hash.includes('%7Elog') || location.hash.includes('~log')")
    assert page.errors == []


def test_panels_get_other_heights_by_hand_and_by_keys(shown, flat):
    page = shown("#t=5&play=0&signals=tip error;joint torque")
    heights = f"{PLOTS}.map((plot) => plot.height)"
    first = page.evaluate(heights)
    bar = "document.querySelector('.panel .divider')"
    page.evaluate(f"{bar}.dispatchEvent(new KeyboardEvent('keydown', {{ key: 'ArrowDown', bubbles: true }}))")
    assert page.evaluate(heights) == [first[0] + 12, first[1]]
    assert page.evaluate("document.body.dataset.time") == "5.000"
    x, y = page.evaluate(f"((b) => [b.left + b.width / 2, b.top + 3])({bar}.getBoundingClientRect())")
    moves = (("mouseMoved", 0), ("mousePressed", 0), ("mouseMoved", 30), ("mouseReleased", 30))
    for kind, down in moves:
        pressed = {"button": "left", "buttons": 1, "clickCount": 1} if down or "Pressed" in kind else {}
        page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y + down, **pressed)
    assert page.evaluate(heights) == [first[0] + 42, first[1]]
    page.evaluate("document.querySelector('#chart > .divider').focus()")
    stage = page.evaluate("stage.clientHeight")
    for _ in range(4):
        page.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowUp", windowsVirtualKeyCode=38)
    assert page.evaluate("stage.clientHeight") < stage
    assert page.errors == []


def test_names_are_short_and_as_in_the_result_on_demand(shown, flat):
    page = shown("#t=5&play=0")
    assert "rpr1 tip error" in page.evaluate("readout.innerText")
    page.evaluate("document.getElementById('fullnames').click()")
    assert "rpr1/tip error" in page.evaluate("readout.innerText")
    assert "rpr1/tip " in page.evaluate(TITLES)[0]
    page.wait_for("location.hash.includes('names=full')")
    assert "rpr1/tip" in shown(page.evaluate("location.hash")).evaluate(TITLES)[0]


def test_events_limits_and_half_a_phone_for_the_scene(browser, docked, tmp_path, flat):
    (tmp_path / "page.html").write_text(animation_page(docked), encoding="utf-8")
    signals = "#t=1&play=0&signals=gap of grips~limits;tip velocity;linear momentum;angular momentum by axis"
    for size in ((390, 844), (1200, 800)):
        browser.open(f"{(tmp_path / 'page.html').as_uri()}{signals}", *size)
        browser.wait_for("document.body?.dataset.ready === 'true'")
        browser.drawn()
        assert size[0] > 400 or browser.evaluate("stage.clientHeight / window.innerHeight") >= 0.5
    assert browser.evaluate(SPANS)[0][1] >= 50  # mm, the envelope's distance
    captured = next(event for event in docked.summary["events"] if event["kind"] == "captured")
    left, right, y = browser.evaluate(SPAN)
    x = left + (right - left) * captured["time_s"] / float(docked.data.time[-1])
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    assert "captured" in browser.evaluate("document.querySelector('.u-cursor-x').dataset.time")
    assert browser.errors == []


def test_the_page_is_dark_or_light_by_a_switch_which_a_link_carries(shown):
    page, ground = shown(), "getComputedStyle(document.body).backgroundColor"
    first = page.evaluate(ground)
    page.evaluate("document.getElementById('scheme').click()")
    page.wait_for("location.hash.includes('scheme=')")
    other = page.evaluate(ground)
    assert other != first
    assert shown(page.evaluate("location.hash")).evaluate(ground) == other
    assert page.errors == []


def test_errors_of_estimates_are_drawn_with_the_deviations_that_the_filter_states(browser, tmp_path):
    scene = load_scene(
        "examples/filters.yaml",
        {
            "simulation.duration": 1.0,
            "robots.chaser.estimators": {"attitude": {"kind": "attitude_filter", "attitude_deg": 0.2}},
        },
    )
    result = simulate(scene, backend="interpreted")
    title = str(result.data.attitude_estimate_error.attrs["long_name"])
    quantity = next(one for one in quantities(result) if one.title == title)
    deviation = result.data.attitude_estimate_deviation.values[:, 0]
    for k, signal in enumerate(quantity.signals):
        np.testing.assert_array_equal(signal.bound, 3 * deviation[:, k])
    write_animation(result, tmp_path / "page.html")
    browser.open((tmp_path / "page.html").as_uri() + f"#signals={quote(title)}")
    browser.wait_for("document.body?.dataset.ready === 'true'")
    browser.wait_for("chart.innerText.includes('±3 standard deviations')")
    assert browser.errors == []
