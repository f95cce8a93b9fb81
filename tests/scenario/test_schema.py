"""Validation: every fault is told in one line with its place, what was found and what is allowed."""

from __future__ import annotations

import re

import pytest
import yaml

from spacerobot.common.errors import ScenarioError
from spacerobot.common.section import leaves
from spacerobot.elements.goals.goal import FLAT
from spacerobot.elements.grasps.compliant import Compliant
from spacerobot.elements.grasps.weld import Weld
from spacerobot.elements.references.circle import Circle
from spacerobot.elements.references.hold import Hold
from spacerobot.elements.references.spline import Spline
from spacerobot.scenario import Scenario
from spacerobot.scenario.catalogue import shipped
from spacerobot.scenario.document import parse_yaml, read_document
from spacerobot.scenario.load import json_schema, to_document, to_yaml, validate
from spacerobot.scenario.plan import PlanSection
from tests.oracles.small_scenes import PLANAR, SPATIAL

ONE = "robots.one.tips.tip"


def faulty(changes: dict[str, object], text: str = PLANAR) -> str:
    """Message of the error that a document with values put at dotted paths raises."""
    document = parse_yaml(text)
    for path, value in changes.items():
        node = document
        *parents, last = path.split(".")
        for key in parents:
            node = node.setdefault(key, {}) if isinstance(node, dict) else node[int(key)]
        node[int(last) if isinstance(node, list) else last] = value
    with pytest.raises(ScenarioError) as caught:
        validate(document, source="some.yaml")
    message = str(caught.value)
    assert message.startswith("some.yaml: ")
    assert "\n" not in message
    return message.removeprefix("some.yaml: ")


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"gravty": [0, 0, 0]}, "unknown key 'gravty'; did you mean gravity?"),
        ({f"{ONE}.pid.kq": 3}, f"{ONE}.pid: unknown key 'kq'; allowed: derivative, feedback, .*kp"),
        (
            {"robots.one.base.possition": [0, 0, 0]},
            "robots.one.base: unknown key 'possition'; did you mean position",
        ),
        ({"grasps.left.stifness": 3}, "grasps.left: unknown key 'stifness'; did you mean stiffness"),
        ({"simulation.steps": 3}, "simulation: unknown key 'steps'; did you mean step"),
        ({f"{ONE}.reference.raidus": 1}, f"{ONE}.reference: unknown key 'raidus'; did you mean radius"),
        (
            {"robots.one.joints.joint_1.angle": 1},
            "robots.one.joints.joint_1: unknown key 'angle'; did you mean angle_deg",
        ),
        # ranges and types
        ({f"{ONE}.pid.kp": -1}, f"{ONE}.pid.kp: found -1, allowed: at least 0"),
        ({f"{ONE}.reference.radius": 0}, f"{ONE}.reference.radius: found 0, allowed: above 0"),
        ({f"{ONE}.pid.kp": "much"}, f"{ONE}.pid.kp: found 'much', allowed: a number \\[N s/m\\]$"),
        ({f"{ONE}.pid.kp": True}, f"{ONE}.pid.kp: found True, a truth value"),
        ({f"{ONE}.pid.kp": float("nan")}, f"{ONE}.pid.kp: found nan, allowed: a finite number"),
        ({f"{ONE}.pid.kp": float("inf")}, f"{ONE}.pid.kp: found inf, allowed: a finite number"),
        ({f"{ONE}.pid.kp": None}, f"{ONE}.pid.kp: found null, allowed: a number"),
        (
            {f"{ONE}.pid.feedback": "both"},
            f"{ONE}.pid.feedback: found 'both', allowed: 'base' or 'inertial'",
        ),
        ({f"{ONE}.amnesia.ta": -0.1}, f"{ONE}.amnesia.ta: .*at least 0"),
        (
            {"robots.one.base.position": [0, 0]},
            r"robots.one.base.position: found \[0, 0\], allowed: a longer list",
        ),
        ({"robots.one.base.position": [0, 0, 0, 0]}, r"robots.one.base.position: .*at most 3"),
        (
            {"robots.one.base.joint": "ball"},
            "robots.one.base.joint: found 'ball', allowed: 'planar', 'free_flyer' or 'fixed'",
        ),
        (
            {"robots.one.links": {"base": {"mass": -1}}},
            "robots.one.links.base.mass: found -1, allowed: at least 0",
        ),
        (
            {"robots.one.links": {"base": {"inertia": [1, 1, 1]}}},
            r"robots.one.links.base.inertia: found .*allowed: a longer list",
        ),
        ({"simulation.step": 0}, "simulation.step: .*above 0"),
        (
            {"simulation.engine": "drake"},
            "simulation.engine: found 'drake', allowed: 'casadi' or 'pinocchio'",
        ),
        (
            {"simulation.output_step": 1e-9},
            r"simulation.output_step: found 1e-09 s, 2e\+09 times in",
        ),
        ({"simulation.step": 1e-12}, r"simulation.step: found 1e-12 s, 2e\+12 times"),
        ({"simulation.step": 3}, "simulation.step: found 3, allowed: at most the duration, 2 s"),
        ({"simulation": 3}, "simulation: found 3, allowed: a section of keys and values"),
        ({"gravity": -9.81}, r"gravity: found -9.81, allowed: a list, as \[0, 0, 1\]"),
        ({"name": 3}, "name: found 3, allowed: a text"),
        ({"robots.one.torque_limits": 3}, "robots.one.torque_limits: found 3, allowed: true or false"),
        ({"grasps.left": None}, "grasps.left: found null, allowed: a section"),
        ({"robots": {}}, "robots: .*at least 1"),
        ({"robots.one.urdf": ""}, "robots.one.urdf: .*at least 1 character"),
        ({"robots.one": None}, "robots.one: found null, allowed: a section"),
        ({"robots.a/b": {"urdf": "arm.urdf"}}, r"robots.a/b: found 'a/b', allowed: letters, digits"),
        ({"robots.one.tips.1st": {}}, r"robots.one.tips.1st: .*a letter or _ in front"),
        ({"name": "two words"}, "name: .*allowed: letters"),
        # what belongs together
        ({f"{ONE}.pid": None}, f"{ONE}: the amnesia controller corrects the PID's reference: give `pid` too"),
        (
            {f"{ONE}.orientation_amnesia": {"ge": 1, "ta": 1}},
            f"{ONE}: `orientation_amnesia` corrects `orientation_pid`: give it too",
        ),
        ({"grasps.left.kind": "glue"}, "grasps.left.kind: found 'glue', allowed: compliant, point, weld"),
        ({"grasps.left.kind": "weld"}, r"grasps.left: unknown key 'stiffness'; allowed: .* \(kind: weld\)$"),
        (
            {f"{ONE}.reference.kind": "helix"},
            f"{ONE}.reference.kind: found 'helix', allowed: brake, circle, hold, line, plan, rendezvous, "
            "spline",
        ),
        ({"grasps.left.tip": "one"}, "grasps.left.tip: found 'one', allowed: robot/tip"),
        ({"grasps.left.tip": "one/tap"}, "grasps.left.tip: no tip 'one/tap'; did you mean one/tip"),
        ({"grasps.left.tip": "two/tip"}, "grasps.right.tip: 'two/tip' already holds grasp 'left'"),
        ({"target": None}, "grasps.left: there is no target to hold"),
        ({"robots.target": {"urdf": "arm.urdf"}}, "robots.target: `target` is the held object's name"),
        ({"target.base.close_grasp": "lift"}, "target.base.close_grasp: no grasp 'lift'; did you mean left"),
        (
            {"target.base.position": [1, 0, 0]},
            "target.base: give either `position` or `close_grasp`, not both",
        ),
        (
            {"robots.two.base.joint": "fixed"},
            "robots.two.base: a fixed base is not placed by closing a grasp",
        ),
        ({"robots.one.base.joint": "fixed"}, "robots.one.base: a fixed base has no velocity"),
        ({"robots.one.base.rotation_deg": [1, 0, 0]}, "robots.one.base: a planar base turns about z"),
        ({"robots.one.base.velocity": [0, 0, 1]}, "robots.one.base: a planar base turns about z"),
    ],
)
def test_fault_is_told_with_its_place(changes, expected):
    assert re.match(expected, faulty(changes)), faulty(changes)


def test_several_errors_are_stated_with_their_units():
    assert faulty({f"{ONE}.pid.kp": -1, f"{ONE}.pid.ki": -1}) == (
        f"{ONE}.pid.kp: found -1, allowed: at least 0 [N s/m]; "
        f"{ONE}.pid.ki: found -1, allowed: at least 0 [N/m]"
    )


def test_errors_beyond_the_first_four_are_counted():
    wrong = {f"{ONE}.pid.{key}": -1 for key in ("kp", "ki", "kd")}
    wrong |= {f"robots.two.tips.tip.pid.{key}": -1 for key in ("kp", "ki", "kd")}
    assert faulty(wrong).endswith("; and 2 more errors")


def test_two_limits_that_one_number_violates_are_one_error():
    assert faulty({"plan": {"duration": -2}}) == "plan.duration: found -2, allowed: above 0"


def test_missing_key_is_named():
    assert faulty({"robots.three": {}}) == "robots.three.urdf: missing"
    assert faulty({"grasps.left": {"kind": "weld", "tip": "one/tip"}}) == "grasps.left.frame: missing"


@pytest.mark.parametrize(
    ("spline", "expected"),
    [
        ({"times": [0, 1], "displacements": [[0, 0, 0]] * 3}, "2 times but 3 displacements"),
        ({"times": [1, 2], "displacements": [[0, 0, 0]] * 2}, "times must start at 0, found 1"),
        ({"times": [0, 2, 2], "displacements": [[0, 0, 0]] * 3}, "times must rise strictly"),
        ({"times": [0, 2], "displacements": [[0, 0.1, 0]] * 2}, "the first displacement must be 0 0 0"),
        ({"times": [0], "displacements": [[0, 0, 0]]}, ".*at least 2"),
    ],
)
def test_spline_faults(spline, expected):
    message = faulty({f"{ONE}.reference": {"kind": "spline"} | spline})
    assert re.match(rf"{ONE}.reference(.times)?: {expected}", message), message


def test_kinds_are_read_as_their_own_sections():
    document = parse_yaml(SPATIAL)
    document["grasps"]["left"] = {"kind": "weld", "tip": "one/tip", "frame": "left"}
    document["robots"]["one"]["tips"]["tip"]["reference"] = {"kind": "hold"}
    document["robots"]["two"]["tips"]["tip"]["reference"] = {
        "kind": "spline",
        "times": [0, 1],
        "displacements": [[0, 0, 0], [1, 0, 0]],
    }
    scenario = validate(document)
    assert isinstance(scenario.grasps["left"], Weld)
    assert isinstance(scenario.grasps["right"], Compliant)
    assert isinstance(scenario.robots["one"].tips["tip"].reference, Hold)
    assert isinstance(scenario.robots["two"].tips["tip"].reference, Spline)
    assert isinstance(validate(parse_yaml(PLANAR)).robots["one"].tips["tip"].reference, Circle)
    with pytest.raises(Exception, match="frozen"):
        scenario.name = "other"


@pytest.mark.parametrize("text", [PLANAR, SPATIAL])
def test_yaml_round_trip(text):
    scenario = validate(parse_yaml(text))
    again = validate(parse_yaml(to_yaml(scenario)))
    assert again == scenario
    assert to_yaml(again) == to_yaml(scenario)
    assert validate(to_document(scenario)) == scenario


def test_every_number_has_a_unit_and_every_field_a_description():
    def walk(schema, where):
        for name, field in schema.get("properties", {}).items():
            text = str(field)
            if name in {"kind", "base", "simulation"} or ("$ref" in text and "description" not in text):
                continue
            assert "description" in text, f"{where}.{name}"
            numeric = field.get("type") == "number" or any(
                option.get("type") == "number" for option in field.get("anyOf", ())
            )
            assert not numeric or "unit" in field or where == "DesignVariable", f"{where}.{name} has no unit"

    schema = json_schema()
    assert schema["title"] == "spacerobot scenario"
    walk(schema, "Scenario")
    for name, section in schema["$defs"].items():
        walk(section, name)


def test_plain_form_holds_every_number_of_the_scenario():
    document = to_document(validate(parse_yaml(PLANAR)))
    paths = dict(leaves(document))
    assert paths["robots.one.tips.tip.pid.filter_time"] == 0.02  # defaults included
    assert paths["robots.one.base.velocity.1"] == -0.02
    assert yaml.safe_load(yaml.safe_dump(document)) == document
    assert Scenario.model_validate(document).name == "flat"


@pytest.mark.parametrize("name", sorted(shipped()))
def test_editors_find_no_fault_with_what_ships(name):
    """An editor judges by the exported schema alone."""
    jsonschema = pytest.importorskip("jsonschema")
    judge = jsonschema.Draft202012Validator(json_schema())
    document = read_document(shipped()[name])
    assert [fault.message for fault in judge.iter_errors(document)] == []
    assert list(judge.iter_errors(document | {"gravity": 3}))


def test_editors_know_the_kind_that_a_section_has_by_default():
    jsonschema = pytest.importorskip("jsonschema")
    judge = jsonschema.Draft202012Validator(json_schema())
    document = parse_yaml(PLANAR)
    for sensor, faults in (({"errors": {"period": 0.1}}, 0), ({"kind": "gyro"}, 0), ({"scale": "much"}, 1)):
        document["robots"]["one"]["sensors"] = {"base_spin": sensor}
        assert len(list(judge.iter_errors(document))) == faults


def test_every_field_of_the_schema_says_what_it_is():
    schema = json_schema()
    sections = {"Scenario": schema, **schema["$defs"]}
    silent = [
        f"{section}.{key}"
        for section, definition in sections.items()
        for key, field in definition["properties"].items()
        if "description" not in field and "const" not in field
    ]
    assert set(silent) <= {"Campaign.limits"}


@pytest.mark.parametrize(
    ("given", "kind"),
    [
        ({"tip": "arm/tip", "frame": "mate_1"}, "mated"),
        ({"tip": "arm/tip", "position": [0, 0, 0]}, "placed"),
        ({"robot": "arm", "joints": {"*": {"angle_deg": 0}}}, "posture"),
        ({"still": "target"}, "still"),
        ({"attitude": "arm", "rotation_deg": [0, 0, 180]}, "attitude"),
    ],
)
def test_the_kind_of_a_goal_is_told_by_its_keys_as_in_older_results(given, kind):
    section = {"duration": 1, "costs": {"time": 1}}
    for goal in (given, FLAT | given, given | {"kind": kind}):
        planning = PlanSection.model_validate(section | {"goals": {"one": goal}})
        assert planning.goals["one"].kind == kind
        assert PlanSection.model_validate(planning.model_dump(mode="json")) == planning


@pytest.mark.parametrize(
    ("goal", "found"),
    [({"tip": "arm/tip"}, "none"), ({"tip": "a/b", "frame": "c", "position": [0, 0, 0]}, "frame, position")],
)
def test_a_goal_of_no_kind_or_of_two_is_refused(goal, found):
    section = {"duration": 1, "costs": {"time": 1}, "goals": {"one": goal}}
    with pytest.raises(
        ValueError, match=f"found {found}, allowed: one of attitude, frame, position, joints, still"
    ):
        PlanSection.model_validate(section)
