"""Every kind of page at every size: no error, nothing wider than the screen, nothing covered, readable."""

import numpy as np
import pytest

from optim.campaign import run_campaign
from spacerobot.scene import load_scene
from tests.oracles import one_arm
from viz.page.live import LiveViewer
from viz.page.page import animation_page
from viz.report.campaign_data import campaign_page
from viz.report.comparison_section import comparison_report
from viz.report.report import report

SIZES = ((320, 640), (390, 844), (844, 390), (800, 600), (1400, 900))
CAMPAIGN = {
    "parameters": {"mass": {"paths": "target.links.body.mass", "lower": 10, "upper": 30}},
    "gains": {"soft": {"robots.*.tips.tip.pid.kp": 50}, "stiff": {"robots.*.tips.tip.pid.kp": 300}},
    "samples": 8,
    "step": 0.01,
}
LONG = "robots.rpr1.tips.tip.pid." + "a_gain_with_a_name_longer_than_any_screen_" * 3
WORDS = (
    "['readout', 'legend', 'magnifier'].map((id) => document.getElementById(id)).filter((e) => e.offsetWidth)"
)
BOXES = f"{WORDS}.map((e) => e.getBoundingClientRect()).map((b) => [b.left, b.top, b.right, b.bottom])"
PANE = "((b) => [b.left, b.top, b.right, b.bottom])(document.getElementById('pane').getBoundingClientRect())"
CONTROLS = (
    "[...document.querySelectorAll('footer button, footer select, footer input, #clock')]"
    ".filter((e) => e.offsetWidth && !e.closest('.panels')).map((e) => [e.id, e.getBoundingClientRect()])"
    ".map(([id, b]) => [id, b.left, b.top, b.right, b.bottom])"
)
CONTRAST = """
(() => {
  const light = (rgb) => rgb.slice(0, 3).map((v) => v / 255)
    .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const parts = (text) => (text.match(/[\\d.]+/g) || []).map(Number);
  const behind = (node) => {
    for (let at = node; at; at = at.parentElement) {
      const colour = parts(getComputedStyle(at).backgroundColor);
      if (colour.length === 3 || colour[3] > 0.8) return colour;
    }
    return [255, 255, 255];
  };
  const poor = [];
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const node = walk.currentNode.parentElement;
    if (!walk.currentNode.data.trim() || !node.checkVisibility({ visibilityProperty: true })) continue;
    if (node.closest('script, style, :disabled, #labels, #scale')) continue;
    const [a, b] = [light(parts(getComputedStyle(node).color)), light(behind(node))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < 4.5) poor.push(`${walk.currentNode.data.trim()}: ${ratio.toFixed(2)}`);
  }
  return poor;
})()
"""


def blank(figure, form):
    """A picture of a figure's size on which nothing is drawn."""
    width, height = (72 * inches for inches in figure.get_size_inches())
    return f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}pt" height="{height}pt"/>'.encode()


@pytest.fixture(scope="module", autouse=True)
def _blank():
    with pytest.MonkeyPatch.context() as patch:
        for home in ("report.sections", "report.campaign_section", "figures.comparison"):
            patch.setattr(f"viz.{home}.to_bytes", blank)
        yield


@pytest.fixture(scope="module")
def comparison(make_comparison, tmp_path_factory):
    gains = {LONG: 1.0} | {f"gain_{k}": 123.456 for k in range(8)}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("viz.report.sections.draw_all", lambda *_, **__: ())  # the report's page has them all
        return comparison_report(make_comparison(tmp_path_factory.mktemp("compared"), gains, []))


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    scene = load_scene(one_arm.write(folder, campaign=CAMPAIGN))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPACEROBOT_COMPILER", "none")
        run_campaign(scene, folder / "store")
        return campaign_page(folder / "store", lambda _: None)


def _look(browser, address, ready, sizes=SIZES):
    """A page at every size, opened once and then resized, without an error and no wider than the screen."""
    browser.open(address, *sizes[0])
    browser.wait_for(ready)
    for size in sizes:
        browser.resize(*size)
        browser.wait_for(f"window.innerWidth === {size[0]}")
        browser.drawn()
        assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth"), size
        assert browser.evaluate(CONTRAST) == [], size
        yield size
        assert browser.errors == [], size


@pytest.mark.parametrize("kind", ["report", "comparison", "campaign"])
def test_papers_fit(browser, kind, paper, comparison, campaign, tmp_path):
    text = report(paper) if kind == "report" else comparison if kind == "comparison" else campaign
    (tmp_path / "page.html").write_text(text, encoding="utf-8")
    widest = "Math.max(...[...document.querySelectorAll('.wide td')].map((e) => e.offsetHeight))"
    for size in _look(browser, (tmp_path / "page.html").as_uri(), "document.readyState === 'complete'"):
        # a cell squeezed to a letter a line would be thousands of pixels high
        assert browser.evaluate(widest) < 400, size


@pytest.mark.parametrize("compared", [False, True])
def test_the_animated_page_fits_and_covers_nothing(browser, compared, paper, blind, tmp_path):
    results = (blind, paper) if compared else (paper,)
    (tmp_path / "page.html").write_text(animation_page(*results), encoding="utf-8")
    address = (tmp_path / "page.html").as_uri()
    for size in _look(browser, f"{address}#t=5", "document.body?.dataset.time === '5.000'"):
        _controls_fit(browser, size)
        _scene_is_free(browser, size)
        if size != SIZES[0]:
            continue
        browser.evaluate("document.getElementById('play').click()")
        browser.wait_for("Number(document.body.dataset.time) > 5.1")
        browser.evaluate("document.getElementById('play').click()")


def test_the_live_page_fits(browser, paper):
    with LiveViewer(7460) as viewer:
        viewer.show_scene(load_scene("paper"))
        for size in _look(browser, viewer.url, "document.body?.dataset.shown === '1'", SIZES[::2]):
            _controls_fit(browser, size)
            _scene_is_free(browser, size)
        viewer.show(paper)
        for size in _look(browser, viewer.url, "document.body?.dataset.shown === '1'", SIZES[::2]):
            _controls_fit(browser, size)


def _controls_fit(browser, size):
    controls = browser.evaluate(CONTROLS)
    assert {"play", "scrub", "clock", "speed", "signals"} <= {name for name, *_ in controls} | {"clock"}
    for name, left, top, right, bottom in controls:
        assert 0 <= left < right <= size[0], (size, name)
        assert 0 <= top < bottom <= size[1], (size, name)
    for one in controls:
        for other in controls:
            apart = one[3] <= other[1] or other[3] <= one[1] or one[4] <= other[2] or other[4] <= one[2]
            assert one == other or apart, (size, one, other)


def _scene_is_free(browser, size):
    """Bodies in strong colours (gold, orange, blue) are inside the pane and behind none of the words."""
    boxes, pane = browser.evaluate(BOXES), np.array(browser.evaluate(PANE)).astype(int)
    browser.evaluate("for (const id of ['side', 'labels']) document.getElementById(id).style.opacity = 0")
    picture = browser.picture()
    strong = np.ptp(picture, axis=2) > 75
    strong[: pane[1] + 1], strong[pane[3] :] = False, False
    assert strong.sum() > 300, size
    rows, columns = np.nonzero(strong)
    assert columns.min() > 1, size
    assert columns.max() < size[0] - 2, size
    assert rows.max() < pane[3] - 2, size
    for left, top, right, bottom in np.array(boxes).astype(int):
        assert not strong[top:bottom, left:right].any(), size
