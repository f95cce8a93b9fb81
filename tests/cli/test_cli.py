"""The command line as a user meets it: output, exit codes, one line for each fault."""

import json
import os
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from spacerobot.cli.app import command_line, main
from spacerobot.description.find import find_urdf
from spacerobot.elements import kinds
from spacerobot.result import Result
from spacerobot.scenario.catalogue import shipped
from tests.oracles.free_bodies import FLAT, free_bodies

SHORT = ("--set", "simulation.duration=0.5")


@pytest.fixture
def spacerobot(monkeypatch, capsys):
    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["spacerobot", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            main()
        captured = capsys.readouterr()
        return left.value.code or 0, captured.out, captured.err

    return run


def one_line(err):
    lines = [line for line in err.splitlines() if line.strip()]
    assert len(lines) == 1, err
    assert lines[0].startswith("error: ")
    return lines[0]


def test_run_prints_headlines_and_leaves_a_result(spacerobot, tmp_path):
    code, out, err = spacerobot("run", "paper", "--out", tmp_path / "r", *SHORT)
    assert (code, err.strip()) == (0, "")
    assert "tip error rpr1/tip" in out
    assert "momentum drift" in out
    assert Result.load(tmp_path / "r").completed


def test_run_of_a_result_again_gives_the_same_numbers(spacerobot, tmp_path):
    spacerobot("run", "paper", "--out", tmp_path / "a", *SHORT)
    spacerobot("run", tmp_path / "a" / "scenario.yaml", "--out", tmp_path / "b")
    first, second = (json.loads((tmp_path / name / "summary.json").read_text()) for name in "ab")
    assert first["tip_error"] == second["tip_error"]
    assert first["ledger"] == second["ledger"]


def test_set_changes_leaves_by_pattern(spacerobot, tmp_path):
    changes = ("--set", "robots.*.tips.tip.pid.kp=77", "--set", "target.links.body.mass=33")
    code, _, _ = spacerobot("run", "paper", "--out", tmp_path / "r", *SHORT, *changes)
    assert code == 0
    scenario = Result.load(tmp_path / "r").scenario
    assert [robot.tips["tip"].pid.kp for robot in scenario.robots.values()] == [77, 77]
    assert scenario.target.links["body"].mass == 33


def test_a_diverging_run_says_when_exits_3_and_keeps_the_part(spacerobot, tmp_path):
    code, out, err = spacerobot(
        "run",
        "paper",
        "--out",
        tmp_path / "r",
        "--set",
        "simulation.step=0.02",
        "--set",
        "simulation.method=rk4",
        "--set",
        "simulation.duration=2",
    )
    assert code == 3
    assert "diverged after" in one_line(err)
    assert "diverged after" in out
    assert Result.load(tmp_path / "r").summary["status"]["state"] == "diverged"


def test_a_grip_that_catches_and_lets_go_without_end_chatters_and_is_kept_up_to_there(
    spacerobot, tmp_path, monkeypatch
):
    """One phase ends when the grip has closed, the next one opens it, and its envelope still holds."""
    monkeypatch.setenv("SPACEROBOT_COMPILER", "none")
    phases = {
        "catch": {"captures": ["left"], "until": {"captured": ["left"]}, "timeout": 2, "on_timeout": "end"},
        "drop": {"releases": ["left"], "until": {"released": ["left"]}, "next": "catch"},
    }
    free_bodies(tmp_path, FLAT, {"kind": "compliant", "capture": {"distance": 0.05}}, phases=phases)
    code, out, err = spacerobot("run", tmp_path / "bodies.yaml", "--out", tmp_path / "r")
    told = "chattered after 0.93867 s: too many events in too short a time; kept up to there in"
    assert code == 3
    assert told in one_line(err)
    assert "drop begins" in out
    found = Result.load(tmp_path / "r")
    assert found.summary["status"]["state"] == "chattering"
    assert [event["kind"] for event in found.summary["events"][-4:]] == [
        "phase",
        "released",
        "phase",
        "captured",
    ]
    assert 0.9 < found.data.time[-1] < 0.93867
    assert bool(np.isfinite(found.data.q).all())


def test_check_prints_the_tree_and_every_assumption(spacerobot):
    code, out, _ = spacerobot("check", "paper")
    assert code == 0
    for text in ("rpr2", "joint_8", "11.76 kg", "mate_2", "initial gap", "assumptions", "placed at (1.8042"):
        assert text in out
    assert spacerobot("check", "servicer")[0] == 0


def test_every_shipped_scenario_is_listed(spacerobot):
    code, out, _ = spacerobot("scenarios")
    assert code == 0
    assert all(name in out for name in shipped())
    assert "planar_arm" in out


def test_paper_prints_every_variant_and_saves_each(spacerobot, tmp_path, monkeypatch):
    import spacerobot.simulation.paper as paper

    expected = {
        f"{f}-{c}-R{r}" for f in ("base", "inertial") for c in ("pid", "amnesia") for r in ("0.10", "0.15")
    } | {"base-pid-R0.10-held", "base-amnesia-R0.10-held"}
    assert {variant.name for variant in paper.VARIANTS} == expected
    few = [variant for variant in paper.VARIANTS if variant.held or variant.name == "inertial-pid-R0.15"]
    monkeypatch.setenv("SPACEROBOT_COMPILER", "none")
    monkeypatch.setattr(paper, "VARIANTS", few)
    monkeypatch.setattr(
        paper.Variant,
        "scene",
        lambda self: paper.load_scene("paper", self.changes | {"simulation.duration": 0.05}),
    )
    code, out, _ = spacerobot("paper", "--out", tmp_path)
    assert code == 0
    assert {path.name for path in tmp_path.iterdir()} == {variant.name for variant in few}
    assert all(variant.name in out for variant in few)


def test_make_arm_writes_what_can_be_run(spacerobot, tmp_path):
    arm, box = tmp_path / "arm.urdf", tmp_path / "box.urdf"
    assert spacerobot("make-arm", "arm", arm, "--links", 3, "--link-length", 0.5)[0] == 0
    assert spacerobot("make-arm", "rectangle", box, "--alpha", 45, "--half-diagonal", 0.3)[0] == 0
    scenario = {
        "robots": {
            "a": {
                "urdf": "arm.urdf",
                "base": {"joint": "planar"},
                "joints": {"joint_1": {"angle_deg": 30}},
                "tips": {"tip": {"pid": {"kp": 50}}},
            }
        },
        "target": {"urdf": "box.urdf", "base": {"joint": "planar", "close_grasp": "hold"}},
        "grasps": {"hold": {"tip": "a/tip", "frame": "mate_1", "kind": "compliant"}},
        "simulation": {"duration": 0.2, "step": 0.01},
    }
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(scenario))
    code, out, _ = spacerobot("run", tmp_path / "mine.yaml", "--backend", "interpreted")
    assert code == 0
    assert "completed" in out


def test_schema_is_valid_json_with_units(spacerobot, tmp_path):
    assert spacerobot("schema", tmp_path / "s.json")[0] == 0
    schema = json.loads((tmp_path / "s.json").read_text())
    assert schema["$defs"]["Compliant"]["properties"]["stiffness"]["unit"] == "N/m"
    code, out, _ = spacerobot("schema")
    assert code == 0
    assert json.loads(out) == schema


BAD = {
    "missing file": (["check", "nowhere.yaml"], "no such file"),
    "near name": (["check", "papr"], "did you mean paper"),
    "unknown key": (["check", "paper", "--set", "grasps.left.stifness=1"], "did you mean stiffness"),
    "unknown path": (["check", "paper", "--set", "robot.rpr1.urdf=x"], "did you mean robots"),
    "no equals": (["check", "paper", "--set", "grasps"], "allowed: PATH=VALUE"),
    "negative mass": (["check", "paper", "--set", "target.links.body.mass=-1"], "target.links.body.mass"),
    "wrong type": (["check", "paper", "--set", "simulation.duration=long"], "simulation.duration"),
    "not finite": (["check", "paper", "--set", "simulation.duration=.inf"], "simulation.duration"),
    "unknown frame": (["check", "paper", "--set", "grasps.left.frame=mate_3"], "did you mean mate_"),
    "unknown link": (["check", "paper", "--set", "target.links.bodi.mass=1"], "did you mean body"),
    "unknown joint": (["check", "paper", "--set", "robots.rpr1.joints.joint_9.angle_deg=1"], "joint_"),
    "wrong unit": (["check", "paper", "--set", "robots.rpr1.joints.joint_1.offset=1"], "use angle_deg"),
    "open grasp": (
        ["check", "paper", "--set", "robots.rpr2.base={joint: planar, position: [2.42, 1.214, 0]}"],
        "does not close",
    ),
    "unknown urdf": (["check", "paper", "--set", "target.urdf=rectangel.urdf"], "rectangle.urdf"),
    "bad engine": (["run", "paper", "--engine", "magic"], "--engine"),
    "bad number": (["make-arm", "arm", "x.urdf", "--links", "0"], "links"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_gets_one_clear_line_and_exit_code_2(spacerobot, case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments, hint = BAD[case]
    code, _, err = spacerobot(*arguments)
    assert code == 2
    assert hint in one_line(err)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("robots: [", "line 1"),
        ("a: 1\na: 2", "is given twice"),
        ("- 1", "mapping"),
        ("", "mapping"),
        ("\x00", "error"),
        ("a: &a [*a]", "unfolds"),
        ("!!python/object/apply:os.system ['true']", "could not determine a constructor"),
    ],
)
def test_bad_yaml_gets_one_clear_line(spacerobot, tmp_path, text, hint):
    (tmp_path / "bad.yaml").write_text(text)
    code, _, err = spacerobot("check", tmp_path / "bad.yaml")
    assert code == 2
    assert hint in one_line(err)
    assert "bad.yaml" in err


def test_a_folder_that_cannot_be_written_is_told_before_any_work(spacerobot, tmp_path):
    (tmp_path / "file").write_text("x")
    code, out, err = spacerobot("run", "paper", "--out", tmp_path / "file")
    assert (code, out) == (2, "")
    assert "is a file" in one_line(err)


def test_a_result_is_replaced_by_the_same_scenario_and_not_by_another(spacerobot, tmp_path, monkeypatch):
    folder = tmp_path / "r"
    for duration in (0.5, 0.4):
        code, _, _ = spacerobot("run", "paper", "--out", folder, "--set", f"simulation.duration={duration}")
        assert code == 0
    assert Result.load(folder).data.time.values[-1] == 0.4
    monkeypatch.setattr("spacerobot.simulate", None)
    code, out, err = spacerobot("run", "drift", "--out", folder)
    assert (code, out) == (2, "")
    assert "holds a result of the scenario 'paper', which that of 'drift' would replace" in one_line(err)
    assert Result.load(folder).scenario.name == "paper"


def test_a_picture_after_the_end_of_a_result_is_refused(spacerobot, tmp_path):
    spacerobot("run", "paper", "--out", tmp_path / "r", *SHORT)
    picture = tmp_path / "late.png"
    code, _, err = spacerobot("animate", tmp_path / "r", "--record", picture, "--at", 30)
    assert code == 2
    assert "--at: found 30 s, allowed: 0 to 0.5 s, the times of the result" in one_line(err)
    assert not picture.exists()


values = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(10**20), 10**20),
    st.floats(),
    st.text(max_size=8),
    st.lists(st.floats(-5, 5), max_size=4),
    st.dictionaries(st.text(max_size=5), st.integers(), max_size=2),
)


@settings(
    max_examples=20,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_mangled_scenarios_never_end_in_a_traceback(spacerobot, tmp_path_factory, data):
    document = yaml.safe_load(shipped()["paper"].read_text())
    node = document
    while isinstance(node, dict) and node:
        key = data.draw(st.sampled_from(sorted(node)))
        if not isinstance(node[key], dict) or data.draw(st.integers(0, 2)) == 0:
            how = data.draw(st.sampled_from(["replace", "remove", "add"]))
            if how == "replace":
                node[key] = data.draw(values)
            elif how == "remove":
                del node[key]
            else:
                node[data.draw(st.text(max_size=6))] = data.draw(values)
            break
        node = node[key]
    file = tmp_path_factory.mktemp("mangled") / "s.yaml"
    file.write_text(yaml.safe_dump(document, allow_unicode=True), encoding="utf-8")
    code, _, err = spacerobot("check", file)
    assert code in (0, 2)
    if code == 2:
        assert "error: " in err
        assert "Traceback" not in err


@settings(
    max_examples=12,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
def test_mangled_urdfs_never_end_in_a_traceback(spacerobot, tmp_path_factory, data):
    content = bytearray(find_urdf("rectangle.urdf").read_bytes())
    for _ in range(data.draw(st.integers(1, 6))):
        place = data.draw(st.integers(0, len(content) - 1))
        how = data.draw(st.sampled_from(["flip", "cut", "repeat"]))
        if how == "flip":
            content[place] = data.draw(st.integers(0, 255))
        elif how == "cut":
            del content[place : place + data.draw(st.integers(1, 200))]
        else:
            content[place:place] = content[place : place + 60]
        content = content or bytearray(b" ")
    folder = tmp_path_factory.mktemp("mangled")
    (folder / "object.urdf").write_bytes(bytes(content))
    document = yaml.safe_load(shipped()["paper"].read_text())
    document["target"]["urdf"] = "object.urdf"
    (folder / "s.yaml").write_text(yaml.safe_dump(document))
    code, _, err = spacerobot("check", folder / "s.yaml")
    assert code in (0, 2)
    assert "Traceback" not in err


def test_help_is_quick_to_load_nothing_heavy():
    heavy = ("pinocchio", "casadi", "xarray", "yourdfpy")
    code = f"import sys, spacerobot.cli.app; print([m for m in {heavy} if m in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_every_command_has_an_example(spacerobot):
    command_line.cache_clear()  # another test may have asked for the help option without the group
    commands = "run check animate figures report paper tune sweep compare campaign scenarios make-arm schema"
    for command in commands.split():
        code, out, err = spacerobot(command, "-h")
        assert code == 0, (command, err)
        assert "Example" in out
        assert f"spacerobot {command}" in out


def test_version_is_the_packages(spacerobot):
    import spacerobot as package

    code, out, _ = spacerobot("--version")
    assert (code, out.strip()) == (0, package.__version__)
    assert Path(package.__file__).parent.name == "spacerobot"


@pytest.mark.parametrize(
    ("change", "kinds"),
    [
        ("grasps.left.kind=glue", tuple(kinds("grasp"))),
        ("robots.rpr1.tips.tip.reference.kind=x", tuple(kinds("reference"))),
    ],
)
def test_a_wrong_kind_lists_every_kind_there_is(spacerobot, change, kinds):
    code, _, err = spacerobot("check", "paper", "--set", change)
    assert code == 2
    assert ", ".join(kinds) in one_line(err)
    mapping = json.loads(spacerobot("schema")[1])["$defs"]
    assert set(kinds) <= {d.get("properties", {}).get("kind", {}).get("const") for d in mapping.values()}


@pytest.mark.parametrize(
    ("file", "name"), [("mine.yaml", "mine"), ("2 grips.yaml", "_grips"), ("7.yaml", "scenario")]
)
def test_a_scenario_without_a_name_takes_its_files(spacerobot, tmp_path, file, name):
    document = yaml.safe_load(shipped()["paper"].read_text())
    del document["name"]
    (tmp_path / file).write_text(yaml.safe_dump(document))
    code, out, _ = spacerobot("check", tmp_path / file)
    assert code == 0
    assert out.startswith(f"{name} planar")


def test_units_in_help_and_in_check(spacerobot):
    code, out, _ = spacerobot("make-arm", "arm", "--help")
    text = " ".join(out.replace("│", " ").split())
    assert code == 0
    for words in ("Length of a link [m].", "Mass of a link [kg].", "Joint resistance [N m s/rad]."):
        assert words in text
    code, out, _ = spacerobot("check", "paper")
    assert "joint_1: revolute, at 40 deg, damping 0.1 N m s/rad, limit 1000 N m, moves" in out
    assert "amnesia G_e 500 1/s^2, t_a 3 1/s" in out


def test_a_shell_completes_commands_and_options(spacerobot, monkeypatch):
    monkeypatch.setenv("_SPACEROBOT_COMPLETE", "complete_bash")
    for words, place, found in (("spacerobot ru", 1, ["run"]), ("spacerobot run --en", 2, ["--engine"])):
        monkeypatch.setenv("COMP_WORDS", words)
        monkeypatch.setenv("COMP_CWORD", str(place))
        assert spacerobot()[1].split() == found


@pytest.mark.skipif(os.name != "posix", reason="needs a shell")
@pytest.mark.parametrize("closed", [">&-", "<&- >&- 2>&-"])
def test_a_closed_stdout_is_no_fault(closed):
    command = f"{shlex.quote(sys.executable)} -m spacerobot check paper {closed}"
    ended = subprocess.run(["/bin/sh", "-c", command], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "", "")
