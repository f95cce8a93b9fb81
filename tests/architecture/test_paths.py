"""Public functions accept paths as texts or as anything that is a path, after what they write."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
from pathlib import Path
from types import SimpleNamespace

import pytest

import optim
import spacerobot
import viz
from optim.campaign import CampaignRun, load_campaign
from optim.campaign.rollouts.evaluator import CampaignEvaluator
from optim.methods.run_method import MethodOutcome
from optim.problem.formulation import Formulation
from optim.problem.problem import EvaluationCost
from spacerobot.common.errors import ResultError
from spacerobot.description import find_urdf, read_description
from spacerobot.result import check_folder, note_derived
from viz.report.report import find_results

REPOSITORY = Path(__file__).parents[2]


def public_functions():
    """Functions that packages export, and those that documents and examples import."""
    found = {}
    for package in (spacerobot, optim, viz):
        below = pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
        for name in (package.__name__, *(one.name for one in below if one.ispkg)):
            module = importlib.import_module(name)
            found |= {f"{name}.{own}": getattr(module, own) for own in getattr(module, "__all__", ())}
    for path in (
        *REPOSITORY.glob("docs/**/*.md"),
        *REPOSITORY.glob("examples/*.py"),
        REPOSITORY / "README.md",
    ):
        text = path.read_text(encoding="utf-8")
        for line in re.findall(r"^ *from (?:spacerobot|optim|viz)[\w.]* import [\w, ]+", text, re.MULTILINE):
            (statement,) = ast.parse(line.strip()).body
            module = importlib.import_module(statement.module)
            found |= {f"{statement.module}.{one.name}": getattr(module, one.name) for one in statement.names}
    return {name: one for name, one in found.items() if inspect.isfunction(one)}


FUNCTIONS = public_functions()
PATHS = {
    f"{name}({parameter.name})": str(parameter.annotation)
    for name, function in FUNCTIONS.items()
    for parameter in inspect.signature(function).parameters.values()
    if "Path" in str(parameter.annotation)
}


@pytest.mark.parametrize("name", PATHS)
def test_a_path_may_be_a_text_or_like_a_path(name):
    types = r"Iterable|Sequence|OnboardController|Scene|PlanResult|(Robust|Tuning|Result)Problem|Result"
    assert re.sub(rf"{types}|[\[\]| ]|None|StrPath", "", PATHS[name]) == ""


def test_the_walk_finds_the_functions_that_take_paths():
    assert {
        "spacerobot.load(path)",
        "viz.write_report(path)",
        "optim.campaign.run_campaign(folder)",
    } <= set(PATHS)


@pytest.mark.parametrize("name", [name for name in FUNCTIONS if re.search(r"\.(save|write)(_|$)", name)])
def test_what_is_written_comes_before_where(name):
    first = next(iter(inspect.signature(FUNCTIONS[name]).parameters.values()))
    assert "Path" not in str(first.annotation)


class Like:
    """A path that is neither a text nor of pathlib."""

    def __init__(self, path):
        self.path = str(path)

    def __fspath__(self):
        return self.path


@pytest.fixture(scope="module")
def result():
    return spacerobot.simulate(
        spacerobot.load_scene("paper", {"simulation.duration": 0.02}), backend="interpreted"
    )


@pytest.mark.parametrize("kind", [str, Like])
def test_results_are_kept_and_shown_by_any_kind_of_path(result, kind, tmp_path, undrawn):
    home = tmp_path / "r"
    check_folder(kind(home))
    saved = result.save(kind(home))
    assert saved.folder == home
    again = spacerobot.load(kind(home))
    assert [one.folder for one in find_results([kind(home)])] == [home]
    viz.write_animation(again, kind(home / "a.html"))
    viz.write_report(again, kind(home / "b.html"))
    viz.write_recording(again, kind(home / "c.gif"), frames_per_s=1, size_px=(160, 100))
    (figure,) = viz.save_figures(again, kind(home / "d"), formats=["png"], names=["tip_errors"])
    note_derived([again.folder], [kind(figure)])
    assert {path.name for path in home.iterdir()} >= {"a.html", "b.html", "c.gif", "d"}
    assert spacerobot.load_scene(kind(home / "scenario.yaml")).source == home / "scenario.yaml"


@pytest.mark.parametrize("kind", [str, Path, Like])
def test_descriptions_plugins_and_campaigns_are_found_by_any_kind_of_path(kind, tmp_path):
    urdf = find_urdf(kind("ball.urdf"), kind(tmp_path))
    assert read_description(kind(urdf)).path == urdf
    plugin = tmp_path / "nothing.py"
    plugin.write_text("")
    spacerobot.load_plugin(kind(plugin))
    with pytest.raises(ResultError, match="no campaign"):
        load_campaign(kind(tmp_path))
    assert optim.SearchSession(kind(tmp_path)).place == tmp_path


def check_small(thing):
    """A line that a person can read."""
    assert len(repr(thing)) < 300
    assert "\n" not in repr(thing)


def test_what_functions_return_shows_itself_in_one_line(result):
    scene = result.scene()
    loop = spacerobot.build_closed_loop(scene)
    rollout = spacerobot.build_rollout(loop, duration_s=0.02, backend="interpreted")
    assert optim.TuningProblem.__repr__ is Formulation.__repr__
    problem = Formulation(scene, loop, SimpleNamespace(names=("kp", "ki")), None, None)
    run = optim.SearchRun(
        "nlp", 0, 0, scene.q, 1.0, 0.0, EvaluationCost(rollouts=7), 1.0, "converged", log=({"step": 1},) * 99
    )
    outcome = MethodOutcome("nlp", (run,) * 9)
    evaluator = CampaignEvaluator(scene, scene.scenario.campaign, {"scenario": {}, "tuned": {}}, ())
    for thing in (
        result,
        viz.embed(result),
        scene,
        scene.scenario,
        *scene.bodies,
        *scene.tips,
        *scene.grasps,
        *(body.description for body in scene.bodies),
        loop,
        rollout,
        rollout.run(),
        problem,
        run,
        outcome,
        optim.TuningResult(
            {"kp": 1.0, "ki": 2.0}, 1.0, "converged", "no step promises a fall", scene, outcome
        ),
        optim.Comparison("paper", (), 1.0),
        evaluator,
        CampaignRun(Path("out/campaign"), evaluator, 1, 2, interrupted=False),
    ):
        check_small(thing)
