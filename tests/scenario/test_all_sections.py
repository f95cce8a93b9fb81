"""Every section of every shipped scenario and example refuses what does not belong there in one line."""

from __future__ import annotations

import copy

import pytest

from spacerobot.common.errors import ScenarioError
from spacerobot.scenario.document import parse_yaml
from spacerobot.scenario.load import validate
from tests.oracles.mangled import SOURCES, Case, cases, filled, judged

BY_NAME = {source.name: source for source in SOURCES}


@pytest.mark.parametrize("seed", range(4))
def test_mangled_scenarios_are_scenes_or_refused(seed):
    assert [wrong for case in cases(seed, 40) if (wrong := judged(case)) is not None] == []


NO_SECTIONS = (3, "text", [1], None, True, {"a": 1}, {"a": None}, [[1]], {"tip": 3}, {"tip": {"pid": 3}})


@pytest.mark.parametrize("wrong", NO_SECTIONS, ids=repr)
@pytest.mark.parametrize(
    ("source", "place"),
    [
        ("docking.yaml", "phases.approach.robots"),
        ("docking.yaml", "phases.approach.robots.rpr1"),
        ("docking.yaml", "phases.approach.robots.rpr1.tips"),
        ("docking.yaml", "phases.approach.robots.rpr1.tips.tip"),
        ("docking.yaml", "phases.approach.target"),
        ("docking.yaml", "phases.approach.grasps"),
        ("catch.yaml", "plan.phases"),
        *(
            ("catch.yaml", f"plan.phases.*.{key}")
            for key in ("approach_cones", "line_of_sight", "costs", "keep_out", "goals")
        ),
    ],
)
def test_phases_hold_sections_alone(source, place, wrong):
    document = copy.deepcopy(filled(BY_NAME[source]))
    *parents, last = place.split(".")
    node = document
    for key in parents:
        key = next(iter(node)) if key in ("*", "approach") else key
        node = node.setdefault(key, {}) if isinstance(node, dict) else node
    node[last] = wrong
    assert judged(Case(BY_NAME[source], document)) is None


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a: !!bool maybe", "line 1, column 4: found 'maybe', which is no bool"),
        ("a: !!float ''", "line 1, column 4: found '', which is no float"),
        ("a: !!int text", "which is no int"),
        ("a: !!timestamp 1", "a timestamp, where plain values"),
    ],
)
def test_tags_that_do_not_fit_are_refused(text, told):
    with pytest.raises(ScenarioError, match=told):
        parse_yaml(text)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (1e308, "torque: found 1e.308, allowed: numbers up to 1e.100"),
        (-1e101, "numbers up to"),
        (2**63, "found 9223372036854775808, a whole number of more than 64 bits"),
        (10**400, "found some 1e400, a whole number of more than 64 bits"),
        (10**5000, "found some 1e5000"),
        (float("inf"), "found inf, allowed: a finite number"),
        ([[2**63]], "a whole number of more than 64 bits"),
    ],
    ids=lambda value: str(value)[:20] if not isinstance(value, int) else f"2^{value.bit_length()}",
)
def test_numbers_that_cannot_be_computed_with_are_refused(wrong, told):
    document = copy.deepcopy(filled(BY_NAME["reach.yaml"]))
    document["plan"]["costs"]["torque"] = wrong
    with pytest.raises(
        ScenarioError, match=rf"plan\.costs\.torque(\.weight)?: .*{told.removeprefix('torque: ')}"
    ):
        validate(document)
    document = copy.deepcopy(filled(BY_NAME["reach.yaml"]))
    document["plan"]["seed"] = wrong
    with pytest.raises(ScenarioError, match=r"^plan\.seed: "):
        validate(document)
