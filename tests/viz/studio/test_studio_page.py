"""The studio in a real browser: numbers are changed by hand, and everything that is seen follows."""

import itertools
import json
import re
import urllib.request

import numpy as np
import pytest

from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from tests.oracles import one_arm
from tests.oracles.free_bodies import FLAT, free_bodies
from tests.viz.page.test_page_sizes import CONTRAST
from viz.studio.prepared_design import Origin
from viz.studio.server import Studio

KP = "robots.arm.tips.tip.pid.kp"
KEY = (
    "((key, shiftKey) => document.body.dispatchEvent("
    "new KeyboardEvent('keydown', {key, shiftKey, ctrlKey: true, bubbles: true})))"
)
METRIC = "Number(document.querySelector('#metrics tbody tr').dataset.value)"
WORDS = "document.querySelector('#jobs .words').textContent"
FIELD = f"document.querySelector('.slider input[type=number][aria-label^=\"{KP}\"]')"
BAR = f"document.querySelector('.slider input[type=range][aria-label=\"{KP}\"]')"
PANE = "((b) => [b.x, b.y, b.width, b.height])(document.getElementById('pane').getBoundingClientRect())"


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """A small arm's studio; what it keeps goes to ``folder``."""
    folder = tmp_path_factory.mktemp("studio")
    file = one_arm.write(folder)
    with Studio(Origin(load_scene(file), str(file)), folder / "kept", 7620) as served:
        served.file = file
        yield served


@pytest.fixture
def opened(studio, browser):
    """Function that opens the studio's page and waits for its first motion."""

    def show(fragment="#t=0.5&play=0", size=(1280, 800)):
        browser.open(f"{studio.url}{fragment}", *size)
        browser.wait_for("Number(document.body?.dataset.drawn) >= 1")
        return browser

    return show


def _slide(page, value, bar=BAR):
    """Move a slider to a notch and let it go; wait for what follows."""
    drawn = int(page.evaluate("document.body.dataset.drawn"))
    page.evaluate(f"{bar}.value = {value}")
    for kind in ("input", "change"):
        page.evaluate(f"{bar}.dispatchEvent(new Event('{kind}'))")
    page.wait_for(f"Number(document.body.dataset.drawn) > {drawn}")
    page.wait_for("!document.getElementById('status').classList.contains('busy')")


def _bookmark(page, name):
    page.evaluate(f"document.querySelector('#designs input').value = '{name}'")
    page.evaluate("document.querySelector('#designs button').click()")


def test_the_page_has_the_scene_before_its_motion_and_says_what_it_waits_for(studio, opened):
    """What the server sends first, before any simulation, is the scene as it begins."""
    with urllib.request.urlopen(studio.url) as answer:
        text = answer.read().decode()
    payload = json.loads(re.search(r'<script type="application/json" id="payload">(.*?)</script>', text)[1])
    assert payload["about"] == "the motion is being simulated"
    assert sum(len(node["solids"]) for node in payload["runs"][0]["nodes"]) > 0
    page = opened()
    assert page.evaluate("document.getElementById('busy').hidden")
    assert page.evaluate("document.getElementById('about').textContent") != payload["about"]


def test_a_slider_moves_picture_curves_and_metrics(opened, studio):
    page = opened("#t=1&play=0")
    page.evaluate("document.querySelector('#picker details').open = true")
    metric, words, before = page.evaluate(METRIC), page.evaluate("readout.innerText"), page.picture()
    _slide(page, 40)
    assert page.evaluate("document.querySelector('#picker details').open")  # the list is not made anew
    gain = float(page.evaluate(f"{FIELD}.value"))
    assert gain < 150
    x, y, width, height = map(int, page.evaluate(PANE))
    changed = np.abs(page.picture() - before).sum(axis=2)[y : y + height, x : x + width]
    assert (changed > 60).sum() > 50
    assert page.evaluate(METRIC) != metric
    result = simulate(load_scene(studio.file, {KP: gain}))
    said = page.evaluate("readout.innerText")
    error = float(np.linalg.norm(result.data.tip_error.values[-1, 0]) * 1e3)
    assert said != words
    assert float(re.search(r"error ([\d.]+) mm", said)[1]) == pytest.approx(error, rel=6e-3)
    assert "previous design" in page.evaluate("legend.textContent")
    assert "before (dashed)" in page.evaluate("document.querySelector('#chart').innerText")
    page.wait_for(
        f"{BAR}.closest('.slider').querySelector('.gradient').textContent.includes('for +10 %')", 60
    )
    assert page.errors == []
    own = ("http://127.0.0.1:", "ws://127.0.0.1:", "data:", "blob:")
    assert [url for url in page.requests if not url.startswith(own)] == []


def test_steps_are_undone_and_a_link_carries_all(opened, flat):
    page = opened()
    first = page.evaluate(METRIC)
    _slide(page, 30)
    changed, gain = page.evaluate(METRIC), page.evaluate(f"{FIELD}.value")
    page.evaluate(f"{KEY}('z', false)")
    page.wait_for(f"{METRIC} === {first!r}")
    page.evaluate(f"{KEY}('Z', true)")
    page.wait_for(f"{METRIC} === {changed!r}")
    page.evaluate("document.querySelector('#designs button').click()")
    page.wait_for("location.hash.includes('design+1')")
    fragment = page.evaluate("location.hash")
    page = opened(fragment)
    page.wait_for(f"{METRIC} === {changed!r}")
    assert page.evaluate(f"{FIELD}.value") == gain
    assert "design 1" in page.evaluate("document.querySelector('#designs table').innerText")


def test_designs_are_kept_side_by_side_compared_and_deleted(opened):
    page = opened()
    _bookmark(page, "soft")
    _slide(page, 390)
    _bookmark(page, "stiff")
    head = "[...document.querySelectorAll('#designs thead th')].map((e) => e.firstChild.firstChild.data)"
    assert page.evaluate(head) == ["this design", "soft", "stiff"]
    rows = page.evaluate("[...document.querySelectorAll('#designs tbody tr')].map((e) => e.innerText)")
    assert next(row for row in rows if "arm tip pid kp" in row).split("\t")[2] == "150"
    page.evaluate("document.querySelector('[aria-label=\"Compare with soft\"]').click()")
    page.wait_for("document.querySelector('#chart').innerText.includes('soft (dashed)')")
    page.evaluate("document.querySelector('[aria-label=\"Rename soft\"]').click()")
    page.call("Input.insertText", text="stiff")
    page.call("Input.dispatchKeyEvent", type="keyDown", key="Enter", windowsVirtualKeyCode=13, text="\r")
    assert page.evaluate(head) == ["this design", "stiff 2", "stiff"]  # names stay different
    assert "stiff 2 (dashed)" in page.evaluate("document.querySelector('#chart').innerText")
    page.evaluate(f"{KEY}('z', false)")
    page.evaluate("document.querySelector('[aria-label=\"Delete soft\"]').click()")
    assert page.evaluate(head) == ["this design", "stiff"]
    page.evaluate(f"{KEY}('z', false)")
    assert page.evaluate(head) == ["this design", "soft", "stiff"]
    page.evaluate("document.querySelector('[aria-label=\"Take soft\"]').click()")
    assert page.evaluate(f"{FIELD}.value") == "150"
    assert page.errors == []


def test_a_search_is_started_and_stopped(opened, flat):
    page = opened()
    start = page.evaluate(METRIC)
    page.evaluate("document.querySelector('#jobs .method').value = 'ga'")
    page.evaluate("document.querySelector('#jobs .tune').click()")
    page.wait_for("!document.querySelector('#jobs .stop').disabled", 60)
    page.wait_for(f"!document.querySelector('#jobs .plot').hidden && {METRIC} < {start!r}", 60)
    page.evaluate("document.querySelector('#jobs .stop').click()")
    page.wait_for(f"/^(stopped|done)/.test({WORDS})", 60)
    assert page.evaluate(METRIC) < start
    assert not page.evaluate("document.querySelector('#jobs .tune').disabled")
    page.evaluate(f"{KEY}('z', false)")  # the whole search is one step
    page.wait_for(f"{METRIC} === {start!r}")
    assert page.errors == []


def test_a_campaign_draws_its_samples(opened):
    page = opened()
    page.evaluate("document.querySelector('#jobs .samples').value = 16")
    page.evaluate(
        "window.said = []; new MutationObserver(() => said.push(document.querySelector('#jobs .words')"
        ".textContent)).observe(document.querySelector('#jobs .words'), { childList: true }); 0"
    )
    page.evaluate("document.querySelector('#jobs .campaign').click()")
    page.wait_for(f"{WORDS}.startsWith('done')", 60)
    assert "16 of 16 samples" in page.evaluate(WORDS)
    said = page.evaluate("said")
    assert "building the closed loop" in said  # before the first sample there is nothing to count
    assert not [words for words in said if "undefined" in words]
    assert "over 16 samples" in page.evaluate(
        "document.querySelector('#jobs .plot').getAttribute('aria-label')"
    )
    assert "campaign's samples" in page.evaluate("legend.textContent")
    assert "bands: 5, 25, 50, 75, 95 % quantiles of samples" in page.evaluate("chart.innerText")
    colours = "(() => { const c = document.querySelector('.panel canvas'), p = c.getContext('2d'); "
    colours += (
        "return new Set(new Uint32Array(p.getImageData(0, 0, c.width, c.height).data.buffer)).size; })()"
    )
    shaded = page.evaluate(colours)
    page.evaluate("undo.disabled || undo.click(); document.querySelector('#jobs .improve').click()")
    page.wait_for("!chart.innerText.includes('bands')")  # another search, and they are gone
    assert page.evaluate(colours) < shaded
    page.wait_for(f"{WORDS}.startsWith('done')", 60)


def test_a_design_is_saved_and_runs_again_to_the_same_numbers(opened, studio, flat):
    page = opened()
    _slide(page, 120)
    peak = page.evaluate(METRIC)
    page.evaluate("document.querySelector('#keep input').value = 'mine'")
    page.evaluate("document.querySelector('#keep .saves button').click()")
    page.wait_for("document.querySelector('#keep .words').textContent.startsWith('saved')")
    file = next(studio.session.folder.rglob("mine*.yaml"))
    again = simulate(load_scene(file))
    assert np.abs(again.data.tip_error.values).max() * 1e3 <= peak * (1 + 1e-9)
    page.wait_for("/[#&]set=/.test(location.hash)")
    changed = json.loads(page.evaluate("new URLSearchParams(location.hash.slice(1)).get('set')"))
    same = simulate(load_scene(studio.file, changed))
    assert np.array_equal(again.data.tip_error.values, same.data.tip_error.values)
    assert page.evaluate("document.querySelector('#keep textarea').value").startswith("spacerobot run")


def test_what_cannot_be_is_said_and_the_motion_stays(opened):
    page = opened()
    metric = page.evaluate(METRIC)
    typed = "((f) => {{ f.value = '{}'; f.dispatchEvent(new Event('change')); }})({})"
    page.evaluate(typed.format("-5", FIELD))
    assert not page.evaluate(f"{FIELD}.validity.valid")
    assert page.evaluate("document.body.dataset.drawn") == "1"
    assert page.evaluate(METRIC) == metric
    page.evaluate(typed.format("1e12", FIELD))
    page.wait_for("!/^(simulated|simulating)/.test(document.getElementById('status').textContent)")
    assert page.evaluate("document.querySelectorAll('#pane canvas').length") == 1
    page.evaluate(f"{KEY}('z', false)")
    page.wait_for(f"{METRIC} === {metric!r}")


def test_it_fits_every_size_and_is_readable_dark_and_light(opened, browser):
    page = opened()
    page.evaluate("for (const part of document.querySelectorAll('#panel > details')) part.open = true")
    _slide(page, 30)
    try:
        for scheme, size in itertools.product(("light", "dark"), ((390, 844), (910, 680))):
            media = [{"name": "prefers-color-scheme", "value": scheme}]
            browser.call("Emulation.setEmulatedMedia", features=media)
            page.resize(*size)
            page.wait_for(
                f"window.innerWidth === {size[0]} && document.documentElement.dataset.scheme === '{scheme}'"
            )
            page.drawn()
            assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth"), size
            for part in ("panel", "controls"):
                assert page.evaluate(f"{part}.scrollWidth <= {part}.clientWidth"), (size, part)
            assert page.evaluate(CONTRAST) == [], size
    finally:
        browser.call("Emulation.setEmulatedMedia", features=[])
    assert browser.errors == []


def test_numbers_are_found_and_pinned_by_keys(opened, flat):
    page = opened()
    page.evaluate("document.getElementById('numbers').open = true")
    page.evaluate("document.querySelector('#numbers input[type=search]').focus()")
    page.call("Input.insertText", text="amnesia.ge")
    found = "[...document.querySelectorAll('#numbers .number')].filter((e) => e.checkVisibility())"
    assert len(page.evaluate(f"{found}.map((e) => e.innerText)")) == 1
    box = f"{found}[0].querySelector('input')"
    sliders = page.evaluate("document.querySelectorAll('.slider').length")
    page.evaluate(f"{box}.focus()")
    page.call("Input.dispatchKeyEvent", type="keyDown", key=" ", windowsVirtualKeyCode=32, text=" ")
    page.call("Input.dispatchKeyEvent", type="keyUp", key=" ", windowsVirtualKeyCode=32)
    assert page.evaluate("document.querySelectorAll('.slider').length") == sliders + 1
    page.evaluate("document.querySelector('.slider:last-child input[type=range]').focus()")
    assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") != "none"
    page.call("Input.dispatchKeyEvent", type="keyDown", key="ArrowRight", windowsVirtualKeyCode=39)
    page.call("Input.dispatchKeyEvent", type="keyUp", key="ArrowRight", windowsVirtualKeyCode=39)
    page.wait_for("Number(document.body.dataset.drawn) > 1")
    assert page.evaluate("Number(document.body.dataset.time)") == 0.5  # the key was the slider's alone


def test_another_structure_is_compiled_and_undone(opened):
    page = opened()
    metric, kind = page.evaluate(METRIC), "document.querySelector('[aria-label=\"grasps.left.kind\"]')"
    page.evaluate(f"{kind}.value = 'weld'")
    page.evaluate(f"{kind}.dispatchEvent(new Event('change'))")
    page.wait_for(f"{METRIC} > 0 && {METRIC} !== {metric!r}", 60)
    assert page.evaluate("document.body.dataset.time") == "0.500"
    page.evaluate("document.getElementById('undo').click()")
    page.wait_for(f"{METRIC} === {metric!r}")
    assert page.evaluate(f"{kind}.value") == "compliant"
    assert page.errors == []


def test_an_address_that_holds_anything_does_no_harm(opened, flat):
    named = "design=garbage&design=%7B%22name%22:%22%3Cb%3E%22%7D"
    page = opened(f"#t=0.5&play=0&pins=foo;bar:1:2:log&metric=none&set=7&{named}")
    assert page.evaluate("[...document.querySelectorAll('#designs thead th')].length") == 2
    assert "<b>" in page.evaluate("document.querySelector('#designs thead').innerText")
    page.evaluate("location.hash = '#set=%7B%22nonsense.path%22:3%7D'")
    page.wait_for("document.getElementById('status').textContent.includes('nonsense')")
    assert page.evaluate(METRIC) > 0  # what was shown stays
    assert page.errors == []


def test_a_docking_is_drafted_with_its_yaml(opened):
    page = opened()
    page.evaluate("docking.open = true")
    page.wait_for("document.querySelectorAll('#docking [name=robot] option').length > 5")
    choose = "((n, v) => { const e = document.querySelector(`#docking [name=${n}]`); e.value = v; "
    choose += "e.dispatchEvent(new Event('input', { bubbles: true })); })"
    page.evaluate(f"{choose}('robot', 'planar_arm.urdf'); {choose}('target', 'rectangle.urdf')")
    page.wait_for("!document.querySelector('#docking .open').disabled", 60)
    assert "kind: rendezvous" in page.evaluate("yaml.innerText")
    assert page.evaluate("document.querySelector('#docking [name=position]').placeholder").count(",") == 2
    assert page.evaluate("title.textContent") == "my-docking"
    page.evaluate("docking.open = false")
    page.wait_for("title.textContent === 'small'")  # the design in the hand again
    assert page.evaluate("yaml.hidden")
    assert page.errors == []


def test_joints_are_moved_and_margins_computed_on_request(opened, studio, flat):
    page = opened()
    metric = page.evaluate(METRIC)
    assert page.evaluate("estimates.hidden")  # the arm has no filter
    page.evaluate("joints.open = true")
    path = "robots.arm.joints.joint_2.angle_deg"
    bar = f"document.querySelector('#joints input[type=range][aria-label=\"{path}\"]')"
    page.wait_for(f"{bar} !== null")
    _slide(page, 250, bar)
    assert page.evaluate(METRIC) != metric
    assert page.evaluate("document.body.dataset.time") == "0.000"  # how the scene begins is what is changed
    angle = float(page.evaluate(f"{bar}.closest('.slider').querySelector('input[type=number]').value"))
    peak = np.abs(simulate(load_scene(studio.file, {path: angle})).data.tip_error.values).max()
    assert page.evaluate(METRIC) == pytest.approx(1e3 * peak, rel=1e-6)
    page.evaluate("margins.open = true; document.querySelector('#margins .compute').click()")
    rows = "[...document.querySelectorAll('#margins tbody tr')].map((row) => row.cells[1].textContent)"
    page.wait_for(f"{rows}.length > 0", 60)
    disks = [float(text) for text in page.evaluate(rows) if text[0].isdigit()]
    assert disks == sorted(disks)
    words = "document.querySelector('#margins .words').textContent"
    assert page.evaluate(words).startswith(f"{len(disks)} loops at 0 s: ")
    page.evaluate("undo.click()")
    page.wait_for(f"{words}.includes('compute again')")
    assert page.errors == []


PLOTTED = """(() => {
  const Plain = uPlot;
  window.plotted = [];
  uPlot = class extends Plain {
    constructor(...all) { super(...all); plotted.push(all[1].map((column) => [...column])); }
  };
})()"""
"""Keeps the columns of every plot that is drawn from now on."""


def test_errors_of_estimates_are_drawn_in_the_bands_of_their_filters(browser, flat, tmp_path):
    file = "examples/filters.yaml"
    estimators = {"attitude": {"kind": "attitude_filter", "attitude_deg": 0.2}}
    scene = load_scene(file, {"simulation.duration": 1.0, "robots.chaser.estimators": estimators})
    data = simulate(scene, backend="interpreted").data.sel(body="chaser")
    with Studio(Origin(scene, file), tmp_path, 7640) as served:
        browser.open(f"{served.url}#play=0")
        browser.wait_for("Number(document.body?.dataset.drawn) >= 1", 60)
        browser.evaluate(PLOTTED)
        browser.evaluate("estimates.open = true")
        browser.wait_for("plotted.length >= 2")
        words = browser.evaluate("estimates.innerText")
        for name, (time, *columns) in zip(
            ("attitude_estimate", "bias_estimate"), browser.evaluate("plotted.slice(-2)"), strict=True
        ):
            error, bound = data[f"{name}_error"], 3 * data[f"{name}_deviation"].values
            assert f"{error.attrs['long_name']} [{error.attrs['units']}]" in words
            np.testing.assert_allclose(time, data.time.values, rtol=1e-6)
            edges = [sign * bound[:, axis] for axis in range(3) for sign in (1, -1)]
            np.testing.assert_allclose(columns, [*edges, *error.values.T], rtol=1e-4, atol=1e-9)
    assert browser.errors == []


RED, BLUE = (255, 92, 92), (111, 168, 255)
"""Colours of the handle's arrow along x and of its ring about z."""


def _seen_at(page, colour):
    """Page coordinates (n, 2) of the scene's pixels of a colour."""
    x, y, width, height = map(int, page.evaluate(PANE))
    scene = page.picture()[y : y + height, x : x + width].astype(int)
    rows, columns = np.nonzero(np.abs(scene - colour).sum(axis=2) < 30)
    return np.column_stack([columns + x, rows + y])


def test_the_target_is_moved_and_turned_by_its_handle_in_the_scene(tmp_path, browser):
    scene = free_bodies(
        tmp_path,
        FLAT,
        {"kind": "weld", "capture": {"distance": 0.01}},
        simulation={"duration": 0.4, "step": 0.02},
    )
    with Studio(Origin(scene), tmp_path / "kept", 7640) as served:
        browser.open(f"{served.url}#t=0.2&play=0", 1280, 800)
        browser.wait_for("Number(document.body?.dataset.drawn) >= 1")
        browser.evaluate("document.getElementById('handle').click()")
        browser.wait_for("document.body.dataset.time === '0.000'")
        browser.drawn()
        changed = "JSON.parse(new URLSearchParams(location.hash.slice(1)).get('set') || '{}')"
        for colour, by, path in (
            (BLUE, (0, -40), "target.base.rotation_deg.2"),
            (RED, (-40, 0), "target.base.position.0"),
        ):
            browser.drawn()  # the view may have widened
            pixels = _seen_at(browser, colour)
            start = (
                np.median(pixels, axis=0).round() if colour is RED else pixels[pixels[:, 0].argmin()] + [2, 0]
            )
            for kind, at in (
                ("mousePressed", start),
                ("mouseMoved", start + by),
                ("mouseReleased", start + by),
            ):
                x, y = map(float, at)
                browser.call(
                    "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1
                )
            browser.wait_for(f"{path!r} in {changed}")
            browser.wait_for("!document.getElementById('status').classList.contains('busy')")
        values = browser.evaluate(changed)
    assert set(values) == {"target.base.position.0", "target.base.rotation_deg.2"}
    assert 0.4 < values["target.base.position.0"] < 0.7  # where it began
    assert -90 < values["target.base.rotation_deg.2"] < -5  # clockwise: the left side is drawn upwards
    assert browser.errors == []
