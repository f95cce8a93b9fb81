"""Each command prints what its function of the public namespace returns, and results are read again."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import spacerobot as sr
from spacerobot.cli.app import app
from spacerobot.common.errors import ResultError, ScenarioError
from spacerobot.common.tables import Table, Tree
from tests.optim.planning.conftest import REACH
from tests.oracles import one_arm

TIME = re.compile(r"\d[\d.e+-]* ?(?:s|ms)\b")
"""Times that a machine takes differ from run to run."""
KP = "robots.arm.tips.tip.pid.kp"
TUNING = {
    "variables": {"kp": {"paths": KP, "lower": 20, "upper": 400}},
    "step": 0.01,
    "population": 4,
    "budget": 8,
    "baseline_budget": 8,
    "runs": 1,
    "starts": 1,
    "iterations": 3,
}
MASS = {"paths": "target.links.body.mass", "lower": 10, "upper": 50}
CAMPAIGN = {"parameters": {"mass": MASS}, "samples": 16, "step": 0.01, "limits": {"grip_force": 7.0}}


@pytest.fixture(scope="module", autouse=True)
def interpreted():
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPACEROBOT_COMPILER", "none")
        patch.setenv("COLUMNS", "400")
        yield


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """Scenario of an arm that holds an object, with everything that can be tuned or varied."""
    folder = tmp_path_factory.mktemp("arm")
    file = one_arm.write(folder)
    document = yaml.safe_load(file.read_text())
    file.write_text(yaml.safe_dump(document | {"tuning": TUNING, "campaign": CAMPAIGN}))
    return file


@pytest.fixture(scope="module")
def reach(tmp_path_factory):
    """Scenario of an arm that reaches for an object."""
    file = tmp_path_factory.mktemp("reach") / "reach.yaml"
    plan = REACH["plan"] | {"intervals": 4, "tolerance": 1.0, "limits": {"torque": 5}, "iterations": 40}
    file.write_text(yaml.safe_dump(REACH | {"plan": plan}))
    return file


def printed(*words):
    """Words that a command prints, times left out."""
    ran = CliRunner().invoke(app, [str(word) for word in words])
    assert ran.exit_code == 0, (ran.output, ran.exception)
    return TIME.sub("", ran.output).split()


def cells(content):
    """Texts of tables, trees and sentences, times left out."""
    for part in content:
        if isinstance(part, str):
            yield part
        elif isinstance(part, Table):
            yield from (part.title or "", *part.headings)
            yield from (cell for row in part.rows for cell in row)
        else:
            assert isinstance(part, Tree)
            yield from (part.name, part.text, *cells(part.branches))


def check_printed(output, result):
    """Every word of what a result presents is printed."""
    words = {word for text in cells(result.content()) for word in TIME.sub("", text).split()}
    assert len(words) > 5
    assert words <= set(output), words - set(output)
    assert result._repr_html_().count("<") > 10
    assert len(repr(result)) < 300


def test_check_prints_the_tree_phases_and_assumptions():
    checked = sr.check("examples/docking-receding.yaml")
    check_printed(printed("check", "examples/docking-receding.yaml"), checked)
    assert checked.assumptions == checked.scene.assumptions
    assert [part.title for part in checked.content()[1:]] == ["phases", "plan", "assumptions"]


def test_kinds_scenarios_and_schema_are_listed():
    check_printed(printed("kinds", "actuator"), sr.list_kinds("actuator"))
    check_printed(printed("kinds", "circle"), sr.list_kinds("circle"))
    assert set(sr.list_kinds("actuator").kinds["actuator"]) <= set(printed("kinds"))
    check_printed(printed("scenarios"), sr.list_scenarios())
    assert all(file.is_file() for file in sr.list_scenarios().urdfs.values())
    ran = CliRunner().invoke(app, ["schema"])
    assert json.loads(ran.output) == sr.scenario_schema()


def test_bodies_and_plugins_of_commands_are_those_of_the_functions(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arm = sr.make_arm("a/arm.urdf", 3, sr.PlanarLink(0.5), damping=0.2)
    words = printed("make-arm", "arm", "b/arm.urdf", "--links", 3, "--link-length", 0.5, "--damping", 0.2)
    assert words == f"b/arm.urdf: {len(arm.joints) - 1} joints, {200 + 3 * 11.76:g} kg".split()
    sr.make_rectangle("a/box.urdf", alpha_deg=45)
    printed("make-arm", "rectangle", "b/box.urdf", "--alpha", 45)
    plugin = sr.draft_plugin("goal", "a/goal.py")
    output = " ".join(printed("new", "--plugin", "goal", "--out", "b/goal.py"))
    assert plugin.command.replace("a/goal.py", "b/goal.py") in output
    for name in ("arm.urdf", "box.urdf", "test_goal.py"):
        assert (tmp_path / "a" / name).read_text() == (tmp_path / "b" / name).read_text(), name
    with pytest.raises(ScenarioError, match=r"goal\.py: exists already"):
        sr.draft_plugin("goal", "a/goal.py")


def test_formats_are_listed_and_changes_reach_the_exported_scene(tmp_path):
    check_printed(printed("export", "--list"), sr.list_formats())
    with pytest.raises(ResultError, match="changes apply to a scenario"):
        sr.export(tmp_path, tmp_path / "table.csv", changes={"simulation.duration": 1})
    with pytest.raises(ScenarioError, match="unknown key 'durration'"):
        sr.export("paper", tmp_path / "plant.fmu", "plant", changes={"simulation.durration": 1})


def test_a_tuning_is_printed_and_read_again(arm, tmp_path):
    output = printed("tune", arm, "--method", "random", "--out", tmp_path / "tuned")
    tuned = sr.tune(sr.load_scene(arm), "random")
    check_printed(output, tuned)
    again = sr.load(tmp_path / "tuned")
    assert (again.gains, again.objective, again.reading) == (tuned.gains, tuned.objective, tuned.reading)
    assert [part for part in again.content() if isinstance(part, Table)] == [
        part for part in tuned.content() if isinstance(part, Table)
    ]


def test_a_robust_tuning_is_printed_and_read_again(arm, tmp_path):
    options = ("--method", "cmaes", "--samples", 4, "--fresh", 6, "--measure", "mean")
    output = printed("robust", arm, *options, "--out", tmp_path / "robust")
    problem = sr.build_robust(arm, sr.Statistic("mean", samples=4))
    tuned = sr.tune_robust(problem, "cmaes", fresh=6)
    check_printed(output, tuned)
    again = sr.load(tmp_path / "robust")
    assert (again.gains, again.objective, again.statistic) == (tuned.gains, tuned.objective, tuned.statistic)
    for name in ("start", "nominal", "robust"):
        np.testing.assert_array_equal(again.fresh[name], tuned.fresh[name])
    assert again.scene.scenario.robots["arm"].tips["tip"].pid.kp == tuned.gains["kp"]


def test_a_sweep_is_printed_and_read_again(arm, tmp_path):
    options = ("--budget", 8, "--runs", 1, "--out", tmp_path / "sweep")
    output = printed("sweep", arm, *options)
    swept = sr.sweep(arm, budget=8, runs=1)
    check_printed(output, swept)
    assert sr.load(tmp_path / "sweep") == swept
    assert {one["setting"] for one in swept.settings} == {"crossover", "mutation"}  # no population fits


def test_a_campaign_is_printed_and_names_its_changes(arm, tmp_path):
    changes = {"robots.arm.tips.tip.pid.kd": 90}
    made = sr.campaign(sr.load_scene(arm, changes), tmp_path / "made", gains=["scenario"], threads=1)
    words = ("campaign", arm, "--set", "robots.arm.tips.tip.pid.kd=90", "--gains", "scenario")
    output = printed(*words, "--out", tmp_path / "ran", "--threads", 1)
    check_printed(output, made)
    assert (made.done, made.total) == (16, 16)
    command = made.summary["gains"]["scenario"]["worst"][0]["command"]
    assert "--set robots.arm.tips.tip.pid.kd=90" in command
    assert set(command.split()) <= set(output)


def test_plans_and_their_front_are_printed_drawn_and_read_again(reach, tmp_path):
    folder, options = tmp_path / "front", ("--backend", "interpreted")
    terms = ("torque", "base_rotation")
    output = printed("plan", reach, *options, "--pareto", ",".join(terms), "--points", 2, "--out", folder)
    front = sr.pareto_front(reach, terms, points=2, backend="interpreted")
    check_printed(output, front)
    again = sr.load(folder)
    assert [point["values"] for point in again.points] == [point["values"] for point in front.points]
    assert again.plan("point_1").cost == front.plan("point_1").cost
    assert set(sr.figures(front)) == {"front"}
    # a front that was read is copied; a solved one replaces an earlier one and no other content
    assert again.save(tmp_path / "copy").points == again.points
    with pytest.raises(ResultError, match="cannot be written"):
        again.save(tmp_path / "copy")
    assert front.save(tmp_path / "copy").folder == tmp_path / "copy"
    with pytest.raises(ResultError, match="holds files, not a front of plans"):
        front.save(reach.parent)
    with pytest.raises(ResultError, match="no plan of a point 'point_9'; allowed: point_1, point_2"):
        front.plan("point_9")
    with pytest.raises(ScenarioError, match="allowed: two terms of the cost"):
        sr.pareto_front(reach, ["torque"])
    # one plan, with the sensitivities of its cost
    path = "robots.one.links.link_1.mass"
    output = printed("plan", reach, *options, "--sensitivities", path, "--out", tmp_path / "plan")
    plan = sr.plan(reach, sensitivities=[path], backend="interpreted")
    times = {f"{run['seconds']:.3g}" for run in plan.summary["solver_runs"]}
    check_printed([*output, *times], plan)
    again = sr.load(tmp_path / "plan")
    assert again.summary["cost_sensitivities"] == plan.summary["cost_sensitivities"]
    assert "convergence" in sr.figures(tmp_path / "plan")
    with pytest.raises(ResultError, match="the figures of a plan are drawn together"):
        sr.figures(plan, names=["convergence"])
    with pytest.raises(ResultError, match="a plan has a page of its own; name it alone"):
        sr.report([plan, plan], tmp_path / "page.html")


def test_the_page_of_a_saddle_point_says_so(reach, tmp_path):
    from viz.report.plan_section import _in_short

    plan = sr.plan(reach, backend="interpreted")
    flown = sr.simulate(sr.load_scene("drift", {"simulation.duration": 0.1}))
    verification = plan.summary["verification"] | {"second_order": "saddle point"}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("viz.report.plan_section.animated", lambda _: "")
        text = _in_short({**plan.summary, "verification": verification}, flown, {})
    assert "It is a saddle point" in text


def test_the_paper_is_compared_in_one_table(tmp_path):
    from spacerobot.simulation.paper import VARIANTS, PaperComparison

    result = sr.simulate(VARIANTS[0].scene())
    compared = PaperComparison({VARIANTS[0]: result})
    table, legend = compared.content()
    assert [row[0] for row in table.rows][-1] == VARIANTS[0].name
    assert "held: both bases" in legend
