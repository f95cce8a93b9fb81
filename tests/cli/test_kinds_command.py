"""``spacerobot kinds``: all kinds, one family, and the keys of one kind."""

import pytest

import spacerobot as sr
from spacerobot.cli import app
from spacerobot.common.errors import SpaceRobotError
from spacerobot.elements import FAMILIES, PLANS, kinds
from spacerobot.quantities import planned


@pytest.fixture
def shown(capsys):
    def run(*arguments):
        app.command_line()(["kinds", *arguments], standalone_mode=False)
        return capsys.readouterr().out

    return run


@pytest.mark.parametrize("family", [*(FAMILIES | PLANS), "plan-cost"])
def test_a_family_is_listed_without_the_others(shown, family):
    text = shown(family)
    names = [line.split()[0] for line in text.splitlines()[4:] if line[:3].strip() and line[0] != "`"]
    own = kinds(family) if family in FAMILIES | PLANS else planned()
    assert set(own) <= set(text.split())
    assert set(names) <= set(own)
    assert "…" not in text


def test_a_name_of_two_families_has_a_heading_for_each(shown):
    both, one = shown("base_wrench"), shown("actuator", "base_wrench")
    assert "actuator base_wrench" in both
    assert "plan cost base_wrench" in both
    assert "plan cost" not in one
    assert set(one.split()) <= set(both.split())
    assert "weight" in shown("plan_cost", "base_wrench")
    assert "weight" not in one


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("circel",), "no family or kind 'circel'; did you mean circle"),
        (("qqq",), "no family or kind 'qqq'; families: reference, .*plan_cost"),
        (("actuator", "circle"), "no kind of actuator 'circle'; allowed: base_wrench, .*thrusters"),
        (("circle", "actuator"), "no family 'circle'; allowed: actuator, "),
    ],
)
def test_a_wrong_name_lists_what_is_allowed(shown, arguments, message):
    with pytest.raises(SpaceRobotError, match=message) as fault:
        shown(*arguments)
    assert "..." not in str(fault.value)


def test_quantities_are_listed_as_a_family_and_hide_no_kind_of_the_same_name():
    listed = sr.list_kinds("quantities").summaries["quantity"]
    assert "[m]" in listed["tip_error_peak"]
    assert sr.list_kinds("quantity").summaries["quantity"] == listed
    assert sr.list_kinds("tip_error_peak").summaries == {
        "quantity": {"tip_error_peak": listed["tip_error_peak"]}
    }
    assert sr.list_kinds("propellant").kinds["plan_cost"].keys() == {"propellant"}
    with pytest.raises(sr.SpaceRobotError, match="did you mean tip_error_peak"):
        sr.list_kinds("tip_error_pek")
