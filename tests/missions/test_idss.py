"""IDSS docking: what its page states, and the first contact by geometry alone."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import brentq

import spacerobot as sr
from tests.missions.pages import check

SHORT = {"simulation.duration": 5}
BASE = "robots.visitor.base"
MISSED = {
    f"{BASE}.position": [-0.2, 0.03, 0.04],
    f"{BASE}.velocity": [0.05, 0.028, 0.028],
    f"{BASE}.rotation_deg": [3, 2, 2],
    f"{BASE}.spin_deg": [0, 0, 0],
}
"""Slow, and fast across: a corner of the box where the campaign finds misses."""


def flown(changes):
    return sr.simulate(sr.load_scene("idss", SHORT | changes), backend="interpreted")


def first_contact(scene):
    """When a guide first meets a flank [s]: free flight of one rigid body, points and planes."""
    scenario = scene.scenario
    base, pads = scenario.robots["visitor"].base, scenario.pads
    attitude, spin = pin.rpy.rpyToMatrix(*np.radians(base.rotation_deg)), np.radians(base.spin_deg)
    behind = np.array([-2.8, 0, 0]) * 12500 / 12562.5  # the vehicle's centre of mass, with its ring
    centre = np.array(base.position) + attitude @ behind
    velocity = np.array(base.velocity) + np.cross(spin, attitude @ behind)

    def gap(time, contact):
        guide, flank = (pads[name] for name in contact.between)
        arm = pin.exp3(spin * time) @ attitude @ (np.array(guide.position) - behind)
        normal = pin.rpy.rpyToMatrix(*np.radians(flank.rotation_deg))[:, 2]
        return normal @ (centre + velocity * time + arm - flank.position) - guide.radius

    return min(brentq(gap, 0, 10, args=(contact,)) for contact in scenario.contacts.values())


@pytest.fixture(scope="module")
def nominal():
    return flown({})


def test_the_page_states_what_is_flown(nominal):
    events = [event for event in nominal.summary["events"] if event["kind"] != "phase"]
    captured = next(event for event in events if event["kind"] == "captured")
    force, torque = (np.abs(nominal.data[name].values[:, 0]) for name in ("grasp_force", "grasp_torque"))
    check(
        "idss",
        {
            "first contact, s": events[0]["time_s"],
            "the same by free flight and geometry alone (tests), s": first_contact(sr.load_scene("idss")),
            "latches close, s": captured["time_s"],
            "impulse of the latches, N s": np.linalg.norm(captured["impulses_n_s"]["latches"]),
            "largest contact force, N": nominal.summary["greatest_contact"]["force_n"],
            "axial force in the latches, N": force[:, 0].max(),
            "shear force in the latches, N": np.linalg.norm(force[:, 1:], axis=1).max(),
            "torsion in the latches, first 5 s, N m": torque[:, 0].max(),
            "bending in the latches, first 5 s, N m": np.linalg.norm(torque[:, 1:], axis=1).max(),
        },
    )
    assert nominal.summary["outcome"] == "captured"


def test_slow_and_fast_across_is_missed():
    missed = flown(MISSED | {"simulation.duration": 8, "contacts.*.longest_step": 0.02})
    assert missed.summary["outcome"] == "collided"
