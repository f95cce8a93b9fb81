"""Exported flight code that several tests use."""

import shutil

import pytest

import spacerobot as sr
from spacerobot.closedloop.loop_cache import cached_closed_loop
from spacerobot.closedloop.onboard_ports import OnboardLoopBuilder
from spacerobot.flightcode import package
from spacerobot.flightcode.extract import onboard_software
from spacerobot.flightcode.flyable import prepared_scene
from spacerobot.flightcode.package import c_compiler, write_package

STEPS = 50
"""Rows of test vectors."""
SERVICER = {
    "robots.servicer.joints.right_joint_*.locked": True,
    "robots.servicer.tips.right_tip": {},
    "simulation.duration": 1.5,
    "phases.reach.timeout": 1.0,
    "phases.reach.on_timeout": "stop",
}
"""One arm of two, and a phase that ends by time after two images of the camera."""
SHORT = {"plan.duration": 5, "simulation.duration": 9}
FLOWN = {"docking-as-flown": SHORT, "capture-as-flown": SHORT}
"""Scenarios that are flown from start to standstill, with a plan of 5 s in place of 12 s."""
QUICK = [flag if flag != "-O2" else "-O0" for flag in package.FLAGS]
"""Flags of a compiler in a hurry: without contractions, results do not depend on the optimisation."""
SPATIAL = ("capture-as-flown", "examples/capture-rendezvous.yaml")
"""Scenarios whose functions take a compiler 10 s and more to optimise."""


def software_of(scene):
    prepared = prepared_scene(scene)
    return onboard_software(prepared, cached_closed_loop(prepared, kind=OnboardLoopBuilder))


@pytest.fixture(scope="session")
def compiler():
    found = c_compiler()
    if found is None:
        pytest.skip("needs a C compiler")
    return found


@pytest.fixture(scope="session")
def export(compiler, tmp_path_factory):
    """Export a scenario once: its scene, software and folder."""
    made = {}

    def export(name, changes=()):
        key = (str(name), str(changes))
        if key not in made:
            scene = sr.load_scene(name, changes)
            software = software_of(scene)
            folder = tmp_path_factory.mktemp("flight") / "code"
            with pytest.MonkeyPatch.context() as patch:
                if name in SPATIAL:
                    patch.setattr(package, "FLAGS", QUICK)
                write_package(software, folder, "double", STEPS)
            made[key] = scene, software, folder
        return made[key]

    return export


@pytest.fixture
def program():
    """Find a program, or skip the test by its name."""

    def find(name):
        path = shutil.which(name)
        if path is None:
            pytest.skip(f"needs {name}")
        return path

    return find
