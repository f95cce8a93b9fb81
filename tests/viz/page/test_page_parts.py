"""What the animated page lets a person do: signals, seek bar, camera, pictures, links, keys."""

import itertools
import re
import time
from importlib.resources import files

import numpy as np
import pinocchio as pin
import pytest
from PIL import Image, ImageSequence

from spacerobot.dynamics.joints import read_joints
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.drawing.placements import joint_placements
from viz.page.animation import animation
from viz.page.centres_of_mass import centres_of_mass
from viz.page.es_modules import joined
from viz.page.page import animation_page
from viz.page.signals import MOST_SAMPLES, PlottedQuantity, Signal, chart_rows, quantities

READY = "document.body?.dataset.ready === 'true'"
CANVAS = "document.querySelector('.panel canvas').getBoundingClientRect()"
STYLE = "getComputedStyle(document.getElementById('chart'))"
AXIS = (
    f"((b, s) => [b.left + parseFloat(s.getPropertyValue('--axis')), b.right - parseFloat("
    f"s.getPropertyValue('--edge')), b.top + b.height / 2])({CANVAS}, {STYLE})"
)
SCRUB = (
    "((b) => [b.left, b.right, b.top + b.height / 2])"
    "(document.getElementById('scrub').getBoundingClientRect())"
)
CURVES = "document.querySelector('#chart .panels').innerText"
FRAGMENT = "decodeURIComponent(location.hash).replace(/\\+/g, ' ')"


@pytest.fixture
def shown(browser, tmp_path):
    """Function that opens a page of results."""

    def show(*results, fragment="#t=0", size=(1200, 800), **more):
        path = tmp_path / "page.html"
        path.write_text(animation_page(*results, **more), encoding="utf-8")
        browser.open(f"{path.as_uri()}{fragment}", *size)
        browser.wait_for(READY)
        return browser

    return show


def _mouse(page, kind, x, y, **more):
    page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)


def _click(page, x, y):
    for kind in ("mousePressed", "mouseReleased"):
        _mouse(page, kind, x, y, button="left", buttons=1 if kind == "mousePressed" else 0, clickCount=1)


def _key(page, key):
    code = {" ": 32, "ArrowRight": 39, "ArrowLeft": 37, "Escape": 27, "Tab": 9, "Home": 36}[key]
    text = {"text": " "} if key == " " else {}
    page.call("Input.dispatchKeyEvent", type="keyDown", key=key, windowsVirtualKeyCode=code, **text)
    page.call("Input.dispatchKeyEvent", type="keyUp", key=key, windowsVirtualKeyCode=code)


def _value(page, name):
    return float(re.search(rf"{name} (-?[\d.e-]+) ", page.evaluate(CURVES))[1])


def test_every_signal_of_a_result_can_be_chosen(shown, paper, flat):
    page = shown(paper, fragment="#t=4")
    page.evaluate("document.getElementById('signals').click()")
    found = page.evaluate("[...document.querySelectorAll('#picker summary')].map((e) => e.innerText)")
    for wanted in (
        "tip error [mm]",
        "joint torque [N m]",
        "joint angle [deg]",
        "grip force [N]",
        "energy [J]",
        "work since the start [J]",
        "angular momentum by axis [N m s]",
        "rotation since the start [deg]",
    ):
        assert wanted in found
    page.evaluate(
        "(() => { const s = document.querySelector('#picker input[type=search]');"
        " s.value = 'torque rpr1/joint_3'; s.dispatchEvent(new Event('input')); })()"
    )
    labels = "[...document.querySelectorAll('#picker label')].filter((e) => e.offsetWidth)"
    assert page.evaluate(f"{labels}.map((e) => e.innerText)") == ["rpr1 joint 3"]
    page.evaluate(f"{labels}[0].click()")
    assert page.evaluate("document.querySelectorAll('.panel').length") == 2
    torque = paper.data.joint_torque.sel(joint="rpr1/joint_3").sel(time=4.0, method="nearest")
    assert _value(page, "rpr1 joint 3") == pytest.approx(float(torque), rel=6e-3)
    page.evaluate("document.querySelector('.panel button').click()")  # the tip error goes
    assert page.evaluate("document.querySelectorAll('.panel').length") == 1
    assert page.errors == []


def test_values_under_the_pointer_are_those_of_its_time(shown, paper, flat):
    page = shown(paper, fragment="#t=1")
    left, right, y = page.evaluate(AXIS)
    _mouse(page, "mouseMoved", left + 0.6 * (right - left), y)
    error = np.linalg.norm(paper.data.tip_error.sel(tip="rpr1/tip").sel(time=6.0, method="nearest")) * 1e3
    assert _value(page, "rpr1 tip") == pytest.approx(error, rel=0.02)
    said = page.evaluate("document.querySelector('.u-cursor-x').dataset.time")
    assert float(said.removesuffix(" s")) == pytest.approx(6.0, abs=10 / (right - left))  # a pixel
    assert page.evaluate("document.body.dataset.time") == "1.000"
    _mouse(page, "mouseMoved", left, 5)
    here = np.linalg.norm(paper.data.tip_error.sel(tip="rpr1/tip").sel(time=1.0, method="nearest")) * 1e3
    assert _value(page, "rpr1 tip") == pytest.approx(here, rel=6e-3)


def test_the_seek_bar_and_the_chart_agree_on_where_a_time_is(shown, paper, flat):
    sizes = (320, 640), (844, 390), (1400, 900)
    page = shown(paper, fragment="#t=0", size=sizes[0])
    for size in sizes:
        page.resize(*size)
        page.wait_for(f"window.innerWidth === {size[0]}")
        page.drawn()
        _seek_bar_and_chart_agree(page)


def _seek_bar_and_chart_agree(page):
    left, right, y = page.evaluate(AXIS)
    start, end, below = page.evaluate(SCRUB)
    assert (start + 8, end - 8) == pytest.approx((left, right), abs=0.6)  # half a knob farther on each side
    for plot in ("panel", "axis"):
        over = (
            f"((b) => [b.left, b.right])(document.querySelector('.{plot} .u-over').getBoundingClientRect())"
        )
        assert page.evaluate(over) == pytest.approx((left, right), abs=0.6), plot
    x = left + 0.37 * (right - left)
    _click(page, x, y)
    by_chart = float(page.evaluate("document.body.dataset.time"))
    _click(page, x, below)
    assert float(page.evaluate("document.body.dataset.time")) == pytest.approx(by_chart, abs=0.02)
    assert by_chart == pytest.approx(3.7, abs=0.02)


def test_extremes_of_every_signal_reach_the_chart(paper):
    """A peak of one sample between those of an even spacing would be lost."""
    found = quantities(paper)
    count = 50 * MOST_SAMPLES
    data = paper.data.isel(time=np.arange(count) % len(paper.data.time)).assign_coords(
        time=np.linspace(0, 10, count)
    )
    spike = np.zeros(count)
    spike[12345] = 1.0
    longer = type(paper)(paper.scenario, data, paper.summary)
    rows = chart_rows(longer, [PlottedQuantity("spike", "1", [Signal("spike", spike)])])
    assert 12345 in rows
    assert len(rows) <= MOST_SAMPLES + 2
    names = {(q.title, signal.name) for q in found for signal in q.signals}
    assert len(names) == sum(len(q.signals) for q in found)
    assert all(np.isfinite(signal.values).all() for q in found for signal in q.signals)


def test_centres_of_mass_are_pinocchios_and_momentum_is_their_motion(paper):
    scene, data = paper.scene(), paper.data
    joints, q = read_joints(scene.model), data.q.values[[0, 250, 500]]
    centres, masses = centres_of_mass(scene, joint_placements(scene, joints, q))
    for configuration, found in zip(q, centres, strict=True):
        whole = pin.centerOfMass(scene.model, scene.model.createData(), configuration)
        np.testing.assert_allclose(masses @ found / masses.sum(), whole, atol=1e-12)
    both = slice(200, 202)
    moved, _ = centres_of_mass(scene, joint_placements(scene, joints, data.q.values[both]))
    velocity = np.diff(moved, axis=0)[0] / np.diff(data.time.values[both])
    momentum = data.body_momentum_linear.values[both].mean(axis=0)
    np.testing.assert_allclose(masses[:, None] * velocity, momentum, atol=1e-3 * np.abs(momentum).max())
    run = animation(paper)["runs"][0]["masses"]
    np.testing.assert_allclose(run["centres"][0, :-1], centres[0], atol=1e-6)


def test_the_momentum_of_a_robot_that_holds_nothing_is_rounding_and_is_not_drawn():
    changes = {
        "grasps": {},
        "target": None,
        "robots.rpr2.base.close_grasp": None,
        "robots.*.tips.tip.reference": {"kind": "line", "displacement": [0.01, 0, 0], "duration": 0.1},
        "simulation.duration": 0.1,
    }
    scene = load_scene("paper", changes)
    masses = animation(simulate(scene, backend="interpreted"))["runs"][0]["masses"]
    assert masses["count"] == 3
    assert masses["greatest"] == 0


def test_masses_and_momenta_are_shown_where_asked(shown, paper):
    page = shown(paper, fragment="#t=4")
    before = page.picture()
    page.evaluate("location.hash = '#t=4&layers=centres momenta'")
    page.wait_for("document.getElementById('scale').innerText.includes('momentum ')")
    after = page.picture()
    yellow = (after[:, :, 0] > 240) & (abs(after[:, :, 1] - 210) < 20) & (abs(after[:, :, 2] - 63) < 30)
    was = (before[:, :, 0] > 240) & (abs(before[:, :, 1] - 210) < 20) & (abs(before[:, :, 2] - 63) < 30)
    assert yellow.sum() > was.sum() + 30
    assert page.errors == []


def test_the_camera_follows_what_is_chosen(shown, paper):
    """The object is carried 0.2 m through the picture, and stands still where the camera goes with it."""
    label = "[...document.querySelectorAll('#labels .name')].find((e) => e.innerText === 'rectangle')"
    where = f"((e) => [parseFloat(e.style.left), parseFloat(e.style.top)])({label})"
    moved = {}
    page = shown(paper, fragment="#t=0&look=near", size=(1200, 600))
    for followed in ("", "target", "rpr1"):
        places = []
        for at in (0, 5):
            page.evaluate(f"location.hash = '#t={at}&look=near&follow={followed}'")
            page.wait_for(
                f"document.body.dataset.time === '{at}.000'"
                f" && document.getElementById('follow').value === '{followed}'"
            )
            page.drawn()
            places.append(page.evaluate(where))
        moved[followed] = np.linalg.norm(np.subtract(*places))
    assert moved[""] > 60
    assert moved["target"] < 1.5
    assert moved["rpr1"] > 20


def test_runs_over_each_other_have_colours_of_their_own(shown, paper, blind):
    page = shown(blind, paper, fragment="#t=5&arrange=over&layers=ghosts names")
    swatches = "[...document.querySelectorAll('#readout .run i')].map((e) => getComputedStyle(e).color)"
    first, second = page.evaluate(swatches)
    assert first != second
    page.evaluate("document.getElementById('side').hidden = true")
    picture = page.picture()[60:500]
    blue = (picture[:, :, 2] - picture[:, :, 0] > 60) & (picture[:, :, 2] > 150)
    orange = (picture[:, :, 0] - picture[:, :, 2] > 40) & (picture[:, :, 0] > 120)
    assert blue.sum() > 1000
    assert orange.sum() > 1000


def test_the_address_shows_the_same_view_again(shown, paper, blind):
    page = shown(blind, paper, fragment="#t=2", size=(900, 600))
    page.evaluate("document.getElementById('arrange').value = 'over'")
    page.evaluate("document.getElementById('arrange').dispatchEvent(new Event('change'))")
    page.evaluate("document.getElementById('follow').value = 'rpr2'")
    page.evaluate("document.getElementById('follow').dispatchEvent(new Event('change'))")
    page.evaluate("document.querySelector('#layers input').click()")
    page.evaluate("document.getElementById('pane').focus()")
    for _ in range(3):
        _key(page, "ArrowRight")
    page.wait_for(f"/eye=.* 0.3$/.test({FRAGMENT})")  # three turns of 0.1 rad
    fragment = page.evaluate("location.hash")
    for part in ("t=2.000", "arrange=over", "follow=rpr2", "layers=names", "signals=tip error"):
        assert part in page.evaluate(FRAGMENT)
    page.evaluate("document.activeElement.blur()")
    before = page.picture()
    again = shown(blind, paper, fragment=fragment, size=(900, 600))
    assert (np.abs(again.picture() - before).sum(axis=2) > 30).mean() < 0.002
    assert again.evaluate("document.body.dataset.time") == "2.000"
    assert again.errors == []


def test_a_picture_and_a_film_of_the_view_are_saved(shown, paper, tmp_path):
    page = shown(paper, fragment="#t=2.308&speed=10", size=(400, 360))
    folder = tmp_path / "saved"
    folder.mkdir()
    page.call("Page.setDownloadBehavior", behavior="allow", downloadPath=str(folder))
    page.evaluate("document.getElementById('picture').click()")
    image = np.asarray(Image.open(_saved(folder, ".png")).convert("RGB")).astype(int)
    gold = (image[:, :, 0] - image[:, :, 2] > 70).sum()
    assert gold > 300
    page.evaluate("document.getElementById('film').click()")
    with Image.open(_saved(folder, ".gif")) as film:
        frames = [np.asarray(frame.convert("RGB")).astype(int) for frame in ImageSequence.Iterator(film)]
        assert (film.info["duration"], film.info["loop"]) == (80, 0)
    assert len(frames) == 14  # 10 s at ten times their speed, 12.5 a second, and the end
    assert frames[3].shape == image.shape
    assert np.abs(frames[3] - image).mean() < 8  # the picture's own moment
    assert np.abs(frames[-1] - frames[0]).max() > 100
    page.wait_for("document.getElementById('busy').hidden", 60)
    page.evaluate("document.getElementById('video').click()")
    video = _saved(folder, ".mp4", ".webm").read_bytes()
    assert video[4:8] == b"ftyp" or video[:4] == b"\x1a\x45\xdf\xa3"  # MP4, or WebM
    assert len(video) > 5000
    page.wait_for("document.getElementById('busy').hidden && document.body.dataset.time === '2.308'", 60)
    assert page.errors == []
    assert [url for url in page.requests if not url.startswith(("file:", "data:", "blob:"))] == []


def _saved(folder, *endings):
    """The file with one of these endings, whole: until then it has another name."""
    end = time.monotonic() + 120
    while not (found := [file for file in folder.iterdir() if file.suffix in endings]):
        assert time.monotonic() < end, "nothing was saved"
        time.sleep(0.05)
    return found[0]


def test_keys_do_everything_and_the_focus_is_seen(shown, paper):
    page = shown(paper, fragment="#t=2", size=(800, 600))
    _key(page, "ArrowRight")
    assert page.evaluate("document.body.dataset.time") == "2.040"
    _key(page, " ")
    page.wait_for("Number(document.body.dataset.time) > 2.2")
    _key(page, " ")
    seen = set()
    for _ in range(30):
        _key(page, "Tab")
        seen.add(page.evaluate("document.activeElement.id || document.activeElement.closest('[id]')?.id"))
        assert page.evaluate(
            "document.activeElement === document.body || "
            "getComputedStyle(document.activeElement).outlineStyle !== 'none'"
        )
    assert {"pane", "legend", "play", "scrub", "speed", "signals", "more"} <= seen
    page.evaluate("document.getElementById('signals').focus()")
    _key(page, " ")
    assert not page.evaluate("document.getElementById('picker').hidden")
    _key(page, "Escape")
    assert page.evaluate("document.getElementById('picker').hidden")
    assert page.evaluate("document.activeElement.id") == "signals"
    assert page.errors == []


def test_phases_and_events_stand_above_the_seek_bar_and_lead_there(shown, docked, flat):
    page = shown(docked, fragment="#t=0&play=0")
    names = "[...document.querySelectorAll('#events .phase')].map((span) => span.textContent)"
    assert page.evaluate(names) == ["approach", "carry", "part"]
    captured = next(event["time_s"] for event in docked.summary["events"] if event["kind"] == "captured")
    tick = "document.querySelector('#events .tick[title^=\"left captured\"]')"
    page.evaluate(f"{tick}.click()")
    assert float(page.evaluate("document.body.dataset.time")) == pytest.approx(captured, abs=1e-3)
    assert page.evaluate("document.querySelector('#readout .phase').textContent") == "carry"
    found = page.evaluate(f"((box) => box.left + box.width / 2)({tick}.getBoundingClientRect())")
    left, right, _ = page.evaluate(SCRUB)
    span = right - left - 16  # the knob's centre stands half its width inside
    assert found == pytest.approx(left + 8 + captured / docked.data.time.values[-1] * span, abs=1.5)
    assert page.errors == []


def test_a_result_without_events_has_no_strip(shown, paper, flat):
    assert shown(paper).evaluate("document.getElementById('events').hidden")


def test_how_finely_the_scene_is_drawn_is_fixed_by_the_address(shown, paper):
    pixels = "document.querySelector('#pane canvas').width / document.getElementById('pane').clientWidth"
    page = shown(paper, fragment="#t=1&play=0&quality=4")
    page.drawn()
    assert page.evaluate(f"[{pixels}, spacerobotFilm.shown()]") == [pytest.approx(0.75, abs=0.01), 4]
    page.evaluate("location.hash = '#t=1&play=0&quality=3'")
    page.wait_for(f"{pixels} === 1 && spacerobotFilm.shown() === 3")
    page.evaluate("document.getElementById('scheme').click()")
    page.wait_for("location.hash.includes('scheme=') && location.hash.includes('quality=3')")


def test_a_link_is_followed_although_the_address_was_written_anew_since(shown, paper, flat):
    page = shown(paper, fragment="#t=1&play=0")
    page.evaluate("location.hash = '#t=4&play=0'; history.replaceState(null, '', '#t=1&play=0')")
    page.wait_for("document.body.dataset.time === '4.000'", timeout_s=5)


def test_a_path_is_drawn_by_few_rings_where_it_bends_and_ends_where_time_stands(browser):
    """Along a line, round a circle and back; between rings it is straight to a sixteenth of its radius."""
    angle = np.linspace(0, 2 * np.pi, 400)
    there = np.stack([np.linspace(-1, 0, 200), np.zeros(200), np.zeros(200)], axis=1)
    circle = np.stack([np.sin(angle) / 10, 0.1 - np.cos(angle) / 10, 0 * angle], axis=1)
    points, radius = np.concatenate([there, circle, there[::-1]]), 0.01
    browser.open("about:blank")
    modules = {
        "tubes.js": (files("viz") / "web" / "tubes.js").read_text(),
        "three.js": "export const THREE = { BufferAttribute: function (array) { this.array = array; },"
        " BufferGeometry: class { setAttribute(name, values) { this.attributes = { [name]: values }; }"
        " setIndex() {} setDrawRange(from, count) { this.count = count; } } };\n",
        "test.js": 'import { grow, tubeGeometry } from "./tubes.js";\n'
        f"window.made = tubeGeometry(Float32Array.from({points.ravel().tolist()}), {radius});\n"
        "window.seen = (i) => { grow({ geometry: made }, i);"
        " return [made.count / 36, ...made.attributes.position.array]; };\n",
    }
    browser.evaluate(joined("test.js", modules.__getitem__))
    places = browser.evaluate("made.userData.places")
    assert (places[0], places[-1]) == (0, len(points) - 1)
    assert len(places) < 80
    for begin, end in itertools.pairwise(places):
        along = points[end] - points[begin]
        offsets = points[begin : end + 1] - points[begin]
        share = np.clip(offsets @ along / max(along @ along, 1e-30), 0, 1)
        assert np.linalg.norm(offsets - share[:, None] * along, axis=1).max() <= radius / 16 * 1.001
    for i in (100, 300, len(points) - 1):  # on the straight part there is no ring before it but the first
        segments, *corners = browser.evaluate(f"seen({i})")
        rings = np.reshape(corners, (-1, 6, 3)).mean(axis=1)
        np.testing.assert_allclose(rings[int(segments)], points[i], atol=1e-6)
    assert browser.evaluate("seen(100)[0]") == 1
