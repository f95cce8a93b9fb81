"""Allocation, pulses and tests of residuals as flight code: flown as they are simulated."""

import pytest

import spacerobot as sr
from spacerobot.flightcode.package import write_package
from tests.elements.test_momentum_observer import ALONE
from tests.elements.test_thrusters import JETS, PLATE, TEST
from tests.flightcode.conftest import software_of
from tests.flightcode.test_flight import MOTION, largest_difference
from tests.oracles.small_scenes import small_scene

PERIODIC = {"period": 0.02, "delay": 0.01}
SAMPLED = {f"robots.one.controllers.{name}.sampled": PERIODIC for name in ("turn", "stay")}
OPEN_VALVE = {f"{JETS}.detection": TEST, f"{JETS}.nozzles.a.failure": {"at": 0.117, "opening": 1.0}}
WHEELED = """
robots:
  one:
    urdf: plate.urdf
    base: {joint: free_flyer, spin_deg: [5, -8, 6], rotation_deg: [20, -30, 40]}
    controllers: {turn: {kind: base_attitude, kp: 2, kd: 2, sampled: {period: 0.02, delay: 0.01}}}
    actuators:
      wheels:
        kind: reaction_wheels
        pyramid: {}
        inertia: 0.05
        speeds: [20, -10, 5, 8]
        speed_limit: 200
        detection: {period: 0.02, speed_noise: 1.0e-3, spin_noise: 1.0e-6, allowance: 5.0e-3}
simulation: {duration: 0.6, step: 0.005}
"""
SEIZED = {"robots.one.actuators.wheels.failures": [{"wheel": 2, "at": 0.117, "mode": "seized"}]}
VISCOUS = {"robots.one.actuators.wheels.viscous": 1e-3}
OBSERVED = {
    "robots.one.joint_pd": {"kp": 20, "kd": 3, "sampled": PERIODIC},
    "robots.one.actuators": {
        "o": {"kind": "momentum_observer", "allowance": 0.02, "period": 0.02, "brake": False},
        "f": {"kind": "joint_failure", "joint": "joint_2", "mode": "weak", "remaining": 0.3, "at": 0.117},
    },
    "simulation.duration": 0.6,
}
CASES = {
    "throttled": (PLATE, SAMPLED, ["allocate"], None),
    "pulsed": (
        PLATE,
        SAMPLED | OPEN_VALVE | {f"{JETS}.mode": "pulsed"},
        ["one_jets_control", "one_jets_detection_sampled", "one_jets_a_open", "flow"],
        "one/jets.a.open",
    ),
    "seized": (
        WHEELED,
        SEIZED,
        ["allocate", "one_wheels_detection_sampled", "one_wheels_2_detected"],
        "one/wheels.2.detected",
    ),
    "observed": (ALONE, OBSERVED, ["one_o_sampled", "one_joint_2_detected"], "one/joint_2.detected"),
}


def events(result):
    return [(event["name"], pytest.approx(event["time_s"], abs=1e-9)) for event in result.summary["events"]]


def flown(scene, folder):
    """Software of a scene, and its simulations by simulated and by exported controllers."""
    software = software_of(scene)
    write_package(software, folder, "double", 20)
    library = folder / "libcontroller.so"
    results = [sr.simulate(scene, backend="interpreted", controller=one) for one in (None, library)]
    return software, *results


@pytest.mark.compiler
@pytest.mark.parametrize("case", CASES)
def test_actuators_software_flies_as_it_is_simulated(compiler, tmp_path, case):
    text, changes, functions, detected = CASES[case]
    software, simulated, result = flown(small_scene(text, changes), tmp_path)
    assert set(functions) <= {task.name for task in software.functions}
    assert not software.plant_side
    assert events(result) == events(simulated)
    names = [event["name"] for event in result.summary["events"]]
    assert detected is None or detected in names
    wrenches = {"thruster_force", "wheel_residual", "joint_residual"} & {*simulated.data.data_vars}
    assert largest_difference(simulated, result, MOTION) < 1e-12
    assert largest_difference(simulated, result, wrenches) < 1e-12


@pytest.mark.compiler
def test_what_reads_the_motion_stays_in_the_plant_and_is_named(compiler, tmp_path):
    software, simulated, result = flown(small_scene(WHEELED, VISCOUS), tmp_path)
    assert software.allocation is None
    assert "one/wheels.momentum" in software.plant_side["allocation of one/wheels"]
    assert "one/wheels.detection.sampled" in software.plant_side
    for file in ("README.md", f"{software.name}.h"):
        assert "allocation of one/wheels: it reads" in (tmp_path / file).read_text(encoding="utf-8")
    assert largest_difference(simulated, result, MOTION) < 1e-12


@pytest.mark.compiler
def test_a_brake_that_the_code_engages_stops_the_joint(compiler, tmp_path):
    changes = OBSERVED | {"robots.one.actuators.o.brake": True}
    _, simulated, result = flown(small_scene(ALONE, changes), tmp_path)
    assert events(result) == events(simulated)
    rates = result.data.joint_velocity.values[-1]
    assert abs(rates[1]) < 1e-6 < abs(rates[0])
