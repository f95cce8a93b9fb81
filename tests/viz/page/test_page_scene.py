"""The scene of a page: what the camera shows, what lies over it, and what surrounds it."""

import numpy as np
import pytest

from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.drawing.motion import extremes, sample_motion
from viz.drawing.view import oblique
from viz.page.animation import animation
from viz.page.page import animation_page
from viz.page.planet import has_backdrop, limb_view

BOX = "const box = (part) => part.getBoundingClientRect(), named = (id) => box(document.getElementById(id));"
COVERED = f"""(() => {{ {BOX} const stage = named("stage");
  const parts = ["readout", "legend", "magnifier"].map(named);
  return parts.reduce((sum, {{ width, height }}) => sum + width * height, 0) / (stage.width * stage.height);
}})()"""
SKY = 8, 12, 20
"""Red, green and blue of the sky without stars."""
NAMES = f"""(() => {{ {BOX} const pane = named("pane");
  return [...document.querySelectorAll("#labels .name")].map((name) => [name.hidden,
    box(name).left - pane.left, box(name).top - pane.top,
    pane.right - box(name).right, pane.bottom - box(name).bottom]);
}})()"""


def test_each_shot_holds_all_bodies_while_the_camera_may_be_there(docked):
    """Until the middle of the shot before it and from that of the next: so is none cut off between two."""
    data, scene = animation(docked), docked.scene()
    assert len(data["shots"]) == 3
    times = docked.array("time")
    edges = [*(shot["time"] for shot in data["shots"]), float(times[-1])]
    for k, shot in enumerate(data["shots"]):
        low, high = np.min(shot["points"], axis=0), np.max(shot["points"], axis=0)
        rows = np.flatnonzero((times >= edges[k]) & (times <= edges[k + 1]))
        seen = extremes(sample_motion(docked, scene, rows), *np.array(data["box"]))
        assert (seen >= low - 1e-6).all()
        assert (seen <= high + 1e-6).all()


@pytest.fixture(scope="module")
def night():
    """Two satellites that drift apart for 3400 s, the last third of them in the Earth's shadow."""
    return simulate(load_scene("drift", {"simulation.duration": 3400}), backend="interpreted")


def test_shots_of_a_drift_hold_the_bodies_and_begin_near_them(night):
    """The whole motion is 100 m wide, the initial distance 15 m."""
    data, scene = animation(night), night.scene()
    times, shots = night.array("time"), data["shots"]
    for row in (0, len(times) // 2, len(times) - 1):
        points = np.array([shot["points"] for shot in shots if shot["time"] <= times[row]][-1])
        seen = extremes(sample_motion(night, scene, np.array([row])), *np.array(data["box"]))
        assert (seen >= points.min(axis=0) - 1e-6).all()
        assert (seen <= points.max(axis=0) + 1e-6).all()
    widths = [np.ptp(shot["points"], axis=0).max() for shot in shots]
    assert widths[0] < 0.3 * widths[-1]
    assert widths[-1] > 50


def test_the_night_side_of_the_earth_is_no_black_hole(browser, night, tmp_path):
    """Less than a hundredth of the picture is black, although the Earth fills a tenth of it."""
    (tmp_path / "page.html").write_text(animation_page(night), encoding="utf-8")
    browser.open(f"{(tmp_path / 'page.html').as_uri()}#t=3400&play=0", 1000, 700)
    browser.wait_for("document.body?.dataset.time === '3400.000'")
    brightness = browser.picture().sum(axis=2)
    assert (brightness < 20).mean() < 0.01


@pytest.mark.parametrize("material", ["black_paint", "black_steel", "black_foil"])
def test_a_black_body_is_brighter_than_the_sky(browser, tmp_path, material):
    """Metal and foil, which mirror the dark sky, are no darker than paint of their colour."""
    solid = "<origin/><geometry><box size='1 1 1'/></geometry>"
    (tmp_path / "box.urdf").write_text(
        f"<robot name='box'><material name='{material}'><color rgba='0.02 0.02 0.02 1'/></material>"
        f"<link name='body'><visual>{solid}<material name='{material}'/></visual><inertial><mass value='9'/>"
        "<inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link></robot>"
    )
    robots = "robots: {box: {urdf: box.urdf, base: {joint: free_flyer}}}"
    (tmp_path / "box.yaml").write_text(f"{robots}\nsimulation: {{duration: 1}}\n")
    result = simulate(load_scene(tmp_path / "box.yaml"), backend="interpreted")
    (tmp_path / "page.html").write_text(animation_page(result), encoding="utf-8")
    browser.open(f"{(tmp_path / 'page.html').as_uri()}#t=1&play=0&quality=0", 1000, 700)
    browser.wait_for("document.body?.dataset.time === '1.000'")
    pane = "(({ left, top, width, height }) => [left, top, width, height])(named('pane'))"
    left, top, width, height = browser.evaluate(f"(() => {{ {BOX} return {pane}; }})()")
    x, y = int(left + 0.5 * width), int(top + 0.5 * height)
    around = browser.picture().astype(int).sum(axis=2)[y - 150 : y + 150, x - 150 : x + 150]
    body = around[abs(around - sum(SKY)) > 3]
    assert np.quantile(body, 0.01) > 1.5 * sum(SKY)


@pytest.mark.parametrize("size", [(1440, 900), (1024, 700), (390, 844)])
def test_words_cover_less_than_a_tenth_and_names_are_inside(browser, paper, tmp_path, size):
    (tmp_path / "page.html").write_text(animation_page(paper), encoding="utf-8")
    browser.call(
        "Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=1, mobile=False
    )
    browser.open(f"{(tmp_path / 'page.html').as_uri()}#t=5&play=0")
    browser.wait_for("document.body?.dataset.time === '5.000'")
    assert browser.evaluate(COVERED) < 0.1
    browser.picture()
    names = browser.evaluate(NAMES)
    assert len(names) == 3
    for hidden, *margins in names:
        assert not hidden
        assert min(margins) >= 0


def test_the_earth_is_a_backdrop_in_space_alone():
    """On the ground, in a plane and where an orbit says where the planet is there is none."""
    scenes = {"capture": True, "ssrms": True, "docking": False, "drift": False}
    assert {name: has_backdrop(load_scene(name)) for name in scenes} == scenes
    assert not has_backdrop(load_scene("capture", {"gravity": [0, 0, -9.81]}))


@pytest.mark.parametrize("azimuth", [-60, 10, 140])
def test_a_view_in_orbit_looks_past_the_limb(azimuth):
    """500 km high, the Earth's half angle is 68 deg: the limb lies 6 deg off the middle of the picture."""
    planet = {"radius": 6378137.0, "distance": [6878137.0]}
    usual = oblique(azimuth)
    seen = limb_view(usual, planet)
    to_earth = np.degrees(np.arccos(-seen.towards @ [-1, 0, 0]))
    assert to_earth == pytest.approx(np.degrees(np.arcsin(6378137 / 6878137)) + 6, abs=1e-6)
    assert seen.towards[2] == pytest.approx(usual.towards[2])
    assert limb_view(usual, None) is usual


def test_a_view_in_a_high_orbit_looks_past_the_limb():
    """From 42164 km the Earth's half angle is 8.7 deg, less than the elevation of the usual view."""
    seen = limb_view(oblique(), {"radius": 6378137.0, "distance": [42164000.0]})
    to_earth = np.degrees(np.arccos(-seen.towards @ [-1, 0, 0]))
    assert to_earth == pytest.approx(np.degrees(np.arcsin(6378137 / 42164000)) + 6, abs=1e-6)


def test_the_first_view_is_fitted_as_any_later_one(browser, paper, tmp_path):
    """What the words leave to the scene is the same at first and after the view was reset."""
    (tmp_path / "page.html").write_text(animation_page(paper), encoding="utf-8")
    browser.open(f"{(tmp_path / 'page.html').as_uri()}#t=0&play=0", 1000, 700)
    browser.wait_for("document.body?.dataset.time === '0.000'")
    first = browser.picture()
    browser.evaluate("document.getElementById('reset').click()")
    later = browser.picture()
    assert (np.abs(first - later).sum(axis=2) > 30).mean() < 1e-3
