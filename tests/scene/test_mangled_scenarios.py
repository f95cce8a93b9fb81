"""Whatever a scenario file holds, it becomes a scene or an error of this project."""

from __future__ import annotations

import copy
import datetime
import functools

import numpy as np
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from spacerobot.common.errors import ScenarioError, SpaceRobotError
from spacerobot.scenario.document import parse_yaml
from spacerobot.scenario.load import to_document, to_yaml, validate
from spacerobot.scene import Scene, build_scene
from tests.oracles.small_scenes import PLANAR, SPATIAL, folder

RICH = {
    "one": {
        "joint_pd": {"kp": 3, "kd": 1},
        "sensors": {"joint_rate": {"offset": 0.1, "scale": 1.1}},
        "links": {"base": {"mass": 33}},
        "torque_limits": True,
    },
}
JUNK = [
    *(None, True, -1, 0, 1, 3.5, 1e308, -1e308, 5e-324, float("nan"), float("inf"), 10**400, 2**63),
    *(
        "",
        "x",
        "\x00",
        "a/b",
        "one/tip",
        "left",
        "root",
        "hold",
        "1e3",
        "../x",
        "/dev/null",
        "x" * 300,
        "é\n",
    ),
    *([], [0, 0], [0, 0, 0], [1, 2, 3], [1e200] * 3, [0] * 6, [1e308] * 6, [-1, 1, 1, 0, 0, 0], [[]], [None]),
    *(
        {},
        {"kind": "hold"},
        {"kind": None},
        {"kind": []},
        {"": {}},
        {"mass": 1},
        {"kp": 1},
        {"joint": "fixed"},
    ),
    *(datetime.date(2001, 1, 1), b"\xff\xfe", {1, 2}, ("a",), 1j),
]


@functools.cache
def originals() -> tuple[dict, ...]:
    documents = [parse_yaml(PLANAR), parse_yaml(SPATIAL)]
    for document in list(documents):
        resolved = to_document(build(document).scenario)
        for name, more in RICH.items():
            resolved["robots"][name].update(copy.deepcopy(more))
        documents.append(resolved)
    return tuple(documents)


def build(document: object) -> Scene:
    source = folder() / "scenario.yaml"
    return build_scene(validate(document, source=source), source=source)  # type: ignore[arg-type]


def containers(node: object, found: list | None = None) -> list:
    """Every dictionary and list of a document."""
    found = [] if found is None else found
    if isinstance(node, dict | list) and node:
        found.append(node)
        for child in node.values() if isinstance(node, dict) else node:
            containers(child, found)
    return found


@st.composite
def mangled(draw: st.DrawFn) -> object:
    document = copy.deepcopy(draw(st.sampled_from(originals())))
    for _ in range(draw(st.integers(1, 3))):
        places = containers(document)
        if not places:
            break
        node = draw(st.sampled_from(places))
        key = draw(st.sampled_from(list(node) if isinstance(node, dict) else range(len(node))))
        match draw(st.sampled_from(["junk", "junk", "junk", "drop", "transplant", "add", "rename"])):
            case "junk":
                node[key] = copy.copy(draw(st.sampled_from(JUNK)))
            case "drop":
                del node[key]
            case "transplant":
                node[key] = copy.deepcopy(draw(st.sampled_from(places)))
            case "add" if isinstance(node, dict):
                node[draw(st.sampled_from(["", "x", "kp", "target", "root", "a.b", "kind", 3]))] = node[key]
            case "rename" if isinstance(node, dict):
                node[draw(st.sampled_from(["x", "two", "tip", "mate_1", "joint_1"]))] = node.pop(key)
            case _:
                pass
    return document


@given(mangled())
@settings(deadline=None, max_examples=400, derandomize=True, suppress_health_check=list(HealthCheck))
def test_mangled_documents_become_scenes_or_errors(document):
    try:
        with np.errstate(all="ignore"):
            scene = build(document)
    except SpaceRobotError as fault:
        told(fault)
        return
    assert scene.model.nv == len(scene.v)
    assert validate(parse_yaml(to_yaml(scene.scenario))) == scene.scenario


def told(fault: SpaceRobotError) -> None:
    """One line that a person can act on."""
    text = str(fault)
    assert "\n" not in text
    assert 10 < len(text) < 1200
    assert fault.exit_code == 2


@functools.cache
def texts() -> tuple[str, ...]:
    return (PLANAR, SPATIAL, to_yaml(build(originals()[0]).scenario))


PIECES = [
    *"{}[]:,-#&*!|>'\"%@`? \n\t\x00\x07é",
    "<<: *a",
    "&a ",
    "*a",
    "!!binary x",
    "---\n",
    "...",
    "1e999",
    "~",
    "0x",
]


@st.composite
def mangled_texts(draw: st.DrawFn) -> str:
    text = draw(st.sampled_from(texts()))
    for _ in range(draw(st.integers(1, 4))):
        begin = draw(st.integers(0, len(text)))
        end = min(len(text), begin + draw(st.integers(0, 12)))
        put = draw(st.one_of(st.sampled_from(PIECES), st.text(max_size=3)))
        match draw(st.sampled_from(["replace", "insert", "double", "cut"])):
            case "replace":
                text = text[:begin] + put + text[end:]
            case "insert":
                text = text[:begin] + put + text[begin:]
            case "double":
                text = text[:end] + text[begin:end] + text[end:]
            case "cut":
                text = text[:begin]
    return text


@given(mangled_texts())
@example(PLANAR + "description: !!binary gIGBgoOE")
@settings(deadline=None, max_examples=250, derandomize=True, suppress_health_check=list(HealthCheck))
def test_mangled_texts_become_scenes_or_errors(text):
    try:
        document = parse_yaml(text, source="some.yaml")
        with np.errstate(all="ignore"):
            build(document)
    except SpaceRobotError as fault:
        told(fault)


@given(st.text(max_size=40))
@settings(deadline=None, max_examples=200, derandomize=True)
def test_any_text_parses_or_is_refused(text):
    try:
        parse_yaml(text)
    except ScenarioError as fault:
        assert "\n" not in str(fault)  # noqa: PT017


CHANGES = st.tuples(
    st.sampled_from(
        [
            "robots.*.tips.tip.pid.kp",
            "robots.one.sensors.joint_rate.offset",
            "robots.one.urdf",
            "robots.*",
            "grasps.left",
            "target",
            "target.urdf",
            "grasps.*.kind",
            "tuning.variables.x.lower",
            "gravity.1",
            "gravity.*.x",
            "robots.one.joints.joint_1.angle_deg",
            "robots.one.links.nolink.mass",
            "robots.one.joints.nojoint.damping",
            "*",
            "",
            "...",
            "simulation.step",
            "name",
        ]
    ),
    st.sampled_from(JUNK),
)


@given(st.lists(CHANGES, min_size=1, max_size=2))
@settings(deadline=None, max_examples=150, derandomize=True)
def test_any_change_is_made_or_refused(changes):
    source = folder() / "scenario.yaml"
    try:
        with np.errstate(all="ignore"):
            build_scene(validate(parse_yaml(PLANAR)), changes, source=source)
    except SpaceRobotError as fault:
        told(fault)
