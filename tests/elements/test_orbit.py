"""Orbits: two-body propagation in inertial axes, closed forms, exact derivatives, the ledger, refusals."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.special import ellipj

import spacerobot as sr
from spacerobot.common.errors import ScenarioError
from spacerobot.elements.environments.orbit import Orbit
from spacerobot.scenario.load import validate
from spacerobot.scene import build_scene
from tests.oracles.small_scenes import PLANAR, random_x, small_scene
from tests.oracles.two_engines import Symbolic

BUS = """<robot name="bus"><link name="bus"><inertial><origin xyz="{com}"/><mass value="200"/>
<inertia ixx="{i[0]}" iyy="{i[1]}" izz="{i[2]}" ixy="{i[3]}" ixz="0" iyz="0"/></inertial></link></robot>"""
MU = 3.986004418e14


@pytest.fixture(scope="module")
def lone(tmp_path_factory):
    """A scene of one rigid body near an orbit."""
    folder = tmp_path_factory.mktemp("orbit")

    def built(base, orbit, com="0 0 0", inertia=(20, 50, 55, 0), duration=5700.0, step=30.0):
        file = folder / "bus.urdf"
        file.write_text(BUS.format(com=com, i=inertia))
        return build_scene(
            validate(
                {
                    "environment": {"leo": {"kind": "orbit", **orbit}},
                    "robots": {"bus": {"urdf": str(file), "base": base}},
                    "simulation": {"duration": duration, "step": step, "output_step": 10 * step},
                }
            )
        )

    return built


def rolled(scene):
    return sr.simulate(scene, backend="interpreted")


def two_body(scene, times):
    """Position of the body's root link relative to a point on the reference orbit, both in inertial axes."""
    orbit, model, body = scene.scenario.environment["leo"], scene.model, scene.model.inertias[1]
    data, (nearest, axis) = model.createData(), orbit.ends()
    first, e = np.radians(orbit.true_anomaly_deg), orbit.eccentricity
    radius = nearest * (1 + e) / (1 + e * np.cos(first))
    up = np.sqrt(MU / (nearest * (1 + e))) * e * np.sin(first)
    centre, speed = np.array([radius, 0, 0]), np.array([up, np.sqrt(MU * nearest * (1 + e)) / radius, 0])

    def rate(_, x):
        place, q, v = x[:3], x[6:13], x[13:]
        pin.forwardKinematics(model, data, q)
        com, lever = data.oMi[1].act(body.lever), np.array(body.lever)
        far = np.linalg.norm(com)
        unit = data.oMi[1].rotation.T @ com / far  # the body's own axes
        force = -MU * body.mass * unit / far**2
        torque = 3 * MU / far**3 * pin.skew(unit) @ body.inertia @ unit
        outer = pin.StdVec_Force()
        outer.extend([pin.Force.Zero(), pin.Force(force, torque + pin.skew(lever) @ force)])
        spin = pin.Quaternion(q[3:]) * pin.Quaternion(np.array([*v[3:], 0.0]))
        turning = np.concatenate([data.oMi[1].rotation @ v[:3], 0.5 * spin.coeffs()])
        falling = -MU * place / np.linalg.norm(place) ** 3
        return np.concatenate([x[3:6], falling, turning, pin.aba(model, data, q, v, np.zeros(6), outer)])

    q, v = np.array(scene.q), np.array(scene.v)
    turn = pin.Quaternion(q[3:]).toRotationMatrix()
    q[:3] += centre
    v[:3] += turn.T @ speed
    x0 = np.concatenate([centre, speed, q, v])
    # steps of their own length: at orbital speed rounding is above any tolerance that would matter
    found = solve_ivp(rate, (0, times[-1]), x0, "DOP853", times, rtol=1, atol=1, max_step=15).y
    assert 2 * np.pi * np.sqrt(axis**3 / MU) < times[-1]
    return (found[6:9] - found[:3]).T


@pytest.mark.parametrize(("eccentricity", "duration"), [(0.0, 5700.0), (0.2, 7800.0)])
def test_motion_is_that_of_two_bodies_in_inertial_axes_over_an_orbit(lone, eccentricity, duration):
    base = {"position": [800, -1500, 300], "velocity": [0.2, 0.4, -0.1], "spin_deg": [0.02, -0.03, 0.06]}
    orbit = {"altitude": 400e3, "eccentricity": eccentricity, "true_anomaly_deg": 70}
    scene = lone(base, orbit, com="0.2 -0.1 0.3", inertia=(2000, 5000, 4500, 500), duration=duration)
    result = rolled(scene)
    wanted = two_body(scene, result.data.time.values)
    apart = np.linalg.norm(result.data.body_position.values[:, 0] - wanted, axis=1)
    assert apart.max() < 1e-6 * np.linalg.norm(wanted, axis=1).max()
    momentum = result.summary["ledger"]["momentum"]
    assert momentum["conserved"]
    for kind in ("linear", "angular"):
        assert momentum[kind]["relative_drift"] < 1e-9
        assert np.abs(result.data[f"impulse_{kind}"]).max() > 0.1  # and it is not for want of any
    assert result.summary["ledger"]["energy"]["relative_residual"] < 1e-8


def test_linear_motion_on_a_circle_is_clohessy_and_wiltshires(lone):
    axis, place, speed = 7e6, np.array([30.0, -50, 20]), np.array([0.02, -0.05, 0.01])
    n = np.sqrt(MU / axis**3)
    velocity = speed + np.cross([0, 0, n], place)
    base = {"position": list(place), "velocity": list(velocity)}
    scene = lone(base, {"semi_major_axis": axis, "model": "linear", "true_anomaly_deg": 30}, duration=6000.0)
    data = rolled(scene).data
    a, s, c = n * data.time.values, np.sin(n * data.time.values), np.cos(n * data.time.values)
    (x, y, z), (u, v, w) = place, speed
    wanted = np.stack(
        [
            (4 - 3 * c) * x + s / n * u + 2 / n * (1 - c) * v,
            6 * (s - a) * x + y - 2 / n * (1 - c) * u + (4 * s - 3 * a) / n * v,
            z * c + w / n * s,
        ],
        axis=1,
    )
    np.testing.assert_allclose(data.hill_position.values[:, 0], wanted, atol=1e-8 * np.abs(wanted).max())
    cross = -n * z * s + w * c
    np.testing.assert_allclose(data.hill_velocity.values[:, 0, 2], cross, atol=1e-8 * np.abs(cross).max())


def test_linear_motion_on_an_ellipse_is_yamanakas_and_ankersens(lone):
    """Their state transition, JGCD 25(1), 2002, Table 1: x along the track, y against the normal, z down."""
    e, axis, nu0 = 0.3, 1e7, np.radians(50)
    parameter = axis * (1 - e**2)
    k2 = np.sqrt(MU / parameter**3)
    place, speed = np.array([20.0, -40, 15]), np.array([0.01, 0.03, -0.02])
    turning = k2 * (1 + e * np.cos(nu0)) ** 2
    base = {"position": list(place), "velocity": list(speed + np.cross([0, 0, turning], place))}
    orbit = {"semi_major_axis": axis, "eccentricity": e, "true_anomaly_deg": 50, "model": "linear"}
    data = rolled(lone(base, orbit, duration=7200.0)).data

    def transition(nu, time):
        rho, s, c, j = 1 + e * np.cos(nu), np.sin(nu), np.cos(nu), k2 * time
        s, c = rho * s, rho * c
        s1, c1 = np.cos(nu) + e * np.cos(2 * nu), -(np.sin(nu) + e * np.sin(2 * nu))
        plane = [
            [1, -c * (1 + 1 / rho), s * (1 + 1 / rho), 3 * rho**2 * j],
            [0, s, c, 2 - 3 * e * s * j],
            [0, 2 * s, 2 * c - e, 3 * (1 - 2 * e * s * j)],
            [0, s1, c1, -3 * e * (s1 * j + s / rho**2)],
        ]
        return np.array(plane), np.array([[np.cos(nu), np.sin(nu)], [-np.sin(nu), np.cos(nu)]]), rho

    def tilde(nu, x, v):
        rho = 1 + e * np.cos(nu)
        return rho * x, -e * np.sin(nu) * x + v / (k2 * rho)

    (x, xr), (y, yr), (z, zr) = (
        tilde(nu0, *pair) for pair in ((place[1], speed[1]), (-place[2], -speed[2]), (-place[0], -speed[0]))
    )
    plane0, across0, _ = transition(nu0, 0.0)
    plane = np.linalg.solve(plane0, [x, z, xr, zr])
    across = np.linalg.solve(across0, [y, yr])
    wanted = []
    for time, nu in zip(data.time.values, data.orbit_anomaly.values, strict=True):
        moved, swung, rho = transition(nu, time)
        (along, down, *_), (normal, _) = moved @ plane, swung @ across
        wanted.append([-down / rho, along / rho, -normal / rho])
    found, scale = data.hill_position.values[:, 0], np.abs(wanted).max()
    np.testing.assert_allclose(found, wanted, atol=1e-7 * scale)


def test_a_body_librates_as_the_closed_form_says(lone):
    """I_n a'' = -3/2 n^2 (I_t - I_r) sin 2a, of any amplitude by Jacobi's functions."""
    axis, (radial, along, normal), most = 7e6, (20.0, 50.0, 55.0), np.radians(40)
    n = np.sqrt(MU / axis**3)
    slow = n * np.sqrt(3 * (along - radial) / normal)
    modulus = np.sin(most)
    base = {"spin_deg": [0, 0, np.degrees(n + slow * modulus)]}
    data = rolled(lone(base, {"semi_major_axis": axis}, duration=6000.0)).data
    time = data.time.values
    swing = np.arcsin(modulus * ellipj(slow * time, modulus**2)[0])
    turned = 2 * np.arctan2(data.body_orientation.values[:, 0, 2], data.body_orientation.values[:, 0, 3])
    np.testing.assert_allclose(np.exp(1j * (turned - n * time)), np.exp(1j * swing), atol=1e-8)
    still = rolled(lone(base, {"semi_major_axis": axis, "gravity_gradient": False}, duration=600.0)).data
    assert np.abs(still.impulse_angular).max() < 1e-12


@pytest.mark.parametrize("model", ["exact", "linear"])
def test_gradients_are_exact(lone, model):
    """Distances are of the orbit's own size, so that no number is without effect."""
    orbit = {"semi_major_axis": 8.0, "planet_radius": 0.5, "gravitational_parameter": 300.0, "model": model}
    orbit |= {"eccentricity": 0.3, "true_anomaly_deg": 40}
    base = {"position": [0.5, 1, 0.2], "velocity": [0.1, 0.2, 0], "spin_deg": [5, 0, 9]}
    scene = lone(base, orbit, com="0.1 0 0.05", duration=2.0, step=0.02)
    loop = sr.build_closed_loop(scene)
    rollout = sr.build_rollout(loop, duration_s=2.0, step_s=0.02, output_step_s=2.0, backend="interpreted")
    names = ["semi_major_axis", "eccentricity", "true_anomaly_deg", "gravitational_parameter"]
    paths = [f"environment.leo.{name}" for name in names] + ["robots.bus.base.velocity.0"]
    slopes = rollout.jacobian(wrt=paths, outputs=["hill_position", "body_rotation"]).outputs
    for k, path in enumerate(paths):
        value = loop.parameter_values[loop.index(path)]
        step = 1e-5 * abs(value)
        ends = [rollout.run({path: value + sign * step}).outputs for sign in (1, -1)]
        for name, found in slopes.items():
            difference = (ends[0][name][-1] - ends[1][name][-1]) / (2 * step)
            scale = max(1e-2, np.abs(difference).max())  # the linear model turns nothing by its velocity
            np.testing.assert_allclose(found[-1, :, k] / scale, difference / scale, atol=2e-7)


@pytest.mark.parametrize("axes", ["inertial", "rotating"])
def test_hill_velocities_are_rates_of_hill_positions_and_the_ellipse_is_that_of_its_anomaly(axes):
    """``r = a (1 - e^2) / (1 + e cos f)``, ``f' = sqrt(mu a (1 - e^2)) / r^2``; axes rotate on a circle."""
    e, a, t, h = 0.1 if axes == "inertial" else 0.0, 7.2e6, 5e3, 1e-2
    orbit = {"semi_major_axis": a, "eccentricity": e, "true_anomaly_deg": -100, "axes": axes}
    scene = small_scene(PLANAR, {"environment": {"leo": {"kind": "orbit", **orbit}}})
    loop = Symbolic(scene)
    x = random_x(scene, np.random.default_rng(1), len(loop.x0))
    rate = loop.rate(t, x)
    before, now, after = (loop.outputs(t + s * h, x + s * h * rate) for s in (-1, 0, 1))
    slope = (after["hill_position"] - before["hill_position"]) / (2 * h)
    np.testing.assert_allclose(now["hill_velocity"], slope, atol=1e-5)
    anomaly, radius = float(now["orbit_anomaly"][0]), float(now["orbit_radius"][0])
    assert radius == pytest.approx(a * (1 - e**2) / (1 + e * np.cos(anomaly)), rel=1e-12)
    turning = (after["orbit_anomaly"] - before["orbit_anomaly"])[0] / (2 * h)
    assert turning == pytest.approx(np.sqrt(MU * a * (1 - e**2)) / radius**2, rel=1e-7)


@pytest.mark.parametrize(
    ("orbit", "told"),
    [
        ({"altitude": -5e3}, "environment.leo.altitude: found -5000.0, allowed: above 0"),
        (
            {"altitude": 4e5, "eccentricity": 1},
            "environment.leo.eccentricity: found 1, allowed: at most 0.999",
        ),
        (
            {"semi_major_axis": 6.6e6, "eccentricity": 0.1},
            "semi_major_axis: the periapsis is 5.94e.06 m from",
        ),
        ({}, "give either `altitude` or `semi_major_axis`"),
        ({"altitude": 4e5, "semi_major_axis": 7e6}, "give either `altitude` or `semi_major_axis`"),
    ],
)
def test_orbits_that_are_none_are_refused_in_one_line(lone, orbit, told):
    with pytest.raises(ScenarioError, match=told) as fault:
        lone({}, orbit)
    assert "\n" not in fault.value.message


def test_what_has_no_place_beside_an_orbit_is_refused(lone):
    leo = {"kind": "orbit", "altitude": 4e5}
    with pytest.raises(ScenarioError, match=r"gravity: the world's origin falls freely with .*leo"):
        small_scene(PLANAR, {"environment": {"leo": leo}, "gravity": [0, -9.81, 0]})
    with pytest.raises(ScenarioError, match=r"environment.two: the world's origin falls with .*leo"):
        small_scene(PLANAR, {"environment": {"leo": leo, "two": leo}})
    with pytest.raises(ScenarioError, match="found planar, allowed in an environment: free_flyer"):
        small_scene(PLANAR, {"environment": {"leo": leo}, "target.base.joint": "free_flyer"})
    with pytest.raises(ScenarioError, match=r"environment.leo.kind: found 'orbits', .*did you mean orbit"):
        small_scene(PLANAR, {"environment": {"leo": {**leo, "kind": "orbits"}}})


def test_words_tell_size_period_and_rate():
    told = Orbit(altitude=400e3, eccentricity=0.1, true_anomaly_deg=180).words()
    axis = 6778137.0 / 0.9
    rate = np.degrees(np.sqrt(MU * axis * (1 - 0.1**2)) / (axis * 1.1) ** 2)
    assert f"period {2 * np.pi * np.sqrt(axis**3 / MU):.6g} s" in told
    assert f"turns by {rate:.6g} deg/s at the start" in told


def test_rotating_axes_show_the_same_motion_as_inertial_ones(lone):
    orbit = {"semi_major_axis": 7.0e6, "true_anomaly_deg": 30}
    turning = np.array([0, 0, np.sqrt(MU / 7.0e6**3)])
    place, speed, spin = (
        np.array([300.0, -500, 200]),
        np.array([0.2, -0.4, 0.1]),
        np.radians([0.2, -0.3, 0.6]),
    )
    both = []
    for axes, relative in (("inertial", 0), ("rotating", 1)):
        base = {
            "position": place.tolist(),
            "velocity": (speed - relative * np.cross(turning, place)).tolist(),
            "spin_deg": np.degrees(spin - relative * turning).tolist(),
        }
        body = {"com": "0.2 -0.1 0.3", "inertia": (20, 50, 45, 5), "duration": 2000.0, "step": 1.0}
        both.append(rolled(lone(base, orbit | {"axes": axes}, **body)))
    inertial, rotating = (one.data for one in both)
    for name, size in (("hill_position", 1e3), ("hill_velocity", 1.0)):
        np.testing.assert_allclose(inertial[name].values, rotating[name].values, atol=1e-7 * size)
    back = Rotation.from_rotvec(np.outer(rotating.time.values, turning))
    fixed, turned = (Rotation.from_quat(one.body_orientation.values[:, 0]) for one in (inertial, rotating))
    assert (fixed.inv() * back * turned).magnitude().max() < 1e-6
    ledger = both[1].summary["ledger"]
    assert ledger["momentum"]["conserved"]
    assert ledger["energy"]["relative_residual"] < 1e-8


def test_rotating_axes_need_a_circle(lone):
    with pytest.raises(ScenarioError, match="axes: found rotating"):
        lone({"position": [1, 0, 0]}, {"altitude": 4e5, "eccentricity": 0.1, "axes": "rotating"})
