"""``spacerobot margins``: tables within 80 columns, figures, numbers, one line for each error."""

import sys

import pytest
import xarray as xr

from spacerobot.cli.app import main
from tests.linear.scenes import arm_scene


@pytest.fixture
def margins(monkeypatch, capsys):
    """The command on an arm with reaction to nothing, interpreted."""
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr("spacerobot.rollout.build.find_toolchain", lambda: None)
    source = arm_scene(1, "planar").source

    def run(*arguments):
        monkeypatch.setattr(sys, "argv", ["spacerobot", "margins", str(source), *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            main()
        captured = capsys.readouterr()
        return left.value.code or 0, captured.out, captured.err

    return run


def test_tables_and_diagrams_at_instants(margins, tmp_path):
    code, out, err = margins("--at", 0, "--at", 0.5, "--out", tmp_path)
    assert (code, err.strip()) == (0, "")
    assert max(len(line) for line in out.splitlines() if str(tmp_path) not in line) <= 80
    assert "torque/arm/joint_1" in out
    assert "6 poles at zero" in out
    names = {path.name for path in (tmp_path / "figures").iterdir()}
    assert names == {
        f"{kind}_{k}.{form}" for kind in ("bode", "nichols") for k in (1, 2) for form in ("pdf", "png", "svg")
    }
    assert xr.load_dataset(tmp_path / "margins.nc").phase.sel(loop="torque/arm/joint_1").size == 2


def test_a_wide_terminal_shows_crossovers_and_a_narrow_one_each_loop_once(margins, monkeypatch):
    narrow = margins("--at", 0)[1]
    monkeypatch.setenv("COLUMNS", "120")
    wide = margins("--at", 0)[1]
    for out in (narrow, wide):
        assert sum("torque/arm/joint_1" in line for line in out.splitlines()) == 1
    assert "crossover" in wide
    assert "crossover" not in narrow


def test_margins_over_time(margins, tmp_path):
    code, out, _ = margins("--along", 10, "--out", tmp_path)
    assert code == 0
    assert "least disk margins of 10 instants" in out
    assert (tmp_path / "figures" / "margins_along.png").exists()


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--at", "7"), "--at: found 7 s, allowed: from 0 to 1 s"),
        (("--at", "catched"), "--at: no event 'catched'"),
        (("--along", "1"), "--along: found 1, allowed: 0, or from 2 to"),
        (("--along", "3", "--at", "0"), "--along: does not go with --at"),
        (("--loops", "torque/*"), "--loops: needs --worst-case or --together"),
        (("--margin", "phase", "--together"), "--margin: needs --worst-case"),
        (("--together", "--out", "margins"), "--out: does not go with --together"),
        (("--together", "--worst-case", "hold.kd=2..6"), "--together: does not go with --worst-case"),
        (("--together", "--loops", "tork/*"), "--loops: no break point 'tork/*'; allowed: measurement/"),
        (
            ("--worst-case", "hold.kd=2..6", "--loops", "wheel/*"),
            "--loops: no break point 'wheel/*'; allowed: measurement/",
        ),
        (("--worst-case", "hold.kd=2"), "PATH=LOWER..UPPER"),
        (("--worst-case", "hold.kd=2..6", "--margin", "disc"), "--margin: found 'disc', allowed: 'disk'"),
    ],
)
def test_what_cannot_be_analysed_is_one_line_before_a_simulation(margins, monkeypatch, arguments, told):
    monkeypatch.setattr("spacerobot.linear.linearisation.Lineariser.rollout", None)
    code, _, err = margins(*arguments)
    assert code == 2
    assert len(err.strip().splitlines()) == 1
    assert told in err


def test_worst_case(margins):
    code, out, err = margins("--worst-case", "hold.kd=2..6", "--loops", "torque/*", "--margin", "phase")
    assert (code, err.strip()) == (0, "")
    assert "torque/arm/joint_1" in out
    assert "kd" in out


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--along", 10**20), "along: found 1e+20, allowed: 0, or from 2 to 100000"),
        (
            ("--worst-case", "arm.links.base.mass=-5..0"),
            "the lower end of the range is not allowed: found -5",
        ),
        (("--worst-case", "arm.links.link_1.mass=0..1"), "the lower end of the range is not allowed: "),
    ],
)
def test_ranges_beyond_what_is_possible_are_one_line(margins, arguments, expected):
    code, _, err = margins(*arguments)
    assert code == 2
    assert expected in err
    assert len(err.strip().splitlines()) == 1
