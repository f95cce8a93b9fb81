"""Phases as ``spacerobot check`` prints them."""

from typer.testing import CliRunner

from spacerobot.cli.app import app
from spacerobot.common.errors import ScenarioError
from tests.oracles.free_bodies import FLAT, free_bodies


def test_phases_are_printed_as_a_timeline(tmp_path):
    phases = {
        "approach": {"until": {"captured": ["left"]}, "timeout": 2.5, "on_timeout": "lost"},
        "carry": {
            "until": {"settled": {"speed": 0.001, "dwell": 1}},
            "next": "end",
            "releases": ["left"],
            "robots": {"*": {"tips": {"*": {"reference": {"kind": "line"}}}}},
        },
        "lost": {"until": {"time": 1.0}},
    }
    free_bodies(tmp_path, FLAT, {"kind": "weld", "capture": {"distance": 0.05}}, phases=phases)
    found = CliRunner().invoke(app, ["check", str(tmp_path / "bodies.yaml")])
    assert found.exit_code == 0, found.output
    lines = [" ".join(line.split()) for line in found.output.splitlines()]
    assert "approach when left is captured -> carry; after 2.5 s at the latest -> lost" in lines
    assert "carry when target moves slower than 0.001 m/s for 1 s -> end" in lines
    assert "robots.one.tips.tip.reference line" in lines
    assert "releases: left" in lines
    assert "lost after 1 s -> end" in lines


def test_a_limit_of_an_output_that_there_is_not_is_refused_by_check_as_by_run(tmp_path):
    limit = {"output": "grasp_forc", "above": 1}
    grasp = {"kind": "weld", "capture": {"distance": 0.05}}
    free_bodies(tmp_path, FLAT, grasp, phases={"one": {"until": {"limit": limit}}})
    found = CliRunner().invoke(app, ["check", str(tmp_path / "bodies.yaml")])
    assert isinstance(found.exception, ScenarioError), found.output
    told = str(found.exception)
    assert "phases.one.until.limit.output: found 'grasp_forc'; did you mean grasp_force" in told


def test_limits_of_outputs_are_checked_with_predictive_control_as_run_does(tmp_path):
    limit = "phases.approach.abort={output: grasp_gap, of: left, above: 10}"
    changes = [limit, "phases.approach.on_abort=end"]
    options = [word for change in changes for word in ("--set", change)]
    found = CliRunner().invoke(app, ["check", "examples/docking-receding.yaml", *options])
    assert found.exit_code == 0, found.output
