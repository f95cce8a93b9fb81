"""What the animated page plays of each kind of folder."""

import json

import pytest

from spacerobot.api.pictures import playback
from spacerobot.common.errors import ResultError
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from tests.oracles import one_arm


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """A folder that holds a result, and that."""
    folder = tmp_path_factory.mktemp("played")
    result = simulate(load_scene(one_arm.write(folder)))
    result.save(folder / "alone")
    return folder, result


def test_a_comparison_is_played_by_its_designs_the_untuned_one_first(arm, tmp_path):
    _, result = arm
    methods = {"ga": 0.3, "nlp": 0.25, "lost": None}
    benchmark = {
        "name": "base",
        "methods": {name: {"objective": {"best": best}} for name, best in methods.items()},
    }
    (tmp_path / "comparison.json").write_text(json.dumps({"name": "small", "problems": [benchmark]}))
    with pytest.raises(ResultError, match="no motion to play"):
        playback([tmp_path])
    for name in ("baseline", "ga", "nlp"):
        result.save(tmp_path / "base" / name)
    played = playback([tmp_path])
    assert [design["name"] for design in played.data["panel"]["designs"]] == ["baseline", "nlp", "ga"]
    assert len(played.data["runs"]) == 3
    assert played.data["panel"]["first"] == 2


def test_results_are_played_together(arm):
    folder, _ = arm
    played = playback([folder / "alone", folder / "alone"])
    assert [design["name"] for design in played.data["panel"]["designs"]] == ["alone (1)", "alone (2)"]
    assert played.data["panel"]["designs"][0]["numbers"] == {}
