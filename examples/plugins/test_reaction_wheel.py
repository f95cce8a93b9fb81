"""Test of an actuator: momentum and energy balance, and the base turns less than without it."""

from pathlib import Path

import spacerobot as sr

sr.load_plugin(Path(__file__).with_name("reaction_wheel.py"))


def simulate(actuators):
    """Servicer with other actuators, the first second."""
    scene = sr.load_scene("servicer", {"robots.*.actuators": actuators, "simulation.duration": 1})
    return sr.simulate(scene, backend="interpreted")


def test_the_wheel_takes_up_momentum_of_the_base():
    """With the wheel the base turns less, and momentum and energy are conserved."""
    result, without = simulate({"yaw": {"kind": "reaction_wheel"}}), simulate({})
    assert abs(result.data.wheel_speed.sel(body="servicer").values).max() > 0
    # the audit counts the wheel: nothing is lost
    ledger = result.summary["ledger"]
    assert ledger["momentum"]["angular"]["relative_drift"] < 1e-9
    assert ledger["energy"]["relative_residual"] < 1e-6
    # the scalar part of the base's quaternion is the cosine of half its rotation
    turned, free = (
        float(each.data.body_orientation.sel(body="servicer", quaternion="w")[-1])
        for each in (result, without)
    )
    assert free < turned < 1
