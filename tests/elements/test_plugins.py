"""A user's own elements, in the user's own file."""

from __future__ import annotations

from pathlib import Path

import pytest

from spacerobot.common.errors import SpaceRobotError
from spacerobot.elements import load_plugin
from tests import forks

ROOT = Path(__file__).parents[2]
PLUGINS = ROOT / "examples" / "plugins"


@pytest.mark.parametrize("name", ["bounded_spring", "lemniscate", "reaction_wheel"])
def test_the_worked_examples_are_short(name):
    assert len((PLUGINS / f"{name}.py").read_text(encoding="utf-8").splitlines()) < 60


SCRIPT = """
import numpy as np
import spacerobot as sr
from spacerobot.closedloop import build_closed_loop
from spacerobot.pinocchio_engine import PinocchioLoop
from pathlib import Path

sr.load_plugin(Path("examples/plugins/bounded_spring.py"))
sr.load_plugin(Path("examples/plugins/lemniscate.py"))
changes = {"robots.*.tips.tip.reference": {"kind": "lemniscate", "duration": 2.0}, "simulation.duration": 0.4}
scene = sr.load_scene("paper", changes)
loop, engine = build_closed_loop(scene), PinocchioLoop(scene)
_, c = loop.setup(loop.parameter_values)
x = engine.normalise(engine.x0 + 1e-3)
second = engine.derivative(0.7, x)
assert np.abs(loop.dynamics(0.7, x, c).full().ravel() - second).max() < 1e-9 * np.abs(second).max()
for vary in ("robots.rpr1.tips.tip.reference.size", "robots.rpr1.tips.tip.controllers.soft.stiffness"):
    soft = {"robots.rpr1.tips.tip.controllers": {"soft": {"kind": "bounded_spring", "stiffness": 80.0}}}
    own = sr.load_scene("paper", changes | soft)
    loop = build_closed_loop(own)
    _, c = loop.setup(loop.parameter_values)
    rate = loop.dynamics(0.7, x, c).full().ravel()
    assert np.abs(rate - PinocchioLoop(own).derivative(0.7, x)).max() < 1e-9 * np.abs(rate).max()
    rollout = sr.build_rollout(loop, duration_s=0.4, step_s=0.01, backend="interpreted")
    assert vary in loop.parameter_paths
    jacobian = rollout.jacobian(wrt=[vary], outputs=["tip_position"]).outputs["tip_position"]
    value, step = loop.parameters()[loop.index(vary)], 1e-5
    ends = [rollout.run({vary: value * (1 + s * step)}).outputs["tip_position"] for s in (1, -1)]
    difference = (ends[0] - ends[1]) / (2 * step * value)
    assert np.abs(jacobian[..., 0] - difference).max() < 1e-6 * max(1e-3, np.abs(difference).max()) + 1e-9
result = sr.simulate(own, backend="interpreted")
assert result.data.spring_force.dims == ("time", "tip", "axis")
assert result.data.spring_force.attrs["units"] == "N"
assert bool(np.isnan(result.data.spring_force.sel(tip="rpr2/tip")).all())
assert result.summary["ledger"]["energy"]["relative_residual"] < 1e-6

from typing import ClassVar, Literal
from optim.planning.formulation.formulate import formulate
from spacerobot.elements import Goal, zero

@sr.register
class Abreast(Goal):
    "A tip comes abreast of a point."
    told_by: ClassVar[str | None] = "abreast"
    kind: Literal["abreast"] = "abreast"
    tip: str
    abreast: float
    body = property(lambda self: self.tip.partition("/")[0])
    def rows(self, instant):
        yield zero("abreast", "m", instant.tip(self.tip).origin[0] - self.abreast)

changes = {"plan.goals": {"go": {"tip": "rpr1/tip", "abreast": 0.3}}}
assert formulate(sr.load_scene("docking", changes)).goal[0].name == "go: abreast"
"""


def test_the_worked_examples_get_what_shipped_elements_get():
    done = forks.run(SCRIPT)
    assert done.returncode == 0, done.stderr


TRAVEL = """
import pickle
import subprocess
import sys
from pathlib import Path
import spacerobot as sr
from optim.problem.scene_recipe import SceneRecipe

sr.load_plugin(Path("examples/plugins/lemniscate.py"))
scene = sr.load_scene("paper", {"robots.*.tips.tip.reference": {"kind": "lemniscate"}})
recipe = pickle.dumps(SceneRecipe.of(scene))
code = "import pickle, sys; print(pickle.load(sys.stdin.buffer).build().tips[0].reference.kind)"
done = subprocess.run([sys.executable, "-c", code], input=recipe, capture_output=True, check=True)
assert done.stdout.split() == [b"lemniscate"], done
"""


def test_a_scene_with_kinds_of_ones_own_travels_to_other_processes():
    done = forks.run(TRAVEL)
    assert done.returncode == 0, done.stderr


def test_a_plugin_is_given_on_the_command_line():
    change = "robots.*.tips.tip.reference={kind: lemniscate}"
    done = forks.command("check", "paper", "--plugin", PLUGINS / "lemniscate.py", "--set", change)
    assert done.returncode == 0, done.stderr
    assert "reference lemniscate" in " ".join(done.stdout.split())
    assert forks.command("check", "paper", "--set", change).returncode == 2


def test_the_pinocchio_engine_runs_a_plugin_from_its_one_file(tmp_path):
    changes = ["robots.rpr1.tips.tip.controllers={soft: {kind: bounded_spring}}", "simulation.duration=0.02"]
    given = [word for change in changes for word in ("--set", change)]
    told = [
        "--plugin",
        PLUGINS / "bounded_spring.py",
        *given,
        "--engine",
        "pinocchio",
        "--out",
        tmp_path / "out",
    ]
    done = forks.command("run", "paper", *told)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "result.nc").exists()


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("x = 1 / 0\n", "line 1: ZeroDivisionError"),
        ("import spacerobot as sr\n\n@sr.register\nclass A:\n    pass\n", "family"),
        (
            "import spacerobot as sr\nfrom spacerobot.elements import Reference\n\n"
            "@sr.register\nclass A(Reference):\n    'No kind.'\n",
            "no kind",
        ),
        *(
            (
                "import spacerobot as sr\nfrom typing import Literal\n"
                f"from spacerobot.elements import {base}\n\n@sr.register\nclass Bare({base}):\n"
                f"    'Nothing.'\n    kind: Literal['bare'] = 'bare'\n{more}",
                told,
            )
            for base, more, told in (
                (
                    "Sensor",
                    "    def affine(self, c): return None, 1\n",
                    "Bare: lacks the required method is_ideal",
                ),
                (
                    "Sensor",
                    "    def affine(self, value, context): pass\n",
                    "Bare: found affine(self, value, context), allowed: affine(self, context)",
                ),
                ("Sensor", "", "lacks the required methods affine, is_ideal"),
                ("Reference", "", "lacks the required method moved (or motion)"),
                ("Actuator", "", "lacks the required method build"),
                ("Grasp", "    has_springs = True\n", "methods build, spring_wrench (with has_springs)"),
                ("CollisionShape", "", "lacks the required method support (unless is_halfspace)"),
                ("TipGoal", "", "lacks the required methods place, rows"),
                ("FlexibleLink", "", "lacks the required methods build, expanded, moving_inertia, springs"),
            )
        ),
        (
            "import spacerobot as sr\nfrom spacerobot.samplers import Sampler\n\n"
            "@sr.register\nclass Bare(Sampler):\n    'Nothing.'\n    name = 'bare'\n",
            "lacks the required method points",
        ),
        (
            "import spacerobot as sr\nsr.Quantity('a', 'b', 'c', 'm', 'peak', 'tip_error')\n",
            "line 2: TypeError: Quantity.__init__() takes 1 positional argument",
        ),
    ],
)
def test_a_plugin_that_fails_is_told_in_one_line(tmp_path, text, told):
    file = tmp_path / "own.py"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(SpaceRobotError) as fault:
        load_plugin(file)
    assert str(file) in str(fault.value)
    assert told in str(fault.value)


def test_a_kind_whose_name_is_taken_is_refused(tmp_path):
    file = tmp_path / "own.py"
    file.write_text(
        "from typing import Literal\nimport spacerobot as sr\nfrom spacerobot.elements import Reference\n\n"
        "@sr.register\nclass Other(Reference):\n    'Another line.'\n    kind: Literal['line'] = 'line'\n",
        encoding="utf-8",
    )
    with pytest.raises(SpaceRobotError, match="taken by spacerobot"):
        load_plugin(file)
