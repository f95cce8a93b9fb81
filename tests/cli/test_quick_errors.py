"""Errors that need no model: commands report them before they import the libraries that take long to load."""

import subprocess
import sys

import pytest

HEAVY = ("casadi", "matplotlib", "numpy", "pandas", "pinocchio", "scipy", "xarray")
COMMANDS = ("campaign", "check", "falsify", "margins", "plan", "reliability", "robust", "run")
RUN = """
import sys
from spacerobot.cli.start import main
try:
    main()
except SystemExit as left:
    print(left.code, *(name for name in {heavy} if sys.modules.get(name)))
"""


def attempt(*arguments, folder):
    done = subprocess.run(
        [sys.executable, "-c", RUN.format(heavy=HEAVY), *arguments],
        capture_output=True,
        text=True,
        cwd=folder,
        check=True,
    )
    return done.stdout.split(), " ".join(done.stderr.split())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        *(((name, "papper"), "did you mean paper?") for name in (*COMMANDS, "studio", "sweep", "tune")),
        (("run", "my.yaml"), "my.yaml: no such file"),
        (("run", "broken.yaml"), "broken.yaml: line 1"),
        (("check", "paper", "--set", "simulation.duration"), "allowed: PATH=VALUE"),
        (("run", "paper", "--sat", "x=1"), "spacerobot run: no option '--sat'; did you mean --set"),
        (("run", "paper", "extra"), "found 'extra' after the last argument"),
        (("run", "paper", "--out"), "--out: its value is missing"),
        (("run", "paper", "--port", "x"), "--port: found 'x', allowed: an integer"),
        (("run", "paper", "--port=-1"), "--port: found '-1', allowed: "),
        (("run", "paper", "--backend", "fast"), "--backend: found 'fast', allowed: 'auto', 'compiled'"),
        (("run",), "SCENARIO is missing, as in `spacerobot run paper --out out/paper`"),
        (("rnu", "paper"), "no command 'rnu'; did you mean run?"),
        (("campaign", "paper"), "--out is missing, as in `spacerobot campaign paper --out out/campaign"),
        (
            ("plan", "docking", "--from", "missing"),
            "--from: no plan at missing; allowed: the folder of a plan",
        ),
        (("falsify", "ets7"), "campaign: no campaign section"),
        (("animate", "missing"), "missing: no such folder"),
        (("figures", "missing"), "missing: no such folder"),
        (("identify", "missing"), "missing: no such folder"),
        (("passive-safety", "missing"), "missing: no such folder"),
        (("report", "missing"), "missing: no such file or folder"),
        (("plan", "paper"), "plan: no such section"),
        (("compare", "papper"), "did you mean paper?"),
        (("export",), "as in `spacerobot export out/paper paper.csv`"),
        (("export", "papper", "paper.csv"), "did you mean paper?"),
        (("compare", "paper", "--methods", "nlpp"), "no method 'nlpp'"),
        (("tune", "paper", "--method", "nlpp"), "no method 'nlpp'"),
        (
            ("new", "--capture", "--robot", "arms/panda.urdf", "--target", "satellite_box.urdf"),
            "arms/panda.urdf: no such URDF file in ",
        ),
        (
            ("new", "--robot", "panda_arm.urdf", "--target", "ball.urdf", "--out", "broken.yaml"),
            "broken.yaml: exists already; name another file by --out",
        ),
        (("export", "plant", "papper", "--out", "paper.fmu"), "did you mean paper?"),
    ],
    ids=lambda one: " ".join(one) if isinstance(one, tuple) else None,
)
def test_an_error_that_needs_no_model_is_reported_without_loading_one(arguments, message, tmp_path):
    (tmp_path / "broken.yaml").write_text("robots: [")
    (code, *loaded), error = attempt(*arguments, folder=tmp_path)
    assert (code, loaded) == ("2", [])
    assert message in error
    assert error.startswith("error: ")


SLOW = ("matplotlib", "pandas", "scipy", "xarray")
"""Libraries of computations, of results and of figures, which the check of an option does not need."""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("campaign paper --out c --gains tund", "--gains: no set 'tund'; allowed: scenario; or NAME=DIR"),
        ("compare paper --sets bse", "--sets: no set of variables 'bse'; allowed: five, seven"),
        ("compare paper --variants bse", "--variants: no variant 'bse'; did you mean base?"),
        (
            "compare suite --problems nothing",
            "--problems: no problem 'nothing' in the suite; allowed: carry-",
        ),
        ("falsify paper --metric tip_eror", "--metric: no quantity 'tip_eror'; did you mean tip_error_rms"),
        ("falsify paper --metric tip_error_rms", "no limit of tip_error_rms; give one with --limit"),
        ("figures result --format jpeg2000", "--format: no format 'jpeg2000'; allowed: pdf, png, svg"),
        ("figures result --only tip_eror", "--only: no figure 'tip_eror'; did you mean tip_errors"),
        ("plan docking --pareto time", "--pareto: found 'time', allowed: two terms of the cost"),
        ("plan docking --pareto time,time", "--pareto: found 'time' twice, allowed: two terms"),
        ("plan docking --pareto tme,base_rotation", "--pareto: no term 'tme'; did you mean time?"),
        ("plan docking --sensitivities targt.mass", "--sensitivities: no 'targt'; did you mean target?"),
        ("reliability paper --method foo", "--method: no estimator 'foo'; allowed: importance"),
        (
            "reliability paper --metric tip_eror",
            "--metric: no quantity 'tip_eror'; did you mean tip_error_rms",
        ),
        ("robust paper --method foo", "--method: no method 'foo'; allowed: cmaes"),
        ("robust paper --variant bse", "--variant: no variant 'bse'; did you mean base?"),
        ("sweep paper --variables kk", "--variables: no variable or set 'kk'; allowed: five"),
        ("tune paper --variables kk", "--variables: no variable or set 'kk'; allowed: five"),
        ("tune paper --variant bse", "--variant: no variant 'bse'; did you mean base?"),
        *(
            (f"{name} empty", "empty: no result in this folder; allowed: a folder that a command has written")
            for name in ("animate", "figures", "identify", "passive-safety", "report")
        ),
        ("animate .", ".: no result in this folder; its subfolders hold some: result"),
        ("report text.txt", "text.txt: no result in this file; allowed: "),
        ("report other.json", "other.json: no result in this file; allowed: "),
        ("identify text.txt", "text.txt: is a file, not a folder"),
        (
            "animate result --record film.avi",
            "--record: found film.avi, allowed: a file .gif or",
        ),
        ("animate result --html film.gif", "--html: found film.gif, allowed: a file .html or .htm"),
        ("animate result --record film.gif --at 1", "--at: needs --record FILE.png, one picture"),
        ("animate result --record film.png --speed 2", "--speed: needs --record FILE.gif or FILE.mp4"),
        ("report result --out page.pdf", "--out: found page.pdf, allowed: a file .html or .htm"),
    ],
)
def test_a_wrong_option_or_result_is_reported_without_libraries_that_compute(arguments, message, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "result").mkdir()
    (tmp_path / "result" / "summary.json").write_text("{}")
    (tmp_path / "text.txt").write_text("text")
    (tmp_path / "other.json").write_text('{"other": 1}')
    files = sorted(tmp_path.rglob("*"))
    (code, *loaded), error = attempt(*arguments.split(), folder=tmp_path)
    assert code == "2"
    assert not {*SLOW} & {*loaded}
    assert message in error
    assert error.startswith("error: ")
    assert sorted(tmp_path.rglob("*")) == files


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("foo=1", "unknown key 'foo'; allowed: campaign"),
        ("foo.bar=1", "no 'foo'; allowed: campaign"),
        (
            "robots.*.tips.tip.pid.kp=-1",
            "found -1, allowed: at least 0 [N s/m]; robots.rpr2.tips.tip.pid.kp: ",
        ),
        ("simulation.duration=high", "found 'high', allowed: a number [s]"),
        ("simulation.durtion=1", "unknown key 'durtion'; did you mean duration?"),
        ("robots.rpr1.urdf=nowhere.urdf", "nowhere.urdf: no such URDF file in "),
        ("robots.rpr1.joints.nowhere.angle_deg=3", "no 'nowhere'; allowed: joint_1"),
    ],
)
def test_a_wrong_change_is_reported_without_pinocchio(change, message, tmp_path):
    (code, *loaded), error = attempt("run", "paper", "--set", change, folder=tmp_path)
    assert code == "2"
    assert "pinocchio" not in loaded
    assert error.startswith(f"error: --set {change}: {message}")


def test_a_change_that_another_value_contradicts_is_named_at_the_end(tmp_path):
    _, error = attempt("check", "docking", "--set", "plan.duration.upper=1", folder=tmp_path)
    assert "docking.yaml: plan.duration: lower must not be above upper" in error
    assert error.endswith("; with --set plan.duration.upper=1")


def test_an_error_of_the_file_is_not_reported_at_a_change_of_the_same_value(tmp_path):
    (tmp_path / "wrong.yaml").write_text(WRONG.replace("WORD", "frame").replace("KP", "-3"))
    _, error = attempt("run", "wrong.yaml", "--set", "robots.mine.tips.tip.pid.kp=-4", folder=tmp_path)
    assert "wrong.yaml: robots.mine.tips.tip.pid.kp: found -3, allowed: at least 0" in error
    assert "--set" not in error


def test_a_suffix_that_names_no_format_is_reported_without_results_or_scenes(tmp_path):
    (code, *loaded), error = attempt("export", "paper", "paper.xyz", folder=tmp_path)
    assert code == "2"
    assert not {"casadi", "pinocchio", "scipy", "xarray"} & {*loaded}
    assert "suffix '.xyz' names no format" in error


WRONG = """
robots:
  mine:
    urdf: short_arm.urdf
    base: {joint: planar}
    tips: {tip: {pid: {kp: KP}, reference: {kind: hold, WORD: 1}}}
"""


@pytest.mark.parametrize(
    ("word", "kp", "message"),
    [
        ("frame", "high", "robots.mine.tips.tip.pid.kp: found 'high', allowed: a number"),
        ("speed", "1", "robots.mine.tips.tip.reference: unknown key 'speed'"),
    ],
)
def test_a_wrong_key_or_value_is_reported_without_pinocchio_or_other_kinds(word, kp, message, tmp_path):
    (tmp_path / "wrong.yaml").write_text(WRONG.replace("WORD", word).replace("KP", kp))
    kinds = ("spacerobot.elements.controllers.mpc", "spacerobot.elements.actuators.thrusters")
    done = subprocess.run(
        [sys.executable, "-c", RUN.format(heavy=("pinocchio", "xarray", *kinds)), "run", "wrong.yaml"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=True,
    )
    assert done.stdout.split() == ["2"]
    assert message in " ".join(done.stderr.split())


def test_a_urdf_in_place_of_a_scenario_is_told_how_to_draft_one(tmp_path):
    (tmp_path / "arm.urdf").write_text('<?xml version="1.0"?>\n<robot name="arm"/>\n')
    (code, *loaded), error = attempt("run", "arm.urdf", folder=tmp_path)
    assert (code, loaded) == ("2", [])
    assert "arm.urdf: is XML, not a scenario; `spacerobot new --robot FILE` drafts a scenario" in error
