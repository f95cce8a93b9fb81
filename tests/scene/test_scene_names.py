"""Every public function that takes a scene takes its scenario's name or file too."""

import inspect

import numpy as np
import pytest

import spacerobot as sr
from spacerobot.scene import load_scene

FUNCTIONS = {name: member for name in sr.__all__ if inspect.isfunction(member := getattr(sr, name))}
OF_SCENES = [
    name for name, function in FUNCTIONS.items() if "scene" in inspect.signature(function).parameters
]


@pytest.mark.parametrize("name", OF_SCENES)
def test_signatures_name_a_path_beside_the_scene(name):
    assert inspect.signature(FUNCTIONS[name]).parameters["scene"].annotation == "Scene | StrPath"


@pytest.mark.parametrize("name", [*OF_SCENES, "tune"])
def test_a_name_that_there_is_not_is_reported_with_the_shipped_ones(name):
    rest = {"gradient": ("tip_error_rms", ["target.mass"]), "batch": ("tip_error_rms", {"target.mass": [1]})}
    rest["vary"] = (["target.mass=1..2"],)
    with pytest.raises(sr.SpaceRobotError, match="papper: no such file, nor a shipped scenario"):
        FUNCTIONS[name]("papper", *rest.get(name, ()))


def test_a_name_a_file_and_the_scene_itself_are_linearised_alike():
    scene = load_scene("paper", {"simulation.duration": 0.02})
    expected = sr.linearise(scene, [0.0], backend="interpreted")[0]
    named = sr.linearise("paper", [0.0], backend="interpreted")[0]
    filed = sr.linearise(scene.source, [0.0], backend="interpreted")[0]
    for system in (named, filed):
        np.testing.assert_allclose(system.A, expected.A, rtol=1e-12, atol=1e-12)
    for each in ("paper", scene.source):
        assert isinstance(sr.build_closed_loop(each), sr.ClosedLoop)
