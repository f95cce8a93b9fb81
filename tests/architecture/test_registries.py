"""A kind of each family in a module of its own, and nothing else changed: it is listed, accepted and used."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

KINDS = """
from typing import ClassVar, Literal

import casadi as ca
import numpy as np
import typer

import spacerobot as sr
from optim import TuningMethod
from spacerobot import elements
from spacerobot.cli.command import Command
from spacerobot.elements import quantity
from spacerobot.exports import ExportFormat
from spacerobot.common.registry import COMMANDS
from spacerobot.samplers import Sampler
from viz.figures import figure


@sr.register
class Shape(elements.CollisionShape):
    "Ball of its own."
    kind: Literal["own_shape"] = "own_shape"
    radius: float = quantity("m", "radius", gt=0)

    @classmethod
    def support(cls, rotation, measures):
        return elements.Support(ball=measures[0])


@sr.register
class OwnSampler(Sampler):
    "The middle of the cube."
    name: ClassVar[str] = "own_sampler"
    summary: ClassVar[str] = "always the median"

    def points(self, plan):
        return np.full((plan.samples, len(plan.parameters)), 0.5)


@sr.register
class OwnMethod(TuningMethod):
    "The start alone."
    name: ClassVar[str] = "own_method"
    title: ClassVar[str] = "the start alone"

    def searches(self, request):
        def run():
            search = request.begin(self.name, 0, 0, "")
            search.evaluate(request.problem.start)
            return search.finish("done")

        return [run]


@sr.register
class OwnFormat(ExportFormat):
    "Names of the bodies."
    name: ClassVar[str] = "own_format"
    suffixes: ClassVar[tuple[str, ...]] = (".own",)
    takes: ClassVar[tuple[str, ...]] = ("scene",)

    def write(self, source, path, options):
        path.write_text(" ".join(body.name for body in source.bodies))


@figure("A figure of its own", applies=lambda result: True)
def own_figure(result):
    from matplotlib.figure import Figure

    return Figure()


@Command.of("own_command")
def command(word: str = "nothing") -> None:
    "Say a word."
    typer.echo(f"said {word}")
"""

USED = """
import sys
from pathlib import Path

import numpy as np
from typer.testing import CliRunner

import spacerobot as sr

sr.load_plugin(Path(sys.argv[1]))
from optim.campaign.sampling.samplers import draw
from optim.methods.run_method import run_method
from optim.methods.settings import Effort
from spacerobot.cli import app
from spacerobot.elements.core.kind_table import markdown
from spacerobot.common.errors import ScenarioError
from spacerobot.scenario import Campaign, Tuning
from spacerobot.scenario.load import json_schema
from tests.oracles.balls import meeting
from tests.oracles.known_optima import quadratic
from viz.figures import figure_kinds
from viz.studio.search import methods

schema = str(json_schema())
assert all(name in schema for name in ("own_shape", "own_sampler", "own_method")), "schema"
assert "`own_shape`" in markdown()

runner, command_line = CliRunner(), app.application()
assert "own_command" in runner.invoke(command_line, ["--help"]).output
assert "said hello" in runner.invoke(command_line, ["own_command", "--word", "hello"]).output
assert "own_shape" in runner.invoke(command_line, ["kinds"]).output

pads = {"pad": {"link": "one/body", "kind": "own_shape", "radius": 0.1}}
scene = meeting({"stiffness": 1e4, "between": ["pad", "target/body"]}, pads=pads)
run = {"duration_s": 0.05, "step_s": 0.005, "output_step_s": 0.01, "backend": "interpreted"}
ends = [
    sr.build_rollout(sr.build_closed_loop(one), **run).run().state[-1]
    for one in (scene, meeting({"stiffness": 1e4}))
]
states = [end[: scene.model.nq] for end in ends]
assert np.abs(states[0] - states[1]).max() < 1e-12, "the same as the ball of the URDF"

assert "own_format" in runner.invoke(command_line, ["export", "--list"]).output
assert sr.export(scene, Path(sys.argv[1]).with_suffix(".own")).read_text() == "one target"

parameters = {"mass": {"paths": "target.links.body.mass", "lower": 1, "upper": 3}}
campaign = Campaign.model_validate({"parameters": parameters, "design": "own_sampler", "samples": 3})
assert draw(campaign).tolist() == [[2.0]] * 3

assert methods()["own_method"] == "the start alone"
variables = {"a": {"paths": "x", "lower": 0, "upper": 1}}
assert Tuning.model_validate({"variables": variables, "methods": ["own_method"]})
problem = quadratic()
(found,) = run_method(problem, "own_method", Effort()).runs
assert found.u.tolist() == problem.start.tolist()

assert figure_kinds()[-1].name == "own_figure"
"""


def test_one_file_adds_a_kind_of_each_family(tmp_path):
    """In a process of its own, so that they stay out of other tests."""
    (tmp_path / "own.py").write_text(KINDS, encoding="utf-8")
    command = [sys.executable, "-c", USED, str(tmp_path / "own.py")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("module", ["spacerobot.cli.app", "spacerobot.common.registry"])
def test_names_are_listed_without_loading_what_has_them(module):
    code = (
        f"import sys, {module}; from spacerobot.common.registry import TUNING_METHODS; "
        "TUNING_METHODS.names(); print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    loaded = set(done.stdout.split())
    assert not loaded & {"numpy", "casadi", "pinocchio", "pydantic", "matplotlib", "scipy"}
    assert not any(name.startswith(("optim.methods.kinds.", "viz.")) for name in loaded)
