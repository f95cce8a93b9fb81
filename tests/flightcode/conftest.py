"""Exported flight code that several tests use."""

import shutil

import pytest

import spacerobot as sr
from spacerobot.closedloop.loop_cache import cached_closed_loop
from spacerobot.closedloop.onboard_ports import OnboardLoopBuilder
from spacerobot.flightcode.extract import onboard_software
from spacerobot.flightcode.flyable import prepared_scene
from spacerobot.flightcode.package import c_compiler, write_package

STEPS = 200


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
