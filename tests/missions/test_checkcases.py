"""NASA's orbital check cases: rotation and translation as JEOD, one of the published tools, has them.

Rows are typed from JEOD's log of its dynamics comparison, the origin of the exo-atmospheric cases: position
and velocity in inertial axes, the matrix from inertial to body axes, body rates.
"""

import numpy as np
import pinocchio as pin
import pytest
from scipy.special import ellipj, ellipkinc

import spacerobot as sr
from tests.missions.pages import check

MU = 398600441500000.0
POSITION = np.array([-4292653.41, 955168.47, 5139356.57])
VELOCITY = np.array([109.649663, -7527.72649, 1484.521489])
POSITION_8H = np.array([-1024262.411095882, -6151093.565368023, 2599975.06217899])
CYLINDER = np.array(
    [
        [-0.6443912270931274, 0.05284210190675609, 0.7628680480341864],
        [-0.7615617870471506, -0.1345758407161209, -0.6339660776454052],
        [0.06916350883930189, -0.9894933326514259, 0.1269620166955875],
    ]
)
CASES = {
    "10A": (
        [-1.97989570839746e-05, -0.001134281491669957, 0],
        [-1.97989570839746e-05, -0.001080027400090759, -0.0007098670173048437],
        [
            [-0.1303977224153033, -0.9235551691194414, 0.3606137595567613],
            [-0.9835635249313684, 0.0746803593168579, -0.1643947576928366],
            [0.1248968631050554, -0.3761232424685627, -0.9181133263717784],
        ],
    ),
    "10B": (
        [-1.97989570839746e-05, -0.0009597485664705242, 0],
        [-1.97989570839746e-05, -0.001039371917405715, -0.00068561832106255],
        [
            [-0.08177856896790536, -0.9485199619083543, 0.3059773643898119],
            [-0.9880754391205183, 0.03697382401574778, -0.1494652566466455],
            [0.1304576263173473, -0.3145517734793856, -0.9402329442944535],
        ],
    ),
}
"""Body rates at first and after 8 h [rad/s], matrix after 8 h."""
ISS = np.array([[1.02e8, -6.96e6, -5.48e6], [-6.96e6, 0.91e8, 5.90e5], [-5.48e6, 5.90e5, 1.64e8]])
ISS_RATES = np.array([-1.37601279156209e-05, -0.001122828353510022, -0.0001133262474248273])
ISS_MATRIX = np.array(
    [
        [0.3988935218200406, 0.7169593834498936, -0.5717107666759066],
        [-0.7090296702802331, -0.1542225334434312, -0.688107794491963],
        [-0.5815160229196686, 0.6798416379285973, 0.446827105742538],
    ]
)
ISS_RATES_8H = np.array([-0.0007282187220568775, -0.0008332384627087039, -0.0002424925044840342])
ISS_MATRIX_8H = np.array(
    [
        [-0.110781359605145, -0.0346505107912517, -0.9932405712947602],
        [-0.8498349541130382, -0.5148480361227724, 0.1127477293262038],
        [-0.5152747239402747, 0.8565809020766398, 0.02758835018344352],
    ]
)
SPHERE_RATE = 0.001134454274550824
SPHERE_MATRIX = np.array(
    [
        [0.1412307175854335, -0.9892782736897275, 0.03718039289432368],
        [-0.772691975098125, -0.1336331223242703, -0.6205556383087864],
        [0.6188707425862547, 0.05891252687959725, -0.7832804849780175],
    ]
)
SPHERE_MATRIX_8H = np.array(
    [
        [0.6322077530740586, -0.2499436545972102, -0.7333767970693106],
        [-0.7726919750981422, -0.1336331223243263, -0.6205556383087529],
        [0.05710051288720835, 0.9589944515712499, -0.2776133521348992],
    ]
)


def triad():
    """World axes of the scenario (radial, along-track, cross-track at first) as columns, inertial axes."""
    radial, normal = POSITION / np.linalg.norm(POSITION), np.cross(POSITION, VELOCITY)
    normal /= np.linalg.norm(normal)
    return np.c_[radial, np.cross(normal, radial), normal]


def attitude(result):
    """Body axes to world axes (3x3) and body rates [rad/s] at the end."""
    x, y, z, w = result.data.body_orientation.values[-1, 0]
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return rotation, result.data.v.values[-1, 3:6]


def apart(first, second):
    """Angle between two rotation matrices [deg]."""
    return np.degrees(np.linalg.norm(first - second) / np.sqrt(2))


def simulate(name, changes=None):
    return sr.simulate(sr.load_scene(name, changes or {}), backend="interpreted")


def free_rates(time):
    """Body rates of the station in torque-free motion, by Jacobi's functions (Landau and Lifshitz, 37).

    With principal moments a < b < c and L^2 > 2 T b the rates are P_a cn, P_b sn, P_c dn; with L^2 < 2 T b
    the same holds with a and c exchanged. Two signs may be changed at once.
    """
    moments, axes = np.linalg.eigh(ISS)
    rates = axes.T @ ISS_RATES * np.linalg.det(axes)  # right-handed
    axes = axes * np.linalg.det(axes)
    twice, square = moments @ rates**2, moments**2 @ rates**2
    if square < twice * moments[1]:
        moments, axes, rates = moments[::-1], axes[:, ::-1], rates[::-1]
    a, b, c = moments
    most, least = twice * c - square, square - twice * a
    peak = np.sqrt([most / (a * (c - a)), most / (b * (c - b)), least / (c * (c - a))])
    signs = np.array([-1, 1, -1]) if rates[2] < 0 else np.ones(3)
    modulus = (b - a) * most / ((c - b) * least)
    first = signs * rates / peak
    phase = ellipkinc(np.arctan2(first[1], first[0]), modulus)
    sn, cn, dn, _ = ellipj(phase + np.sqrt((c - b) * least / (a * b * c)) * time, modulus)
    return axes @ (signs * peak * np.array([cn, sn, dn]))


def orbit_position(data):
    """Of the world's origin at the end in inertial axes [m], from its anomaly and radius."""
    nu = data.orbit_anomaly.values
    angle, radius = nu[-1] - nu[0], data.orbit_radius.values[-1]
    return triad() @ (radius * np.array([np.cos(angle), np.sin(angle), 0]))


def test_the_scenarios_begin_as_the_check_cases_do():
    for name, robot, matrix, axes, rates in (
        ("checkcase-10a", "cylinder", CYLINDER, triad(), CASES["10A"][0]),
        ("checkcase-9b", "iss", ISS_MATRIX, np.eye(3), ISS_RATES),
    ):
        scene = sr.load_scene(name)
        base = scene.body(robot).base
        rotation = pin.rpy.rpyToMatrix(np.radians(base.rotation_deg))
        np.testing.assert_allclose(axes @ rotation, matrix.T, atol=1e-12)
        spin = axes @ np.radians(base.spin_deg)
        np.testing.assert_allclose(spin, matrix.T @ rates, atol=1e-15)
    orbit = sr.load_scene("checkcase-10a").scenario.environment["leo"]
    energy = VELOCITY @ VELOCITY / 2 - MU / np.linalg.norm(POSITION)
    assert orbit.semi_major_axis == pytest.approx(-MU / 2 / energy, rel=1e-13)
    assert orbit.gravitational_parameter == MU


def sphere():
    """Angle [deg] between JEOD's matrix and ours after 8 h of a uniform turn, case 8B."""
    spin = np.degrees(SPHERE_MATRIX.T @ [0, -SPHERE_RATE, 0])
    changes = {
        "robots.iss.links.body": {"mass": 1, "inertia": [0.4, 0.4, 0.4, 0, 0, 0]},
        "robots.iss.base.spin_deg": spin.tolist(),
        "robots.iss.base.rotation_deg": np.degrees(pin.rpy.matrixToRpy(SPHERE_MATRIX.T)).tolist(),
        "simulation.duration": 28800,
    }
    rotation, _ = attitude(simulate("checkcase-9b", changes))
    return apart(rotation, SPHERE_MATRIX_8H.T)


def relative_motion():
    """Distance [m] from JEOD's position after 8 h, flown relative to a circular reference orbit."""
    radius = np.linalg.norm(POSITION)
    velocity = triad().T @ VELOCITY - [0, np.sqrt(MU / radius), 0]
    found = simulate(
        "checkcase-10a",
        {
            "environment.leo.semi_major_axis": radius,
            "environment.leo.eccentricity": 0,
            "robots.cylinder.base.velocity": velocity.tolist(),
            "simulation.step": 60,
        },
    )
    where = found.data.body_position.values[-1, 0]
    assert np.linalg.norm(where) > 1e5
    return np.linalg.norm(orbit_position(found.data) + triad() @ where - POSITION_8H)


def test_the_page_states_what_is_simulated():
    iss = simulate("checkcase-9b")
    rotation, rates = attitude(iss)
    exact = free_rates(26760.0)
    measured = {
        "8B, attitude, less than, deg": sphere(),
        "9B, body rates, less than, rad/s": np.abs(rates - ISS_RATES_8H).max(),
        "9B, attitude, less than, deg": apart(rotation, ISS_MATRIX_8H.T),
        "9B, body rates against Jacobi's functions, less than, rad/s": np.abs(rates - exact).max(),
        "9B, JEOD's rates against Jacobi's functions, less than, rad/s": np.abs(ISS_RATES_8H - exact).max(),
    }
    for case, (first, last, matrix) in CASES.items():
        spin = np.degrees(triad().T @ CYLINDER.T @ first)
        found = simulate("checkcase-10a", {"robots.cylinder.base.spin_deg": spin.tolist()})
        rotation, rates = attitude(found)
        measured[f"{case}, body rates, less than, rad/s"] = np.abs(rates - last).max()
        measured[f"{case}, attitude, less than, deg"] = apart(triad() @ rotation, np.transpose(matrix))
    away = np.linalg.norm(orbit_position(found.data) - POSITION_8H)
    measured["2, position on the orbit, less than, m"] = away
    measured["2, position, simulated relative to a circular reference orbit, less than, m"] = (
        relative_motion()
    )
    check("checkcases", measured)
