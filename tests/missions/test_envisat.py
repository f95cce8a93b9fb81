"""Envisat: what its page states of scenario and simulation; the plan itself costs too much for a test."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import xarray as xr
from scipy.interpolate import BarycentricInterpolator

import spacerobot as sr
from benchmarks.largest_rate import beyond_reach
from spacerobot.description import find_urdf
from tests.missions.pages import check


@pytest.fixture(scope="module")
def run():
    return sr.simulate(sr.load_scene("envisat", {"simulation.step": 0.1}), backend="interpreted")


def test_the_page_states_what_the_scenario_has_and_does(run):
    envisat = pin.buildModelFromUrdf(str(find_urdf("envisat.urdf")), pin.JointModelFreeFlyer())
    servicer = pin.buildModelFromUrdf(str(find_urdf("debris_servicer.urdf")), pin.JointModelFreeFlyer())
    inertia, ring = envisat.inertias[1], envisat.frames[envisat.getFrameId("ring")].placement.translation
    spin = np.radians([0, 0, 3.5])
    moments, axes = np.linalg.eigh(inertia.inertia)
    captured, _, ended = run.summary["events"]
    planned = int(np.searchsorted(run.data.time.values, captured["time_s"] + 60))
    torque = np.abs(run.data.joint_torque.values).max(axis=0)
    check(
        "envisat",
        {
            "mass of Envisat, kg": inertia.mass,
            "smallest principal moment, kg m²": moments[0],
            "intermediate principal moment, kg m²": moments[1],
            "largest principal moment, kg m²": moments[2],
            "angle of the intermediate axis from y, deg": np.degrees(np.arccos(abs(axes[1, 1]))),
            "angular momentum at 3.5 deg/s about z, N m s": np.linalg.norm(inertia.inertia @ spin),
            "angular momentum at 5 deg/s about the intermediate axis, N m s": moments[1] * np.radians(5),
            "speed of the ring at 3.5 deg/s, m/s": np.linalg.norm(np.cross(spin, ring)),
            "mass of the servicer, kg": sum(inertia.mass for inertia in servicer.inertias),
            "captured after, s": captured["time_s"],
            "relative speed at the capture, m/s": np.linalg.norm(captured["relative_velocity_m_s"]),
            "end of the plan after, s": captured["time_s"] + 60,
            "Envisat's rate at the end of the plan, deg/s": rates(run, planned)[0],
            "servicer's rate at the end of the plan, deg/s": rates(run, planned)[1],
            "end of the run after, s": ended["time_s"],
            "largest of both rates at the end of the run, deg/s": max(rates(run, -1)[:2]),
            "largest torque of wrist_1, N m": torque[4],
            "largest torque of wrist_2 and wrist_3, N m": torque[5:].max(),
            "largest force at the ring, N": run.summary["greatest_grip"]["force_n"],
        },
    )


def rates(run, k):
    """Rates [deg/s] of Envisat and servicer, their speeds [m/s] and the largest joint rate [rad/s]."""
    v = run.data.v.values[k]
    spins = [float(np.degrees(np.linalg.norm(v[part]))) for part in (slice(-3, None), slice(3, 6))]
    return *spins, np.linalg.norm(v[-6:-3]), np.linalg.norm(v[:3]), np.abs(v[6:13]).max()


def momenta(model, q, v):
    """Linear and angular momentum about the centre of mass, and the rate of all joints' bodies as one."""
    data = model.createData()
    momentum = pin.computeCentroidalMomentum(model, data, q, v)
    pin.ccrba(model, data, q, v)
    spin = np.linalg.solve(data.Ig.inertia, momentum.angular)
    return np.linalg.norm(momentum.linear), np.linalg.norm(momentum.angular), np.degrees(np.linalg.norm(spin))


def is_at_rest(model, q, v):
    """Assert that base, Envisat, joints and momenta are at rest, and would be with locked joints."""
    for spin in (v[3:6], v[-3:]):
        assert np.degrees(np.linalg.norm(spin)) < 0.02
    for velocity in (v[:3], v[-6:-3]):
        assert np.linalg.norm(velocity) < 0.003
    assert np.abs(v[6:13]).max() < 3e-4
    linear, angular, locked = momenta(model, q, v)
    assert linear < 9400 * 0.001
    assert angular < 0.003 * 7888
    assert locked < 0.01


def test_envisat_and_the_servicer_are_at_rest_at_the_end_of_the_plan_and_a_minute_later(run):
    events = [(event["kind"], event["who"]) for event in run.summary["events"]]
    assert events == [("captured", "grip"), ("phase", "detumble"), ("end", "detumble")]
    captured, _, ended = run.summary["events"]
    assert ended["time_s"] == pytest.approx(captured["time_s"] + 120)
    assert rates(run, 0)[0] == pytest.approx(3.5)
    scene = sr.load_scene("envisat")
    end = int(np.searchsorted(run.data.time.values, captured["time_s"] + 60))
    for k in range(end, len(run.data.time)):
        is_at_rest(scene.model, run.data.q.values[k], run.data.v.values[k])


def test_no_servicer_reaches_the_ring_in_time_from_13_deg_s_on():
    """The ring is within reach at rates with a plan, and never again beyond the bound."""
    gaps = [beyond_reach(rate) for rate in (5, 11.5, 12.98, 13, 14, 16, 20, 30, 40)]
    assert max(gaps[:3]) < 0 < min(gaps[3:])
    assert gaps[0] < -15


class Replay:
    """The plan of the second phase by Runge and Kutta's method, with a weld by multipliers."""

    def __init__(self, scene):
        self.model, self.data = scene.model, scene.model.createData()
        controllers = scene.scenario.robots["servicer"].controllers
        self.arm, self.base = controllers["detumble_arm"], controllers["detumble_base"]
        with xr.open_dataset(Path(sr.__file__).parent / "scenarios/envisat.nc") as file:
            plan = file.load()
        rows = np.flatnonzero(plan.phase.values == "detumble")
        self.time, self.points = plan.time.values[rows] - plan.time.values[rows[0]], int(plan.attrs["points"])
        names = ("torque", "base_wrench", "joint_position", "joint_rate", "base_rate")
        self.table = {name: plan[name].values[rows] for name in names}
        self.frames = [self.model.getFrameId(name) for name in ("servicer/gripper", "target/ring")]

    def planned(self, t):
        """Polynomials through the points of the interval of a time."""
        inner = self.points - 1
        first = (
            min(int(np.searchsorted(self.time[inner::inner], t)), (len(self.time) - 1) // inner - 1) * inner
        )
        own = slice(first, first + self.points)
        return {
            name: BarycentricInterpolator(self.time[own], values[own])(t)
            for name, values in self.table.items()
        }

    def acceleration(self, t, q, v):
        """Solve M a + h = B u + A' w, A a = -dA/dt v."""
        plan, tau = self.planned(t), np.zeros(self.model.nv)
        rate = plan["base_rate"] - v[:6]
        tau[:6] = plan["base_wrench"] + np.repeat([self.base.kd_linear, self.base.kd_angular], 3) * rate
        error = plan["joint_position"] - q[7:14]
        tau[6:13] = plan["torque"] + self.arm.kp * error + self.arm.kd * (plan["joint_rate"] - v[6:13])
        pin.computeAllTerms(self.model, self.data, q, v)
        pin.forwardKinematics(self.model, self.data, q, v, np.zeros(self.model.nv))
        world, sides, drifts = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, [], []
        for frame in self.frames:
            sides.append(pin.getFrameJacobian(self.model, self.data, frame, world))
            drifts.append(pin.getFrameClassicalAcceleration(self.model, self.data, frame, world).vector)
        slopes, drift = sides[0] - sides[1], drifts[0] - drifts[1] + 2 * (sides[0] - sides[1]) @ v
        matrix = np.block([[self.data.M, -slopes.T], [slopes, np.zeros((6, 6))]])
        return np.linalg.solve(matrix, np.concatenate([tau - self.data.nle, -drift]))[: self.model.nv]

    def step(self, t, q, v, h):
        """Runge and Kutta's four stages on the manifold."""
        f, move = self.acceleration, lambda by: pin.integrate(self.model, q, by)
        a = f(t, q, v)
        b = f(t + h / 2, move(h / 2 * v), v + h / 2 * a)
        c = f(t + h / 2, move(h / 2 * v + h**2 / 4 * a), v + h / 2 * b)
        d = f(t + h, move(h * v + h**2 / 2 * b), v + h * c)
        return move(h * v + h**2 / 6 * (a + b + c)), v + h / 6 * (a + 2 * b + 2 * c + d)


def test_an_independent_replay_ends_at_rest(run):
    scene = sr.load_scene("envisat")
    replay, captured = Replay(scene), run.summary["events"][0]["time_s"]
    first, h = int(np.searchsorted(run.data.time.values, captured, side="right")), 0.1
    q, v, t = run.data.q.values[first], run.data.v.values[first], run.data.time.values[first] - captured
    while t < 60 - 1e-9:
        q, v = replay.step(t, q, v, min(h, 60 - t))
        t += min(h, 60 - t)
    is_at_rest(scene.model, q, v)


def test_the_servicer_begins_at_rest_relative_to_envisat():
    """Base and arm turn with Envisat: no tip motion seen from the ring, to the digits of the scenario."""
    scene = sr.load_scene("envisat", {"simulation.duration": 0.02})
    result = sr.simulate(scene, backend="interpreted")
    tip = result.data.tip_position.values[0, 0]
    velocity = result.data.tip_velocity.values[0, 0]
    np.testing.assert_allclose(velocity, np.cross(np.radians([0, 0, 3.5]), tip), atol=5e-5)
