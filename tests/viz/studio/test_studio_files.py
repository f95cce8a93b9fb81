"""What a studio keeps: files in its folder alone, that give the same numbers again."""

import numpy as np
import pytest

from spacerobot.common.errors import ResultError
from spacerobot.result import Result
from spacerobot.scenario.document import parse_yaml
from spacerobot.scenario.load import to_document
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.studio.bookmarks import as_yaml, place
from viz.studio.edited_text import edited

KP = "robots.arm.tips.tip.pid.kp"


def test_a_scenario_keeps_its_comments_and_says_what_changed(page, arm):
    page.ask("save", what="scenario", name="mine", values={KP: 300.0, "target.links.body.mass": 30.0})
    file = arm.parent / "kept" / "mine.yaml"
    assert page.take("saved")["path"] == str(file)
    lines = set(file.read_text().splitlines()) - set(arm.read_text().splitlines())
    assert "# an arm of ours" in file.read_text()
    assert len(lines) == 3  # the gain, the mass, and where the arm's URDF is now
    kept, wanted = load_scene(file), load_scene(arm, {KP: 300.0, "target.links.body.mass": 30.0})
    np.testing.assert_array_equal(simulate(kept).data.q.values, simulate(wanted).data.q.values)


def test_results_and_tables_are_those_of_the_design(page, arm):
    for what in ("result", "csv"):
        page.ask("save", what=what, name="kept", values={KP: 300.0})
        page.take("saved")
    result = Result.load(arm.parent / "kept" / "kept")
    table = np.genfromtxt(arm.parent / "kept" / "kept.csv", delimiter=",", names=True)
    assert to_document(result.scenario)["robots"]["arm"]["tips"]["tip"]["pid"]["kp"] == 300.0
    error = np.linalg.norm(result.data.tip_error.values[:, 0], axis=1) * 1e3
    np.testing.assert_allclose(table["tip_error_armtip_mm"], error, rtol=1e-14)


@pytest.mark.parametrize(
    "name", ["../mine", "a/b", "/etc/x", "", ".hidden", "..", "a\0b", "con", "x" * 200, "a\\b"]
)
def test_no_name_leads_out_of_the_folder(page, arm, name):
    page.ask("save", what="csv", name=name, values={})
    assert "allowed: letters" in page.take("failed")["message"]
    assert not list(arm.parent.parent.glob("mine*"))


def test_no_link_leads_out_of_the_folder(tmp_path):
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "mine.csv").symlink_to(tmp_path / "theirs.csv")
    with pytest.raises(ResultError, match="leads out"):
        place(tmp_path / "kept", "mine", "csv")


TEXT = """# ours
robots:
  a: {tip: {kp: 3}}   # gains
  b:
    # of b
    kp: 1e2
gravity: [0, 0, -9.81]
shared: &shared {x: 1}
other: *shared
"""


def test_a_text_is_changed_where_something_changed():
    changes = {"robots.a.tip.kp": 4.5, "robots.b.ki": 2, "robots.a.tip.pid.kd": 1, "gravity.2": 0.0}
    found = edited(TEXT, changes)
    document = parse_yaml(found)
    assert document["robots"] == {"a": {"tip": {"kp": 4.5, "pid": {"kd": 1}}}, "b": {"kp": 100.0, "ki": 2}}
    assert document["gravity"] == [0, 0, 0.0]
    assert all(comment in found for comment in ("# ours", "# gains", "# of b"))
    assert parse_yaml(edited(TEXT, {"robots.b": 3}))["robots"]["b"] == 3
    assert edited(TEXT, {"gravity.7": 1}) is None
    assert edited(TEXT, {"shared": 1}) is None


@pytest.mark.parametrize(
    "value", [1e-7, 300, -0.5, True, None, "base", "no", "1e3", "a: b", [1, 2.5], {"kind": "weld"}]
)
def test_values_on_a_command_line_read_back_as_themselves(value):
    assert parse_yaml(as_yaml(value)) == value
