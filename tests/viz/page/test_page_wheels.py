"""Reaction wheels are seen to turn on the page."""

import numpy as np
import pytest

from spacerobot.common.tables import unit_scale
from spacerobot.result.table import headline
from spacerobot.simulation import simulate
from tests.oracles.small_scenes import PLANAR, small_scene
from viz.figures.wheels import wheels
from viz.page.animation import animation
from viz.page.page import animation_page
from viz.page.signals import quantities

WHEELS = {"kind": "reaction_wheels", "axes": [[0, 0, 2]], "inertia": 0.05, "speeds": [40]}


@pytest.fixture(scope="module")
def spinning():
    """A robot whose wheel without friction and torque spins at 40 rad/s."""
    changes = {
        "robots.one.actuators": {"wheels": WHEELS},
        "simulation.duration": 0.4,
        "simulation.step": 0.01,
    }
    return simulate(small_scene(PLANAR, changes), backend="interpreted")


def test_wheels_turn_by_the_integral_of_their_speeds(spinning):
    run = animation(spinning)["runs"][0]
    wheels = run["wheels"]
    assert (wheels["count"], wheels["axes"]) == (1, [[0.0, 0.0, 1.0]])
    (node,) = wheels["nodes"]
    assert (run["nodes"][node]["body"], run["nodes"][node]["base"]) == ("one", True)
    # no motor presses on the wheel: its speed relative to the base and the base's own add up to h / J
    kept = spinning.data.wheel_momentum.sel(body="one", axis="z").values / WHEELS["inertia"]
    np.testing.assert_allclose(kept, kept[0], rtol=1e-9)
    turned = spinning.array("body_angle")[:, list(spinning.array("body")).index("one")]
    expected = kept[0] * run["time"] - np.interp(run["time"], spinning.array("time"), turned - turned[0])
    np.testing.assert_allclose(wheels["angles"][:, 0] * wheels["slowed"], expected, rtol=1e-5, atol=1e-4)


def test_speeds_of_wheels_are_read_in_rpm_in_tables_figures_and_charts(spinning):
    speed = spinning.data.wheel_speed.values
    rpm = float(np.abs(speed).max()) * 60 / (2 * np.pi)
    fastest = dict(headline(spinning.summary, spinning.data))["fastest wheel"]
    assert fastest.startswith(f"{rpm:.4g} rpm (one/wheels.0")
    (panel, _) = wheels(spinning).axes[:2]
    assert panel.get_ylabel() == "wheel speeds [rpm]"
    np.testing.assert_allclose(panel.lines[0].get_ydata(), speed[:, 0] * 30 / np.pi)
    (chart,) = (one for one in quantities(spinning) if one.title == "wheel speed")
    assert chart.unit == "rpm"
    assert unit_scale("rad/s", "body_spin") == (pytest.approx(180 / np.pi), "deg/s")


def test_wheels_are_seen_through_their_base_and_can_be_hidden(browser, spinning, tmp_path):
    path = tmp_path / "page.html"
    path.write_text(animation_page(spinning), encoding="utf-8")
    browser.open(f"{path.as_uri()}#t=0.1")
    browser.wait_for("document.body?.dataset.ready === 'true'")
    pictures = [browser.picture()]
    browser.evaluate("location.hash = '#t=0.1&layers=wheels'")
    browser.wait_for("!document.getElementById('scale').innerText.includes('wheels')")
    pictures.append(browser.picture())
    assert (np.abs(pictures[0] - pictures[1]).max(axis=-1) > 20).sum() > 40
    assert not browser.errors
