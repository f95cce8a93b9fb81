"""Dotted paths."""

from __future__ import annotations

import contextlib
import copy

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spacerobot.common.errors import ScenarioError
from spacerobot.common.section import leaves
from spacerobot.scenario.load import apply_changes, to_document, validate
from spacerobot.scenario.paths import assign, expand, get
from spacerobot.scene import load_scene

DOCUMENT = {
    "robots": {
        "a": {"tips": {"x": {"kp": 1, "pid": None}, "y": {"kp": 2}}, "links": {"arm.v2": {"mass": 3}}},
        "b": {"tips": {"x": {"kp": 4}}, "links": {}},
    },
    "gravity": [0, 0, -1],
}


def test_leaves_in_the_documents_order():
    assert list(leaves(DOCUMENT)) == [
        ("robots.a.tips.x.kp", 1),
        ("robots.a.tips.x.pid", None),
        ("robots.a.tips.y.kp", 2),
        ("robots.a.links.arm.v2.mass", 3),
        ("robots.b.tips.x.kp", 4),
        ("gravity.0", 0),
        ("gravity.1", 0),
        ("gravity.2", -1),
    ]


def test_stars_stand_for_every_key():
    assert expand(DOCUMENT, "robots.*.tips.x.kp") == ["robots.a.tips.x.kp", "robots.b.tips.x.kp"]
    assert expand(DOCUMENT, "robots.a.tips.*.kp") == ["robots.a.tips.x.kp", "robots.a.tips.y.kp"]
    assert expand(DOCUMENT, "gravity.*") == ["gravity.0", "gravity.1", "gravity.2"]
    assert expand(DOCUMENT, "robots.a.links.*.mass") == ["robots.a.links.arm.v2.mass"]


def test_names_with_dots_are_matched_whole():
    assert get(DOCUMENT, "robots.a.links.arm.v2.mass") == 3
    assert assign(DOCUMENT, "robots.a.links.arm.v2.mass", 5)["robots"]["a"]["links"]["arm.v2"]["mass"] == 5


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("robotz.a", "no 'robotz'; did you mean robots"),
        ("robots.a.tips.x.kq", "no 'kq'; allowed: kp, pid"),
        ("robots.c.tips", "no 'c'; allowed: a, b"),
        ("gravity.3", "no element '3'; allowed: 0 to 2"),
        ("gravity.-1", "no element '-1'"),
        ("gravity.x", "no element 'x'"),
        ("robots.a.tips.x.kp.deeper", "1 has no parts, so no 'deeper'"),
        ("robots.b.links.*.mass", "`\\*` finds nothing here"),
        ("", "no ''"),
        ("robots..a", "no ''"),
    ],
)
def test_wrong_paths_are_told(path, message):
    with pytest.raises(ScenarioError, match=message) as caught:
        expand(DOCUMENT, path)
    assert caught.value.where == path
    if path:
        with pytest.raises(ScenarioError):
            get(DOCUMENT, path)
    with pytest.raises(ScenarioError, match="matches 2 values"):
        get(DOCUMENT, "robots.*.tips.x.kp")


def test_assigning_leaves_the_original_alone():
    before = copy.deepcopy(DOCUMENT)
    changed = assign(DOCUMENT, "robots.*.tips.*.kp", {"some": "value"})
    assert before == DOCUMENT
    values = [get(changed, path) for path in expand(changed, "robots.*.tips.*.kp")]
    assert values == [{"some": "value"}] * 3
    values[0]["some"] = "other"
    assert values[1] == {"some": "value"}  # copies, not the same object
    assert assign(DOCUMENT, "gravity.2", -3)["gravity"] == [0, 0, -3]
    assert assign(DOCUMENT, "gravity.*", 1)["gravity"] == [1, 1, 1]
    assert assign(DOCUMENT, "name", "new")["name"] == "new"


def test_assigning_opens_what_is_null():
    assert assign(DOCUMENT, "robots.a.tips.x.pid.kp", 7)["robots"]["a"]["tips"]["x"]["pid"] == {"kp": 7}
    deep = assign(DOCUMENT, "robots.a.tips.x.pid.deep.er", 7)
    assert deep["robots"]["a"]["tips"]["x"]["pid"] == {"deep": {"er": 7}}


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("robots.c.tips", "no 'c'"),
        ("gravity.7", "no element '7'; allowed: 0 to 2"),
        ("robots.a.tips.x.kp.more", "1 has no parts"),
        ("robots.b.links.*.mass", "finds nothing"),
    ],
)
def test_wrong_assignments_are_told(path, message):
    with pytest.raises(ScenarioError, match=message):
        assign(DOCUMENT, path, 1)


keys = st.text("abc.*0", max_size=4)
values = st.recursive(
    st.one_of(st.none(), st.integers(0, 3)),
    lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(keys, inner, max_size=3)),
    max_leaves=8,
)


@given(st.dictionaries(keys, values, max_size=4), st.text("abc.*012", max_size=8))
@settings(deadline=None, max_examples=300, derandomize=True)
def test_any_path_works_or_is_refused(document, path):
    for action in (expand, get, lambda d, p: assign(d, p, 1)):
        before = copy.deepcopy(document)
        with contextlib.suppress(ScenarioError):
            action(document, path)
        assert document == before


names = st.text("abc_", min_size=1, max_size=3)
plain = st.recursive(
    st.integers(0, 9),
    lambda inner: st.one_of(
        st.lists(inner, min_size=1, max_size=3), st.dictionaries(names, inner, min_size=1, max_size=3)
    ),
    max_leaves=8,
)


@given(st.dictionaries(names, plain, min_size=1, max_size=3))
@settings(deadline=None, max_examples=100, derandomize=True)
def test_every_leaf_is_found_and_set_by_its_path(document):
    for path, value in leaves(document):
        assert get(document, path) == value
        assert expand(document, path) == [path]
        assert get(assign(document, path, "new"), path) == "new"
        others = [leaf for leaf in leaves(assign(document, path, "new")) if leaf[0] != path]
        assert others == [leaf for leaf in leaves(document) if leaf[0] != path]


def one_by_one(document, changes):
    """Document after changes with a validation after each of them; changes that are invalid alone stay."""
    for pattern, value in changes:
        document = assign(document, pattern, value)
        with contextlib.suppress(ScenarioError):
            document = to_document(validate(document))
    return document


TIP = "robots.rpr1.tips.tip"


MASS = {"paths": "target.links.body.mass", "lower": 1, "upper": 2}


@pytest.mark.parametrize(
    "changes",
    [
        # keys that a section created by an earlier change has by default, by path and by pattern
        {"campaign": {"parameters": {"m": MASS}}, "campaign.limits.grip_force": 7, "campaign.samples": 9},
        {f"{TIP}.pid": {"kp": 5}, f"{TIP}.pid.filt*": 0.02},
        {f"{TIP}.reference": {"kind": "hold"}, f"{TIP}.reference.kind": "hold"},
        {"simulation": {"duration": 10, "step": 0.01}, "simulation.*step": 0.05},  # output_step by default
        # numbers by patterns, one after the other
        {"robots.*.tips.*.pid.kp": 300, "robots.*.tips.*.pid.ki": 30, "gravity.*": 0.5},
        # valid together only
        {"simulation.output_step": 5.0, "simulation.duration": 10},
    ],
)
def test_changes_validated_together_are_those_validated_one_by_one(changes):
    document, pairs = to_document(load_scene("paper").scenario), list(changes.items())
    assert apply_changes(document, pairs) == one_by_one(document, pairs)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (("simulation.duraton", 1), "simulation: unknown key 'duraton'"),
        (("simulation.duration", "high"), "simulation.duration: found 'high'"),
        ((f"{TIP}.pdi.kp", 1), f"change {TIP}.pdi.kp: no 'pdi'"),
    ],
)
def test_the_wrong_one_of_many_changes_is_named(wrong, message):
    changes = [("simulation.duration", 2), wrong, ("robots.*.tips.*.pid.kp", 300), ("simulation.step", 0.01)]
    with pytest.raises(ScenarioError) as refusal:
        load_scene("paper", changes)
    assert message in str(refusal.value)
