"""Initial states of a rendezvous: SGP4's published case, ephemerides on a known orbit, errors."""

import datetime

import numpy as np
import pytest

import spacerobot as sr
from spacerobot.common.errors import ScenarioError
from spacerobot.scenario.orbit_states import MU, read_orbit, rendezvous_start

# case of Vallado's verification of SGP4 (AIAA 2006-6753): state in TEME at 0 min [km, km/s]
TLE = (
    "1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753\n"
    "2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667\n"
)
AT_EPOCH = [7022.46529266, -1400.08296755, 0.03995155, 1.893841015, 6.405893759, 4.534807250]
START = datetime.datetime(2026, 11, 23, 12, tzinfo=datetime.UTC)


def kepler(a, e, nu):
    """State on an inclined ellipse at a true anomaly: position and velocity [m, m/s]."""
    p = a * (1 - e * e)
    r = p / (1 + e * np.cos(nu)) * np.array([np.cos(nu), np.sin(nu), 0])
    v = np.sqrt(MU / p) * np.array([-np.sin(nu), e + np.cos(nu), 0])
    c, s = np.cos(0.9), np.sin(0.9)
    tilt = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return tilt @ r, tilt @ v


def oem(path, states, step=30.0, frame="EME2000", scale="UTC"):
    """Write a message of states by anomaly; step in s."""
    lines = ["CCSDS_OEM_VERS = 2.0", "META_START", "OBJECT_NAME = ONE", "CENTER_NAME = EARTH"]
    lines += [f"REF_FRAME = {frame}", f"TIME_SYSTEM = {scale}", "META_STOP", "COMMENT states"]
    for k, (r, v) in enumerate(states):
        time = (START + datetime.timedelta(seconds=k * step)).replace(tzinfo=None).isoformat()
        lines.append(" ".join([time, *(repr(float(x / 1e3)) for x in (*r, *v))]))
    path.write_text("\n".join(lines) + "\n")
    return path


def circle(a, count=40, step=30.0, phase=0.0):
    rate = np.sqrt(MU / a**3)
    return [kepler(a, 0.0, phase + rate * k * step) for k in range(count)]


def test_sgp4_gives_the_published_state(tmp_path):
    pytest.importorskip("sgp4")
    (tmp_path / "a.tle").write_text("VANGUARD 1\n" + TLE)
    orbit = read_orbit(tmp_path / "a.tle")
    assert (orbit.name, orbit.frame, orbit.time_system) == ("VANGUARD 1", "TEME", "UTC")
    assert (
        abs((orbit.first - datetime.datetime(2000, 6, 27, 18, 50, 19, tzinfo=datetime.UTC)).total_seconds())
        < 1
    )
    np.testing.assert_allclose(orbit.state(orbit.first) / 1e3, AT_EPOCH, atol=1e-7)


def test_an_object_is_at_rest_relative_to_itself(tmp_path):
    pytest.importorskip("sgp4")
    (tmp_path / "a.tle").write_text(TLE)
    start = rendezvous_start(tmp_path / "a.tle", tmp_path / "a.tle")
    assert not start.position.any()
    r, v = np.split(1e3 * np.array(AT_EPOCH), 2)
    # vis-viva, and the radius at the true anomaly
    assert start.semi_major_axis == pytest.approx(1 / (2 / np.linalg.norm(r) - v @ v / MU), rel=1e-9)
    nu, e = np.radians(start.true_anomaly_deg), start.eccentricity
    radius = start.semi_major_axis * (1 - e * e) / (1 + e * np.cos(nu))
    assert radius == pytest.approx(np.linalg.norm(r), rel=1e-9)


def test_elements_and_relative_state_of_known_orbits(tmp_path):
    a, e, nu = 7e6, 0.05, 2.1
    chaser = oem(tmp_path / "a.oem", [kepler(a, e, nu)] * 1 + [kepler(a, e, nu + 0.03)])
    r, v = kepler(a, e, nu)
    radial, normal = r / np.linalg.norm(r), np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    axes = np.stack([radial, np.cross(normal, radial), normal])
    place, rate = np.array([10.0, -200.0, 5.0]), np.array([0.01, 0.02, -0.03])
    moved = (r + axes.T @ place, v + axes.T @ rate)
    target = oem(tmp_path / "b.oem", [moved, moved])
    start = rendezvous_start(chaser, target)
    found = [start.semi_major_axis, start.eccentricity, np.radians(start.true_anomaly_deg)]
    np.testing.assert_allclose(found, [a, e, nu], rtol=1e-8)
    np.testing.assert_allclose(start.position, place, atol=1e-5)
    np.testing.assert_allclose(start.velocity, rate, atol=1e-8)


def test_ephemerides_are_interpolated(tmp_path):
    orbit = read_orbit(oem(tmp_path / "a.oem", circle(7e6)))
    for seconds in (0.0, 7.0, 615.0, 1169.5):
        found = orbit.state(START + datetime.timedelta(seconds=seconds))
        r, v = kepler(7e6, 0.0, np.sqrt(MU / 7e6**3) * seconds)
        np.testing.assert_allclose(found[:3], r, atol=1e-3)
        np.testing.assert_allclose(found[3:], v, atol=1e-4)


def test_the_scenario_starts_there(tmp_path):
    """Two objects on one circle, 100 m apart along-track, keep their distance in the simulation."""
    a = 7e6
    chaser = oem(tmp_path / "a.oem", circle(a))
    target = oem(tmp_path / "b.oem", circle(a, phase=100.0 / a))
    start = rendezvous_start(chaser, target, "2026-11-23T12:00:00")
    np.testing.assert_allclose(start.position, [0, 100, 0], atol=1e-2)
    removed = {"grasps": {}, "target.reference": None, "robots.*.tips": {}, "target.base.close_grasp": None}
    changes = (
        removed
        | {"target.base": {"joint": "free_flyer"}}
        | dict(start.changes())
        | {"simulation.duration": 600}
    )
    result = sr.simulate(sr.load_scene("servicer", changes), backend="interpreted")
    apart = result.data.body_position.sel(body="target") - result.data.body_position.sel(body="servicer")
    np.testing.assert_allclose(np.linalg.norm(apart, axis=1), 100.0, atol=0.05)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frame": "ITRF2000"}, "found CENTER_NAME EARTH, REF_FRAME ITRF2000, allowed: EARTH, TEME"),
        ({"frame": "GCRF"}, "has the frame 'GCRF', that of the chaser is 'EME2000'; convert one"),
        ({"scale": "TAI"}, "has the time system 'TAI', that of the chaser is 'UTC'; convert one"),
    ],
)
def test_frames_and_scales_have_to_agree(tmp_path, change, message):
    chaser, target = oem(tmp_path / "a.oem", circle(7e6)), oem(tmp_path / "b.oem", circle(7e6), **change)
    with pytest.raises(ScenarioError, match=message):
        rendezvous_start(chaser, target)


def test_other_errors_are_one_line(tmp_path):
    chaser = oem(tmp_path / "a.oem", circle(7e6))
    with pytest.raises(ScenarioError, match=r"has states from .* none at 2027"):
        rendezvous_start(chaser, chaser, "2027-01-01T00:00:00")
    (tmp_path / "b.tle").write_text(TLE.replace("34.2682", "34.2683"))
    with pytest.raises(ScenarioError, match="checksum of line 2 of the elements is wrong"):
        read_orbit(tmp_path / "b.tle")
    (tmp_path / "c.tle").write_text("nothing")
    with pytest.raises(ScenarioError, match="holds neither two-line elements"):
        read_orbit(tmp_path / "c.tle")


def test_the_command_prints_sections_of_a_scenario(tmp_path, capsys):
    import yaml

    from spacerobot.cli import app

    chaser = oem(tmp_path / "a.oem", circle(7e6))
    app.command_line()(["orbit", str(chaser), str(chaser)], standalone_mode=False)
    text = capsys.readouterr().out
    assert text.startswith("# 2026-11-23T12:00:00+00:00 UTC, from states in EME2000")
    assert yaml.safe_load(text)["environment"]["orbit"]["semi_major_axis"] == pytest.approx(7e6)
