"""A result whose ledger is open says so, everywhere and with what to do; others do not."""

import json
import re

import pytest

from spacerobot.cli.commands.run import fail_if_diverged
from spacerobot.common.errors import DivergedError
from spacerobot.result import Result
from spacerobot.result.trust import (
    LEAST_ENERGY,
    LEAST_MOMENTUM,
    MOST_DRIFT,
    MOST_RESIDUAL,
    check_trust,
    warning,
)
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from tests.oracles import one_arm
from viz.page.animation import animation
from viz.report.report import report

ROUGH = {
    "simulation.method": "rk4",
    "simulation.step": 0.01,
    "robots.arm.joints.joint_1.rate_deg": 500,
}


def ledger(drift=0.0, largest=1.0, residual=0.0, energy=1.0):
    momentum = {
        kind: {f"drift_{unit}": drift, f"largest_partial_{unit}": largest}
        for kind, unit in (("linear", "n_s"), ("angular", "n_m_s"))
    }
    return {
        "momentum": {"conserved": True, **momentum},
        "energy": {"largest_residual_j": residual, "largest_energy_j": energy},
    }


@pytest.fixture(scope="module")
def rough(tmp_path_factory):
    """A fast arm, its steps far too long."""
    folder = tmp_path_factory.mktemp("rough")
    return simulate(load_scene(one_arm.write(folder), ROUGH)).save(folder / "r")


def test_the_limits_are_the_stated_ones():
    assert check_trust(True, ledger(drift=MOST_DRIFT, residual=MOST_RESIDUAL), "x") == {
        "trusted": True,
        "open": [],
        "advice": None,
    }
    found = check_trust(True, ledger(drift=0.32, residual=0.038), "shorter")
    assert found == {
        "trusted": False,
        "open": ["momentum drift 32 % linear, 32 % angular", "energy residual 3.8 %"],
        "advice": "shorter",
    }


def test_rounding_in_a_scene_at_rest_is_no_doubt_and_no_number_is():
    rest = ledger(MOST_DRIFT * LEAST_MOMENTUM, 1e-12, MOST_RESIDUAL * LEAST_ENERGY, 1e-12)
    assert check_trust(True, rest, "")["trusted"]
    assert not check_trust(True, ledger(residual=float("nan")), "")["trusted"]


def test_momentum_that_is_not_constant_is_not_judged_and_a_diverged_rollout_is_not_trusted():
    held = ledger() | {"momentum": {"conserved": False, "reason": "gravity"}}
    assert check_trust(True, held, "")["trusted"]
    assert check_trust(False, ledger(drift=9.0), "") == {"trusted": False, "open": [], "advice": None}


def test_an_open_ledger_is_told_in_status_summary_page_and_report(rough, undrawn):
    status = json.loads((rough.folder / "summary.json").read_text())["status"]
    assert status["state"] == "completed"
    assert not status["trusted"]
    assert dict(Result.load(rough.folder).headline())["status"].startswith(
        "completed, 1 s, but the ledger is open: momentum drift "
    )
    assert re.search(r"simulation\.step shorter than 0\.01 s, .*arm/joint_\d, \S+ rad/s at", status["advice"])
    (notice,) = [line for line in animation(rough)["notices"] if "ledger" in line]
    assert "do not trust these numbers" in notice
    text = report(rough)
    assert "but the ledger is open: momentum drift" in text
    assert "The ledger is open (momentum drift" in text


def test_the_command_line_warns_and_goes_on(rough, capsys):
    fail_if_diverged(rough)
    err = " ".join(capsys.readouterr().err.split())
    assert err.startswith("warning: small: the ledger is open (momentum drift")
    assert "take a simulation.step shorter than 0.01 s" in err


def test_a_fine_result_is_trusted(tmp_path):
    result = simulate(load_scene(one_arm.write(tmp_path)))
    status = result.summary["status"]
    assert status["trusted"]
    assert warning(status) is None
    assert dict(result.headline())["status"] == "completed, 1 s"


def test_where_no_step_can_be_chosen_the_fastest_joint_is_named(tmp_path):
    fast = {"robots.arm.joints.joint_1.rate_deg": 1e9, "simulation.step": None}
    with pytest.raises(DivergedError, match=r"the fastest joint is arm/joint_\d, \S+ rad/s at \S+ s; for a"):
        simulate(load_scene(one_arm.write(tmp_path), fast))
