"""The plugins of ``examples/plugins``, all in one scene: simulated, differentiated, planned and on a page.

``spacerobot new --plugin`` writes them as templates, and these files are the ones that are used here.
"""

import shlex
from pathlib import Path

import pytest

import spacerobot as sr
from spacerobot.cli.app import command_line, plugins_first
from spacerobot.common.errors import SpaceRobotError
from spacerobot.drafting.plugins import TEMPLATES, plugin_command, plugin_template
from tests import forks

ROOT = Path(__file__).parents[2]
FILES = (ROOT / "examples" / "plugins").glob("*.py")
PLUGINS = sorted(file.stem for file in FILES if not file.stem.startswith("test_"))

SCRIPT = """
import sys
from pathlib import Path

import numpy as np
import yaml

import spacerobot as sr
from optim.planning.output.plan_folder import dataset
from optim.planning.search.make_plan import make_plan
from spacerobot.scene.contacts import gaps
from tests.optim.planning.conftest import REACH

from spacerobot.drafting.plugins import TEMPLATES

robot, folder = "robots.one", Path(sys.argv[1])
for family in TEMPLATES:
    sr.draft_plugin(family, folder / f"my_{family}.py")
    sr.load_plugin(folder / f"my_{family}.py")
own = {
    "actuators": {"wheel": {"kind": "reaction_wheel", "gain": 0.5}},
    "sensors": {"joint_rate": {"kind": "thermal", "temperature": 45}},
    "joint_pd": {"kp": 0, "kd": 5},
    "tips": {
        "tip": {
            "controllers": {"soft": {"kind": "bounded_spring"}},
            "reference": {"kind": "lemniscate", "duration": 2},
        }
    },
}
plan = REACH["plan"] | {
    "costs": {"torque": 0.01, "tip_speed": 1.0},
    "limits": {"tip_speed": {"tip": "one/tip", "upper": 0.2}},
    "keep_out": {"apart": {"between": ["hand", "tank"], "distance": 0.01}},
    "tolerance": 1e-2,
    "order": 4,
    "intervals": 6,
}
tank = {"kind": "ellipsoid", "semi_axes": [0.25, 0.4, 0.2]}
tank |= {"link": "target/body", "position": [-0.05, -0.1, 0]}
document = REACH | {
    "pads": {"hand": {"kind": "sphere", "link": "one/link_3", "radius": 0.1}, "tank": tank},
    "robots": {"one": REACH["robots"]["one"] | own},
    "simulation": {"duration": 0.3, "step": 0.01, "output_step": 0.05},
    "plan": plan,
}
(folder / "scene.yaml").write_text(yaml.safe_dump(document))
scene = sr.load_scene(folder / "scene.yaml")
bump = {"between": ["hand", "tank"], "stiffness": 3e3, "exponent": 2, "dissipation": 0.5, "friction": 0.2}
meets = {"contacts": {"bump": bump}, "target.base.velocity": [-0.4, -0.4, 0], "simulation.duration": 0.2}

scene_with_contact = sr.load_scene(folder / "scene.yaml", meets)
result = sr.simulate(scene_with_contact, backend="interpreted")
assert result.summary["status"]["state"] == "completed"
assert float(abs(result.data.wheel_speed.sel(body="one")).max()) > 0
assert float(abs(result.data.spring_force).max()) > 0
assert float(result.data.contact_gap.min()) < -0.01
(by_coal,) = gaps(scene_with_contact, scene_with_contact.contacts[0])
assert abs(float(result.data.contact_gap[0, 0]) - by_coal) < 1e-8
second = sr.simulate(sr.load_scene(folder / "scene.yaml", meets | {"simulation.engine": "pinocchio"}))
assert float(abs(result.data.q - second.data.q).max()) < 1e-7

plain = [
    f"{robot}.tips.tip.controllers.soft.stiffness",
    f"{robot}.tips.tip.reference.size",
    f"{robot}.actuators.wheel.gain",
    f"{robot}.sensors.joint_rate.temperature",
]
peak = ["base_rotation_peak"]
for changes, paths in (({}, plain), (meets, ["pads.tank.semi_axes.1"])):
    own = sr.load_scene(folder / "scene.yaml", changes)
    slopes = sr.gradient(own, peak, paths, backend="interpreted").data.gradient.values[0]
    loop = sr.build_closed_loop(own)
    for path, slope in zip(paths, slopes, strict=True):
        value = float(loop.parameters()[loop.index(path)])
        points = {path: [value * (1 - 1e-4), value * (1 + 1e-4)]}
        behind, ahead = sr.batch(own, peak, points, backend="interpreted").data[peak[0]].values.ravel()
        assert ahead != behind
        assert abs((ahead - behind) / (2e-4 * value) - slope) < 1e-4 * abs(slope), path

# the same quantity is a cost of plans and a metric of simulations
metric = ["tip_speed_rms"]
size = f"{robot}.tips.tip.reference.size"
sizes = {size: [0.1, 0.1001, 0.0999]}
speed, ahead, behind = sr.batch(scene, metric, sizes, backend="interpreted").data[metric[0]].values.ravel()
assert 0 < behind < speed < ahead
at = sr.load_scene(folder / "scene.yaml", {size: 0.1})
slope = float(sr.gradient(at, metric, [size], backend="interpreted").data.gradient.values[0, 0])
assert abs((ahead - behind) / 2e-4 - slope) < 1e-4 * slope
found = make_plan(scene, backend="interpreted")
assert found.terms["tip_speed"] > 0
wide = sr.load_scene(folder / "scene.yaml", {"plan.limits.tip_speed.upper": 9})
loose = make_plan(wide, backend="interpreted")
assert loose.cost <= found.cost + 1e-9
# a plan sees the ellipsoid at the distance that coal computes
near = sr.load_scene(folder / "scene.yaml", {"plan.keep_out.apart.distance": by_coal + 0.02})
try:
    make_plan(near, backend="interpreted")
except sr.SpaceRobotError as fault:
    assert "hand to tank is passed by 0.02 m" in str(fault), fault
else:
    raise AssertionError("the start was not refused")

# the tip, which starts 50 deg off, looks up at the end: to a degree, and the solver's tolerance of it
looks = {"kind": "pointing", "tip": "one/tip", "towards": [0, 1, 0]}
upwards = {"plan.goals": {"camera": looks}, "plan.limits": {}, "plan.keep_out": {}}
plan = dataset(make_plan(sr.load_scene(folder / "scene.yaml", upwards), backend="interpreted"))
x, y, z = plan.tip_rotation.isel(time=-1, tip=0).values
assert abs(np.hypot(x, y)) < 1e-9
assert abs(z - np.pi / 2) < np.radians(1.01)

sr.animate(result, folder / "page.html")
page = (folder / "page.html").read_text(encoding="utf-8")
assert "speed of reaction wheels" in page
assert '"kind":"mesh"' in page.replace(" ", "")
"""


def test_there_is_a_plugin_of_each_kind_that_the_documentation_shows():
    shown = ["bounded_spring", "ellipsoid", "lemniscate", "pointing", "python_pd", "reaction_wheel"]
    shown += ["thermal", "tip_speed"]
    assert sorted([*TEMPLATES.values(), "python_pd"]) == PLUGINS == shown


def test_plugins_are_simulated_differentiated_planned_with_and_shown(tmp_path):
    """In a process of its own, so that kinds stay out of other tests."""
    done = forks.run(SCRIPT, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize("family", TEMPLATES)
def test_the_command_in_a_template_uses_it(family, tmp_path):
    """The options of the command that ``new`` prints are valid, and its scene has the template's kind."""
    written = forks.command("new", "--plugin", family, folder=tmp_path)
    assert written.returncode == 0, written.stderr
    text = (tmp_path / f"{family}.py").read_text(encoding="utf-8")
    command = plugin_command(text)
    assert command in written.stdout
    words = shlex.split(command)
    assert words[0] == "spacerobot"
    assert words[words.index("--plugin") + 1] == f"{family}.py"
    name, *rest = plugins_first(words[1:])[2:]
    params = command_line().commands[name].make_context(name, list(rest)).params
    script = """
    import sys, spacerobot as sr
    from spacerobot.cli.options import parse_changes
    sr.load_plugin(sys.argv[1])
    sr.load_scene(sys.argv[2], parse_changes(sys.argv[3:]))
    """
    loaded = forks.run(script, tmp_path / f"{family}.py", params["scenario"], *params["changes"])
    assert loaded.returncode == 0, loaded.stderr


def test_the_test_of_every_template_passes(tmp_path):
    for family in TEMPLATES:
        file = tmp_path / f"my {family}.py"
        sr.draft_plugin(family, file)
    done = forks.run(
        "import pytest, sys; sys.exit(pytest.main(['-q', '-p', 'no:cacheprovider', sys.argv[1]]))", tmp_path
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert sorted(path.name for path in tmp_path.glob("test_*.py")) == sorted(
        f"test_my {family}.py" for family in TEMPLATES
    )


def test_a_template_is_a_python_file(tmp_path):
    with pytest.raises(SpaceRobotError, match=r"allowed: a Python file, goal\.py"):
        sr.draft_plugin("goal", tmp_path / "goal")
    assert not list(tmp_path.iterdir())


def test_a_template_replaces_no_file_and_has_a_family(tmp_path):
    (tmp_path / "goal.py").write_text("mine", encoding="utf-8")
    again = forks.command("new", "--plugin", "goal", folder=tmp_path)
    assert again.returncode == 2
    assert "goal.py: exists already" in again.stderr
    assert (tmp_path / "goal.py").read_text(encoding="utf-8") == "mine"
    both = forks.command("new", "--plugin", "goal", "--robot", "a.urdf", folder=tmp_path)
    assert both.returncode == 2
    with pytest.raises(SpaceRobotError, match="did you mean sensor"):
        plugin_template("sensors", tmp_path / "mine.py")
    assert "--plugin 'my goal.py'" in plugin_command(plugin_template("goal", Path("my goal.py")))
