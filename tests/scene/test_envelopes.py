"""Envelopes that can never hold are told before anything runs, and none that can."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spacerobot.scene import load_scene
from spacerobot.scene.envelope_checks import _centre, _within, envelope_warnings
from tests.oracles.free_bodies import DEEP, FLAT, free_bodies

SERVICER = load_scene("capture")


@pytest.mark.parametrize("name", ["docking", "capture"])
def test_what_ships_can_capture(name):
    assert envelope_warnings(load_scene(name)) == []


def test_a_target_that_stays_away_is_told():
    changes = {"target.base.position.0": 20.0}
    told = envelope_warnings(load_scene("capture", changes))
    assert len(told) == 2
    assert told[0].startswith("grasps.left.capture.distance: never holds: in 60 s the centres of mass")


@pytest.mark.parametrize("bases", [FLAT, DEEP], ids=["planar", "spatial"])
@pytest.mark.parametrize(("duration", "told"), [(0.2, 1), (3.0, 0)])
def test_drift_counts(tmp_path, bases, duration, told):
    """Two rigid bodies, tip and mating frame 0.1 m apart, that drift towards each other at 0.06 m/s."""
    grasp = {"kind": "point", "capture": {"distance": 0.001}}
    scene = free_bodies(tmp_path, bases, grasp, simulation={"duration": duration, "step": 0.01})
    assert len(envelope_warnings(scene)) == told


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000))
def test_a_tip_is_never_farther_from_the_centre_of_mass_than_the_bound(seed):
    scene = SERVICER
    tip = scene.tips[seed % len(scene.tips)]
    rng, data = np.random.default_rng(seed), scene.model.createData()
    q = np.array(scene.q)
    for joint in tip.body.joints:
        place = scene.model.joints[joint].idx_q
        if scene.model.joints[joint].nq == 1:
            q[place] = rng.uniform(-np.pi, np.pi)
    pin.forwardKinematics(scene.model, data, q, np.zeros(scene.model.nv))
    pin.updateFramePlacements(scene.model, data)
    centre, _ = _centre(scene, data, tip.body)
    apart = np.linalg.norm(data.oMf[tip.frame].translation - centre)
    assert apart <= _within(scene, tip.body, tip.frame) * (1 + 1e-12)
