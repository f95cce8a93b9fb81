"""Figures of plans, and pages that show a plan beside what was flown of it."""

import dataclasses
import html
import re

import numpy as np
import pytest
import yaml
from PIL import Image
from typer.testing import CliRunner

import spacerobot as sr
from optim.planning.output.constraint_values import with_flown
from optim.planning.output.plan_folder import SCENARIO, read, write
from optim.planning.search.make_plan import make_plan
from spacerobot import simulation
from spacerobot.api.pictures import playback
from spacerobot.cli.app import app
from spacerobot.common.errors import ResultError
from spacerobot.result import Result
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from tests.optim.planning.conftest import REACH
from viz.figures.plan import plan_constraints, plan_joints
from viz.figures.style import lay_out
from viz.page.plan_overlay import beside_its_plan
from viz.report.plan_section import binding, plan_report

PLAN = REACH["plan"] | {
    "intervals": 4,
    "tolerance": 1e-4,
    "duration": 2,
    "limits": {"torque": 5, "base_rotation_deg": 0.4},
    "keep_out": {"apart": {"between": ["end", "ball"], "distance": 0.02}},
    "approach_cones": {
        "mate": {"tip": "one/tip", "frame": "mate_1", "half_angle_deg": 20, "final_fraction": 0.5}
    },
}
PADS = {
    "ball": {"link": "target/body", "kind": "sphere", "radius": 0.1},
    "end": {"link": "one/link_3", "kind": "capsule", "radius": 0.05, "length": 0.1},
}


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Folders of a plan and of its flight."""
    home = tmp_path_factory.mktemp("planned")
    (home / "task.yaml").write_text(yaml.safe_dump(REACH | {"plan": PLAN, "pads": PADS}))
    write(make_plan(load_scene(home / "task.yaml"), backend="interpreted"), home / "plan")
    flown = simulate(load_scene(home / "plan" / "followed.yaml"), backend="interpreted")
    flown.save(home / "flown")
    return home / "plan", home / "flown"


def test_a_saved_plan_is_loaded_copied_and_followed(folders, tmp_path):
    plan = sr.load(folders[0])
    assert repr(plan).startswith("<PlanResult reach: 2 s, cost ")
    assert "residual" in plan._repr_html_()
    again = sr.load(plan.save(tmp_path / "copy").folder)
    assert again.data.identical(plan.data)
    assert again.summary == plan.summary
    assert again.scene().scenario == load_scene(folders[0] / "followed.yaml").scenario
    with pytest.raises(ResultError, match="no such file or folder"):
        sr.load(tmp_path / "nowhere")


def test_a_plan_in_memory_gives_the_scene_that_follows_it(folders, tmp_path):
    (tmp_path / "task.yaml").write_text(yaml.safe_dump(REACH | {"plan": PLAN, "pads": PADS}))
    plan = sr.plan(sr.load_scene(tmp_path / "task.yaml"), backend="interpreted")
    assert plan.folder is None
    scene = plan.scene()
    assert scene.scenario == plan.save(tmp_path / "plan").scene().scenario
    flown = sr.simulate(scene, backend="interpreted")
    assert flown.data.tip_position.identical(Result.load(folders[1]).data.tip_position)


def test_limits_are_drawn_and_active_ones_marked(folders):
    plan, _ = read(folders[0])
    turned = plan_constraints(plan).axes[0]
    marked = [curve.get_ydata() for curve in turned.lines if curve.get_marker() == "s"]
    np.testing.assert_allclose(np.concatenate(marked), 0.4, rtol=1e-3)
    assert len(np.concatenate(marked)) > 1
    greatest = float(np.abs(plan.torque).max())
    plan.torque_limit[:] = [-greatest, greatest]
    torques = plan_joints(plan, Result.load(folders[1])).axes[2]
    dashed = {float(c.get_ydata()[0]) for c in torques.lines if c.get_linestyle() == "--"}
    assert greatest in np.abs(list(dashed))
    assert sum(len(c.get_xdata()) for c in torques.lines if c.get_marker() == "s") == 1
    assert sum(c.get_color() == "black" for c in torques.lines) == 3  # what was flown


def test_limits_are_named_by_their_joints(folders):
    plan, _ = read(folders[0])
    greatest = float(np.abs(plan.torque).max())
    plan.torque_limit[:] = [-greatest, greatest]
    plan.torque_limit[1, 1] = 0.5 * greatest
    names = [str(joint).partition("/joint_")[2] for joint in plan.joint.values]
    torques = plan_joints(plan).axes[2]
    named = {round(float(text.xy[1]) / greatest, 6): text.get_text() for text in torques.texts}
    assert named == {-1.0: "all", 0.5: names[1], 1.0: ", ".join([names[0], *names[2:]])}
    dashed = {
        float(c.get_ydata()[0]) / greatest: c.get_color() for c in torques.lines if c.get_linestyle() == "--"
    }
    (curve,) = (c for c in torques.lines if c.get_label() == f"joint_{names[1]}")
    assert dashed[0.5] == curve.get_color() != dashed[1.0]


def test_panels_keep_their_widths_whatever_the_joints_and_constraints_are_called(folders):
    plan, _ = read(folders[0])
    long = [f"one/{letter * 20}" for letter in "abc"]
    plan = plan.assign_coords(
        joint=long, constraint_name=["a pair of links " * 5, *plan.constraint_name.values[1:]]
    )
    plan.joint_position_limit[:] = [[-2.0, 2.0], [-2.0, 2.0], [-1.0, 1.0]]
    joints, constraints = plan_joints(plan), plan_constraints(plan)
    for figure in (joints, constraints):
        lay_out(figure)
        for panel in figure.axes:
            assert panel.get_position().width > 0.15
            shown = panel._left_title.get_window_extent()
            assert shown.x1 <= figure.bbox.x1
    below = [panel.xaxis.get_tick_params()["labelbottom"] for panel in constraints.axes if panel.axison]
    assert below[-2:] == [True, True]  # each column ends with numbers


def test_figures_of_a_plan_fit_one_column(folders, tmp_path):
    ran = ["figures", str(folders[0]), "--out", str(tmp_path), "--format", "png", "--width", "single"]
    assert CliRunner().invoke(app, ran).exit_code == 0
    files = sorted(tmp_path.iterdir())
    assert [file.name for file in files] == ["convergence.png", "plan_constraints.png", "plan_joints.png"]
    for file in files:
        with Image.open(file) as picture:
            assert picture.width == pytest.approx(89 / 25.4 * 200, abs=1)
            assert picture.height <= 120 / 25.4 * 200 + 1
    refused = CliRunner().invoke(app, [*ran, "--only", "plan_joints"])
    assert "together; leave out --only" in str(refused.exception)


def test_distances_and_cones_are_drawn_with_their_limits(folders):
    plan, _ = read(folders[0])
    titles = [panel.get_title("left") for panel in plan_constraints(plan).axes if panel.axison]
    assert titles == ["base rotation of one", "apart: end to ball", "mate: off the cone's axis"]
    turned = plan.constraint.sel(constraint_name="base rotation of one").values
    assert turned.max() == pytest.approx(np.radians(0.4), rel=1e-6)
    limits = plan.constraint_limit.sel(constraint_name="apart: end to ball").values
    np.testing.assert_allclose(limits, [0.02, np.inf])
    assert plan.constraint_begin.values[-1] == pytest.approx(1.0)


def test_what_was_flown_is_drawn_over_the_limits(folders):
    (plan, _), flown = read(folders[0]), Result.load(folders[1]).data
    both = with_flown(plan, load_scene(folders[0] / "scenario.yaml"), flown)
    for name in plan.constraint_name.values:
        own = both.sel(constraint_name=name)
        planned = np.interp(flown.time.values, plan.time.values, own.constraint.values)
        np.testing.assert_allclose(own.constraint_flown.values, planned, atol=2e-3)  # straight between knots
        assert np.abs(own.constraint_flown.values[[0, -1]] - own.constraint.values[[0, -1]]).max() < 1e-4
    panel = plan_constraints(both).axes[0]
    assert sum(curve.get_color() == "black" for curve in panel.lines) == 1


def test_a_flight_is_played_over_its_plan(folders, tmp_path, monkeypatch):
    plan, flown = map(str, folders)
    html = tmp_path / "page.html"
    ran = CliRunner().invoke(app, ["animate", flown, plan, "--html", str(html)])
    assert ran.exit_code == 0, ran.output
    assert '"label":"plan"' in html.read_text()
    monkeypatch.setattr(simulation, "simulate", lambda *_, **__: Result.load(folders[1]))
    played = playback([folders[0]])
    assert played.data["title"] == "reach: the plan, followed"
    assert played.data["panel"]["metrics"][0]["key"] == "tip_error_peak"


def test_a_plan_lies_pale_under_its_flight(folders):
    flown, (plan, _) = Result.load(folders[1]), read(folders[0])
    data = beside_its_plan(flown, load_scene(folders[0] / SCENARIO), plan)
    run, ghost = data["runs"]
    assert data["over"]
    assert ghost["pale"]
    assert "pale" not in run
    ends = [np.asarray(one["poses"]).reshape(len(one["time"]), -1)[-1] for one in (run, ghost)]
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-3)
    kinds = [solid["kind"] for node in run["nodes"] for solid in node["solids"]]
    assert "cone" in kinds
    pads = sum(s["rgba"][:3] == pytest.approx([0.85, 0.45, 0.1]) for n in run["nodes"] for s in n["solids"])
    assert pads == 4  # a ball, and a capsule of three parts
    assert {q["title"] for q in ghost["quantities"]} == {"joint angle", "joint torque"}
    other = dataclasses.replace(flown, data=flown.data.isel(configuration=slice(1, None)))
    with pytest.raises(ResultError, match="was not flown by this plan"):
        beside_its_plan(other, load_scene(folders[0] / SCENARIO), plan)


def test_a_report_of_a_plan_says_where_limits_bind_and_what_the_cost_depends_on(folders, tmp_path):
    """Active limits are those that the multipliers of the optimum say: the torque bounds are not."""
    plan, summary = read(folders[0])
    found = {name: periods for name, _, periods in binding(plan)}
    limits = {name: limit for name, limit, _ in binding(plan)}
    (rotation,) = (limit for name, limit in limits.items() if "base rotation of one" in name)
    assert rotation.endswith(" deg")
    assert any("base rotation of one" in name for name in found)
    for periods in found.values():
        assert all(0 <= begin <= end <= 2 for begin, end in periods)
    flown = Result.load(folders[1])
    data = beside_its_plan(flown, load_scene(folders[0] / SCENARIO), plan)
    slopes = {"cost_sensitivities": {"plan.limits.torque": -0.0123}}
    text = plan_report(plan, summary | slopes, flown, data).replace("<wbr>", "")
    sections = re.findall(r'<section id="(\w+)">', text)
    assert sections == ["verdict", "limits", "cost", "replay", "mesh", "figures"]
    assert text.index("Verified") < text.index("data:image/png") < text.index("<iframe")
    for words in (*found, f"{summary['unknowns']} unknowns", "plan.limits.torque", "-0.0123"):
        assert html.escape(words) in text


def test_the_command_reports_a_plan_and_keeps_its_sensitivities(folders, tmp_path, monkeypatch):
    monkeypatch.setattr(simulation, "simulate", lambda *_, **__: Result.load(folders[1]))
    done = CliRunner().invoke(app, ["report", str(folders[0]), "--out", str(tmp_path / "report.html")])
    assert done.exit_code == 0, done.output
    assert "Plan of reach" in (tmp_path / "report.html").read_text()
