"""Envisat: what its page states of the scenario; the plan itself costs too much for a test."""

import numpy as np
import pinocchio as pin

import spacerobot as sr
from spacerobot.description import find_urdf
from tests.missions.pages import check


def test_the_page_states_what_the_scenario_has():
    envisat = pin.buildModelFromUrdf(str(find_urdf("envisat.urdf")), pin.JointModelFreeFlyer())
    servicer = pin.buildModelFromUrdf(str(find_urdf("debris_servicer.urdf")), pin.JointModelFreeFlyer())
    inertia, ring = envisat.inertias[1], envisat.frames[envisat.getFrameId("ring")].placement.translation
    spin = np.radians([0, 0, 3.5])
    moments, axes = np.linalg.eigh(inertia.inertia)
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
        },
    )


def test_the_servicer_begins_at_rest_relative_to_envisat():
    """Base and arm turn with Envisat: no tip motion seen from the ring, to the digits of the scenario."""
    scene = sr.load_scene("envisat", {"simulation.duration": 0.02})
    result = sr.simulate(scene, backend="interpreted")
    tip = result.data.tip_position.values[0, 0]
    velocity = result.data.tip_velocity.values[0, 0]
    np.testing.assert_allclose(velocity, np.cross(np.radians([0, 0, 3.5]), tip), atol=5e-5)
