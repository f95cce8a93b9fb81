"""Names under which bodies are shown: robots' own, and that of the target's URDF."""

import pytest

from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.drawing.motion import scene_nodes
from viz.figures.bodies import object_motion
from viz.figures.ledger import ledger
from viz.page.signals import quantities


@pytest.fixture(scope="module")
def held():
    return simulate(load_scene("paper", {"simulation.duration": 0.02}), backend="interpreted")


def test_the_target_has_its_urdf_s_name_in_tables_curves_figures_and_3d(held):
    assert "maximum rotation of rectangle" in dict(held.headline())
    for quantity in quantities(held):
        names = [signal.name for signal in quantity.signals]
        assert not any(name.startswith(("object", "target")) for name in names), quantity.title
    rotation = next(q for q in quantities(held) if q.title == "rotation since the start")
    assert [signal.name for signal in rotation.signals] == ["rpr1", "rpr2", "rectangle"]
    assert "(a) rotation of rectangle" in [panel.get_title("left") for panel in object_motion(held).axes]
    drawn = {line.get_label() for panel in ledger(held).axes for line in panel.get_lines()}
    assert "rectangle" in drawn
    assert "object" not in drawn
    assert {node.label for node in scene_nodes(held.scene()) if node.body == "target"} == {"rectangle"}


@pytest.mark.parametrize(
    ("urdf", "label"),
    [
        ("envisat.urdf", "envisat"),
        ("parts/envisat.urdf.xacro", "envisat"),
        ("package://debris/urdf/envisat.urdf", "envisat"),
        ("rpr1.urdf", "object"),  # a robot has this name
    ],
)
def test_names_are_files_without_folders_and_suffixes(held, urdf, label):
    target = held.scenario.target.model_copy(update={"urdf": urdf})
    assert held.scenario.model_copy(update={"target": target}).body_label("target") == label
    assert held.scenario.body_label("rpr1") == "rpr1"
