"""Bases that act are seen: plumes, errors, propellant and motion in orbit, on the page and in figures."""

import numpy as np
import pytest

from spacerobot.result.result import Result
from spacerobot.simulation import simulate
from tests.oracles.small_scenes import PLANAR, small_scene
from viz.figures.collect import draw_all
from viz.page.animation import animation
from viz.page.page import animation_page
from viz.page.planet import planet_data
from viz.page.signals import quantities
from viz.recording.record import frames

NOZZLES = {
    "ahead": {"position": [0.3, 0.3, 0], "direction": [1, 0, 0]},
    "back": {"position": [-0.3, 0.3, 0], "direction": [-1, 0, 0]},
}
TURN = {"kind": "base_attitude", "kp": 60, "kd": 5, "attitude_deg": [0, 0, 40]}


@pytest.fixture(scope="module")
def fired():
    """Two robots near an orbit; one turns its base back by two thrusters."""
    changes = {
        "environment": {"leo": {"kind": "orbit", "altitude": 500e3}},
        "robots.one.controllers": {"turn": TURN},
        "robots.one.actuators": {"jets": {"kind": "thrusters", "thrust": 20, "nozzles": NOZZLES}},
        "simulation.duration": 0.5,
        "simulation.step": 0.01,
    }
    return simulate(small_scene(PLANAR, changes), backend="interpreted")


def test_the_page_has_them_as_signals_and_forces(fired):
    run = animation(fired)["runs"][0]
    greatest = np.linalg.norm(fired.data.thruster_force.values, axis=-1).max()
    assert greatest > 1
    assert run["plumes"]["greatest"] == pytest.approx(greatest)
    assert run["plumes"]["forces"].shape[1] == run["plumes"]["count"] == 2
    told = {quantity["title"]: [s["name"] for s in quantity["signals"]] for quantity in run["quantities"]}
    assert told["propellant"] == ["one"]
    assert told["thruster force"] == ["one/jets.ahead", "one/jets.back"]
    assert told["attitude error of bases by axis"] == ["one z"]
    assert told["position in Hill axes"][:2] == ["one radial", "one along-track"]


def test_a_pulse_between_two_frames_is_shown(fired):
    data = fired.data.copy(deep=True)
    size = np.linalg.norm(data.thruster_force.values, axis=-1).max(axis=1)
    kept = np.arange(len(size)) == size.argmax()
    data["thruster_force"] = data.thruster_force * kept[:, None, None]
    run = animation(Result(fired.scenario, data, fired.summary))["runs"][0]
    assert run["plumes"]["greatest"] == pytest.approx(size.max())


def test_plumes_are_seen_while_a_thruster_fires_and_can_be_hidden(browser, fired, tmp_path):
    path = tmp_path / "page.html"
    path.write_text(animation_page(fired), encoding="utf-8")
    pictures = []
    # the address names layers that differ from the beginning
    layers = "layers=names traces forces mates ghosts magnifier"
    browser.open(f"{path.as_uri()}#t=0.1&play=0&{layers} plumes")
    browser.wait_for("document.body?.dataset.ready === 'true'")
    pictures.append(browser.picture()[60:500, 250:].astype(float))
    browser.evaluate(f"location.hash = '#t=0.1&play=0&{layers}'")
    browser.wait_for("document.getElementById('scale').innerText.includes('plume')")
    pictures.append(browser.picture()[60:500, 250:].astype(float))
    assert browser.errors == []
    hidden, shown = pictures
    assert ((shown - hidden).min(axis=2) > 15).sum() > 100  # gas adds light, and takes none


def test_a_recording_shows_plumes(fired):
    data = fired.data.copy(deep=True)
    data["thruster_force"] = 0 * data.thruster_force
    orange = []
    for result in (fired, Result(fired.scenario, data, fired.summary)):
        picture = np.asarray(frames(result, rate_hz=20, size_px=(480, 300)).picture(2)).astype(float)
        orange.append(int((picture[..., 0] - picture[..., 2] > 60).sum()))
    assert orange[0] > orange[1] + 30


def test_figures_are_drawn_where_they_apply(fired):
    names = ["base_control", "relative_orbit"]
    drawn = {name: drawing for name, _, drawing in draw_all(fired, names=names)}
    assert list(drawn) == names
    titles = [axes.get_title("left") for axes in drawn["base_control"].axes]
    assert titles[0] == "one, attitude error"
    assert "thrusters up to" in titles[1]
    assert [axes.get_ylabel() for axes in drawn["relative_orbit"].axes] == ["radial [m]"]
    bare = fired.data.drop_dims("thruster").drop_vars(["base_attitude_error", "hill_position"])
    plain = Result(fired.scenario, bare, fired.summary)
    assert not list(draw_all(plain, names=names))


def test_where_nothing_leads_a_tip_bases_come_first_and_no_tip_error_is_shown(fired):
    unled = Result(fired.scenario, fired.data, {**fired.summary, "unled_tips": ["one/tip", "two/tip"]})
    pages = [animation(one) for one in (fired, unled)]
    shown = [[q["title"] for q in page["runs"][0]["quantities"]] for page in pages]
    assert pages[1]["runs"][0]["errors"] == [None, None]
    told = [{m["key"] for m in page["panel"]["metrics"]} for page in pages]
    assert told[0] - told[1] == {"tip_error_peak", "tip_error_rms"}
    assert {"propellant", "attitude_error_peak"} <= told[1]
    assert shown[0][0] == "tip error"
    assert shown[1][0] == "attitude error of bases by axis"
    assert set(shown[0]) - set(shown[1]) == {
        "tip error",
        "tip error by axis",
        "tip orientation error",
        "tip reference",
    }
    assert not {"tip_paths", "tip_errors"} & {name for name, *_ in draw_all(unled)}


def test_the_rotation_of_a_body_that_is_alone_comes_first(fired):
    """It is its orbit's origin and exchanges momentum with nothing: those curves would be straight."""
    alone = fired.data.isel(body=[0])
    lone = Result(fired.scenario, alone, {**fired.summary, "unled_tips": ["one/tip", "two/tip"]})
    titles = [quantity.title for quantity in quantities(lone)]
    assert titles[:3] == [
        "attitude error of bases by axis",
        "rotation since the start",
        "translation since the start",
    ]
    assert titles.index("position in Hill axes") > 2


def test_the_planet_is_where_the_orbit_has_it(fired):
    """A body's radial position, as the simulation reports it, lies along the way from the planet."""
    rows = np.arange(0, fired.data.sizes["time"], 7)
    planet = planet_data(fired, rows)
    angle = planet["angle"].astype(float)
    outward = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    radial = np.einsum("tbc,tc->tb", fired.array("body_position")[rows], outward)
    np.testing.assert_allclose(radial, fired.array("hill_position")[rows][..., 0], atol=1e-6)
    np.testing.assert_allclose(planet["distance"], fired.array("orbit_radius")[rows], rtol=1e-6)
    assert planet["radius"] == 6378137.0
