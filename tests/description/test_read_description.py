"""Reading a URDF of one's own: what works, what it becomes, what is refused."""

from __future__ import annotations

import hashlib
import re
import textwrap

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spacerobot.common.errors import DescriptionError
from spacerobot.description import Description, find_urdf, read_description, shipped_names
from spacerobot.description import read as read_module
from spacerobot.description.bodies import check_bodies, odd_bodies, welded_bodies

NUMBERS = st.floats(-2, 2).map(lambda value: round(value, 3))
TRIPLES = st.lists(NUMBERS, min_size=3, max_size=3)


def text(values: list[float]) -> str:
    return " ".join(map(str, values))


@st.composite
def trees(draw) -> str:
    """Robot with a random tree, axes, origins and rotated inertial frames; some links are mere frames."""
    count = draw(st.integers(1, 6))
    parts = []
    for index in range(count):
        massless = False
        if index:
            parent = draw(st.integers(0, index - 1))
            kind = draw(st.sampled_from(["revolute", "continuous", "prismatic", "fixed"]))
            massless = kind == "fixed" and draw(st.booleans())
            axis = draw(TRIPLES.filter(lambda values: np.linalg.norm(values) > 0.1))
            parts.append(
                f'<joint name="j{index}" type="{kind}"><origin xyz="{text(draw(TRIPLES))}" '
                f'rpy="{text(draw(TRIPLES))}"/><parent link="l{parent}"/><child link="l{index}"/>'
                f'<axis xyz="{text(axis)}"/><limit lower="-1" upper="2" effort="3" velocity="4"/></joint>'
            )
        mass, low = draw(st.floats(0.1, 10)), draw(st.floats(0.1, 1))
        inertial = (
            f'<inertial><origin xyz="{text(draw(TRIPLES))}" rpy="{text(draw(TRIPLES))}"/>'
            f'<mass value="{mass}"/><inertia ixx="{low}" iyy="{1.2 * low}" izz="{1.5 * low}" '
            f'ixy="{0.1 * low}" ixz="0" iyz="{-0.05 * low}"/></inertial>'
        )
        parts.append(f'<link name="l{index}">{"" if massless else inertial}</link>')
    return f'<robot name="r">{"".join(parts)}</robot>'


@settings(deadline=None, max_examples=60, derandomize=True)
@given(urdf=trees(), seed=st.integers(0, 1000))
def test_prefixed_xml_is_the_same_robot_to_pinocchio(tmp_path_factory, urdf: str, seed: int) -> None:
    path = tmp_path_factory.mktemp("tree") / "tree.urdf"
    path.write_text(urdf)
    description = read_description(path)
    raw = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer())
    own = pin.buildModelFromXML(description.to_pinocchio_xml("x/"), pin.JointModelFreeFlyer())
    assert list(own.names)[:2] == list(raw.names)[:2]
    assert list(own.names)[2:] == [f"x/{name}" for name in list(raw.names)[2:]]
    assert {f"x/{link.name}" for link in description.links} <= {frame.name for frame in own.frames}
    q = pin.integrate(raw, pin.neutral(raw), np.random.default_rng(seed).normal(size=raw.nv))
    data_raw, data_own = raw.createData(), own.createData()
    np.testing.assert_allclose(pin.crba(own, data_own, q), pin.crba(raw, data_raw, q), atol=1e-11)
    pin.framesForwardKinematics(raw, data_raw, q)
    pin.framesForwardKinematics(own, data_own, q)
    for link in description.links:
        there = data_raw.oMf[raw.getFrameId(link.name, pin.FrameType.BODY)]
        here = data_own.oMf[own.getFrameId(f"x/{link.name}", pin.FrameType.BODY)]
        np.testing.assert_allclose(here.homogeneous, there.homogeneous, atol=1e-13)


@pytest.mark.parametrize("name", shipped_names())
def test_shipped_files_reach_pinocchio_with_names_and_shapes(name: str) -> None:
    description = read_description(find_urdf(name))
    xml = description.to_pinocchio_xml("rpr1/")
    model = pin.buildModelFromXML(xml, pin.JointModelFreeFlyer())
    moving = [f"rpr1/{joint.name}" for joint in description.joints if joint.kind != "fixed"]
    assert sorted(list(model.names)[2:]) == sorted(moving)
    for link in description.links:
        assert model.existFrame(f"rpr1/{link.name}", pin.FrameType.BODY)
    for kind, count in (
        (pin.GeometryType.VISUAL, sum(len(link.visuals) for link in description.links)),
        (pin.GeometryType.COLLISION, sum(len(link.collisions) for link in description.links)),
    ):
        assert pin.buildGeomFromUrdfString(model, xml, kind).ngeoms == count
    visuals = pin.buildGeomFromUrdfString(model, xml, pin.GeometryType.VISUAL).geometryObjects
    assert all(shape.name.startswith("rpr1/") for shape in visuals)
    np.testing.assert_allclose(
        [shape.meshColor for shape in visuals],
        [shape.rgba for link in _as_pinocchio_orders(description, visuals) for shape in link.visuals],
    )


@settings(deadline=None, max_examples=60, derandomize=True)
@given(urdf=trees())
def test_welded_bodies_are_pinocchios(tmp_path_factory, urdf: str) -> None:
    """Pinocchio, too, adds links that are fixed to each other; principal inertias do not depend on frames."""
    path = tmp_path_factory.mktemp("tree") / "tree.urdf"
    path.write_text(urdf)
    description = read_description(path)
    model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer())
    bodies = welded_bodies(description.links, description.joints, description.root)
    found = sorted([body.mass, *np.linalg.eigvalsh(body.inertia)] for body in bodies)
    expected = sorted([one.mass, *np.linalg.eigvalsh(one.inertia)] for one in list(model.inertias)[1:])
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def _as_pinocchio_orders(description: Description, visuals) -> list:
    by_name = {f"rpr1/{link.name}": link for link in description.links}
    order = dict.fromkeys(shape.name.rsplit("_", 1)[0] for shape in visuals)
    return [by_name[name] for name in order]


def test_joint_values_reach_description_and_pinocchio(urdf) -> None:
    path = urdf.two_links(
        '<origin xyz="1 2 3" rpy="0 0 0.5"/><axis xyz="0 3 4"/>'
        '<limit lower="-1.5" upper="2.5" effort="7" velocity="3"/><dynamics damping="0.25" friction="0"/>'
    )
    description = read_description(path)
    joint = description.joints[0]
    np.testing.assert_allclose(joint.axis, (0, 0.6, 0.8), rtol=1e-15)
    assert (joint.lower, joint.upper, joint.effort, joint.velocity) == (-1.5, 2.5, 7, 3)
    assert (joint.damping, joint.kind, joint.parent, joint.child) == (0.25, "revolute", "a", "b")
    np.testing.assert_array_equal(joint.origin[:3, 3], (1, 2, 3))
    model = pin.buildModelFromXML(description.to_pinocchio_xml("p/"))
    assert (model.lowerPositionLimit[0], model.upperPositionLimit[0]) == (-1.5, 2.5)
    assert (model.upperEffortLimit[0], model.upperVelocityLimit[0]) == (7, 3)
    assert model.damping[0] == 0.25
    assert description.warnings == ()
    assert description.path == path
    assert description.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert (description.name, description.root) == ("r", "a")


@pytest.mark.parametrize(("kind", "nq"), [("revolute", 1), ("continuous", 2), ("prismatic", 1), ("fixed", 0)])
def test_kinds_of_joint(urdf, kind: str, nq: int) -> None:
    description = read_description(urdf.two_links(kind=kind))
    assert pin.buildModelFromXML(description.to_pinocchio_xml("")).nq == nq


def test_continuous_joint_needs_no_limit(urdf) -> None:
    joint = read_description(urdf.two_links(urdf.DYNAMICS, kind="continuous")).joints[0]
    assert (joint.lower, joint.upper, joint.effort, joint.velocity) == (-np.inf, np.inf, np.inf, np.inf)


def test_inertial_frame_is_turned_to_link_axes(urdf) -> None:
    """A quarter turn about z swaps the inertias about x and y."""
    inertial = (
        '<inertial><origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/><mass value="2"/>'
        '<inertia ixx="1" iyy="2" izz="2.5"/></inertial>'
    )
    link = read_description(urdf.write(urdf.link("a", inertial))).links[0]
    np.testing.assert_allclose(link.inertia, np.diag([2, 1, 2.5]), atol=1e-15)
    np.testing.assert_array_equal(link.com, (1, 0, 0))


def test_arrays_are_read_only() -> None:
    description = read_description(find_urdf("planar_arm"))
    link, joint = description.links[0], description.joints[0]
    for array in (link.com, link.inertia, joint.axis, joint.origin, link.visuals[0].placement):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_massless_links_may_carry_and_be_carried(urdf) -> None:
    """A massless root welded to a massive one, and a point mass welded to a body, are one body each."""
    point = '<inertial><mass value="1"/><inertia ixx="0" iyy="0" izz="0"/></inertial>'
    path = urdf.write(
        urdf.link("world", ""),
        urdf.link("bus"),
        urdf.link("arm", ""),
        urdf.link("hand"),
        urdf.link("ballast", point),
        urdf.joint("w", "world", "bus", "fixed", ""),
        urdf.joint("j", "bus", "arm"),
        urdf.joint("h", "arm", "hand", "fixed", '<origin xyz="0.5 0 0"/>'),
        urdf.joint("p", "hand", "ballast", "fixed", ""),
    )
    description = read_description(path)
    model = pin.buildModelFromXML(description.to_pinocchio_xml("s/"), pin.JointModelFreeFlyer())
    assert [inertia.mass for inertia in model.inertias] == [0, 2, 3]


def test_a_moving_link_without_inertial_is_warned_about_and_a_fixed_frame_is_not(urdf) -> None:
    path = urdf.write(
        urdf.link("bus"),
        urdf.link("forgotten", ""),
        urdf.link("hand"),
        urdf.link("tool_frame", ""),
        urdf.joint("shoulder", "bus", "forgotten"),
        urdf.joint("wrist", "forgotten", "hand"),
        urdf.joint("mount", "hand", "tool_frame", "fixed", ""),
    )
    description = read_description(path)
    bodies = welded_bodies(description.links, description.joints, description.root)
    (warning,) = odd_bodies(bodies, floating=True)
    assert warning.startswith("link 'forgotten': joint shoulder moves it, but")
    assert odd_bodies(bodies, floating=True, pieces=("forg",)) == []


def test_colours_by_name_in_passing_and_missing(urdf) -> None:
    def visual(material: str) -> str:
        return f'{urdf.INERTIAL}<visual><geometry><sphere radius="1"/></geometry>{material}</visual>'

    path = urdf.write(
        '<material name="red"><color rgba="1 0 0 1"/></material>',
        urdf.link("a", visual('<material name="red"/>')),
        urdf.link("b", visual('<material name="x"><color rgba="0 2 0 1"/></material>')),
        urdf.link("c", visual('<material name="x"><color rgba="0 0 1 1"/></material>')),
        urdf.link("d", visual('<material name="undefined"/>')),
        *(urdf.joint(f"j{name}", "a", name) for name in "bcd"),
    )
    description = read_description(path)
    xml = description.to_pinocchio_xml("k/")
    model = pin.buildModelFromXML(xml)
    shapes = pin.buildGeomFromUrdfString(model, xml, pin.GeometryType.VISUAL).geometryObjects
    colours = {shape.name: list(shape.meshColor) for shape in shapes}
    assert colours["k/a_0"] == [1, 0, 0, 1]
    assert colours["k/b_0"] == [0, 1, 0, 1]
    assert colours["k/c_0"] == [0, 0, 1, 1]
    assert description.links[3].visuals[0].rgba is None


REFUSED = {
    "no limit": ("", {}, "joint 'j'.*<limit>"),
    "effort": ('<limit lower="0" upper="1" velocity="1"/>', {}, "joint 'j' <limit>.*no 'effort'"),
    "range": ('<limit lower="1" upper="0" effort="1" velocity="1"/>', {}, "joint 'j'.*above upper"),
    "negative damping": ("LIMIT<dynamics damping='-1'/>", {}, "joint 'j' <dynamics>.*found damping='-1'"),
    "zero axis": ("LIMIT<axis xyz='0 0 0'/>", {}, "joint 'j'.*axis is zero"),
    "two axes": ("LIMIT<axis xyz='0 0 1'/><axis xyz='0 1 0'/>", {}, "joint 'j'.*2 <axis>"),
    "short axis": ("LIMIT<axis xyz='0 1'/>", {}, "joint 'j' <axis>.*'0 1', allowed: 3 finite"),
    "nan": ("LIMIT<origin xyz='0 nan 0'/>", {}, "joint 'j' <origin>.*found xyz='0 nan 0'"),
    "overflow": ("LIMIT<origin xyz='0 1e400 0'/>", {}, "joint 'j' <origin>.*1e400"),
    "far away": ("LIMIT<origin xyz='0 1e300 0'/>", {}, "joint 'j' <origin>.*allowed: -1e"),
    "underscore": ("LIMIT<origin xyz='0 1_0 0'/>", {}, "joint 'j' <origin>.*1_0"),
    "planar": ("LIMIT", {"kind": "planar"}, "joint 'j'.*'planar', allowed: revolute"),
    "floating": ("", {"kind": "floating"}, "joint 'j'.*'floating', allowed: revolute"),
    "unknown": ("", {"kind": "screw"}, "joint 'j'.*'screw', allowed: revolute"),
    "negative mass": (
        "LIMIT",
        {"b": '<inertial><mass value="-1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'},
        "link 'b' <mass>.*'-1', allowed: 0 to",
    ),
    "infinite inertia": (
        "LIMIT",
        {"b": '<inertial><mass value="1"/><inertia ixx="inf" iyy="1" izz="1"/></inertial>'},
        "link 'b' <inertia>.*ixx='inf'",
    ),
    "capsule": (
        "LIMIT",
        {"b": "INERTIAL<visual><geometry><capsule radius='1'/></geometry></visual>"},
        "link 'b' <geometry>.*<capsule>; allowed is one of box",
    ),
    "empty geometry": (
        "LIMIT",
        {"b": "INERTIAL<collision><geometry/></collision>"},
        "link 'b' <geometry>.*holds nothing",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_simulated_is_refused(urdf, case: str) -> None:
    joint, others, message = REFUSED[case]
    others = {key: value.replace("INERTIAL", urdf.INERTIAL) for key, value in others.items()}
    path = urdf.two_links(joint.replace("LIMIT", urdf.LIMIT), **others)
    with pytest.raises(DescriptionError, match=message) as caught:
        read_description(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


POINT = '<inertial><mass value="1"/></inertial>'
MASSES = {
    "massless": ({"b": ""}, "link 'b'.*moving link; it has no mass.*lock joint j by"),
    "mass 0": ({"b": '<inertial><mass value="0"/></inertial>'}, "link 'b'.*moving link; it has no mass"),
    "indefinite": (
        {"b": '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="2"/></inertial>'},
        "link 'b'.*has principal inertias -1, 1, 3",
    ),
    "inertia, no mass": (
        {"b": '<inertial><mass value="0"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'},
        "link 'b'.*inertia but no mass",
    ),
}


def judge(description: Description) -> None:
    bodies = welded_bodies(description.links, description.joints, description.root)
    check_bodies(bodies, description.path, floating=True)


@pytest.mark.parametrize("case", MASSES)
def test_masses_that_cannot_move_are_refused_unless_locked(urdf, case: str) -> None:
    others, message = MASSES[case]
    description = read_description(urdf.two_links(**others)).settled({}, ())
    with pytest.raises(DescriptionError, match=message):
        judge(description)
    if "mass" in case:
        judge(description.settled({"j": 0.3}, ("j",)))


def test_links_welded_together_are_judged_by_their_sum(urdf) -> None:
    """A point mass, an inertia without mass and one below zero, welded to a body that outweighs them."""
    odd = [
        POINT,
        '<inertial><mass value="0"/><inertia ixx="0.1" iyy="0.1" izz="0.1"/></inertial>',
        '<inertial><mass value="1"/><inertia ixx="-0.01" iyy="0.1" izz="0.1"/></inertial>',
    ]
    welded = [urdf.link(f"o{i}", text) for i, text in enumerate(odd)]
    welded += [urdf.joint(f"w{i}", "b", f"o{i}", "fixed", "") for i in range(len(odd))]
    good = urdf.write(urdf.link("a"), urdf.link("b"), urdf.joint("j", "a", "b"), *welded)
    judge(read_description(good))
    alone = urdf.write(urdf.link("a"), urdf.link("b", odd[2]), urdf.joint("j", "a", "b"))
    with pytest.raises(DescriptionError, match=r"has principal inertias -0\.01, 0\.1, 0\.1"):
        judge(read_description(alone))


def test_all_ends_without_mass_are_named_at_once_and_those_within_a_chain_are_not(urdf) -> None:
    ends = [urdf.link(f"end_{i}", "") for i in (1, 2)]
    joints = [urdf.joint(f"j_{i}", "a", f"end_{i}") for i in (1, 2)]
    chain = [urdf.link("cross", ""), urdf.link("b")]
    chain += [urdf.joint("up", "a", "cross"), urdf.joint("on", "cross", "b")]
    judge(read_description(urdf.write(urdf.link("a"), *chain)))
    with pytest.raises(DescriptionError) as caught:
        judge(read_description(urdf.write(urdf.link("a"), *chain, *ends, *joints)))
    assert "lock joints j_2, j_1 by `joints: {NAME: {locked: true}}`" in str(caught.value)
    assert "faults as well: end_1." in str(caught.value)


@pytest.mark.parametrize(
    ("limit", "lower", "upper"),
    [
        ("", -np.inf, np.inf),
        ('upper="2"', 0, 2),
        ('lower="-2"', -2, 0),
    ],
)
def test_one_end_of_a_range_left_out_is_zero_and_both_are_none(urdf, limit, lower, upper) -> None:
    joint = read_description(urdf.two_links(f'<limit {limit} effort="1" velocity="1"/>')).joints[0]
    assert (joint.lower, joint.upper) == (lower, upper)


def test_trees_that_are_none_are_refused(urdf) -> None:
    a, b, c, ab = urdf.link("a"), urdf.link("b"), urdf.link("c"), urdf.joint("ab", "a", "b")
    cases = {
        "holds no link": ["<material name='x'/>"],
        "2 links have no parent (a, b)": [a, b],
        "joint 'cb': gives link 'b' a second parent": [a, b, c, ab, urdf.joint("cb", "c", "b")],
        "the joints close a loop": [a, b, ab, urdf.joint("ba", "b", "a")],
        "closes a loop that 'a' does not reach": [
            a,
            b,
            c,
            urdf.joint("bc", "b", "c"),
            urdf.joint("cb", "c", "b"),
        ],
        "joint 'x': child link 'bb' does not exist; did you mean b?": [a, b, urdf.joint("x", "a", "bb")],
        "link 'a' (line 3): is the second link of this name": [a, a],
        "joint 'ab' (line 6): is the second joint of this name": [a, b, c, ab, urdf.joint("ab", "a", "c")],
    }
    for message, parts in cases.items():
        with pytest.raises(DescriptionError, match=re.escape(message)):
            read_description(urdf.write(*parts))


def test_long_chains_are_read_and_absurd_ones_refused(urdf) -> None:
    def chain(count: int) -> list[str]:
        return [urdf.link(f"l{i}") for i in range(count)] + [
            urdf.joint(f"j{i}", f"l{i}", f"l{i + 1}") for i in range(count - 1)
        ]

    assert pin.buildModelFromXML(read_description(urdf.write(*chain(1000))).to_pinocchio_xml("")).nq == 999
    with pytest.raises(DescriptionError, match="holds 1001 links, allowed are 1000"):
        read_description(urdf.write(*chain(1001)))


def test_warnings_say_what_was_ignored_or_assumed(urdf) -> None:
    slab = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="3"/></inertial>'
    speck = '<inertial><mass value="1e-4"/><inertia ixx="1e-6" iyy="1e-6" izz="1e-6"/></inertial>'
    path = urdf.write(
        "<bumper/>",
        urdf.link("a", speck),
        urdf.link("b", slab),
        urdf.link("c"),
        urdf.joint("ab", "a", "b", inside='<limit lower="0" upper="0" effort="0" velocity="1"/>'),
        urdf.joint("bc", "b", "c", inside=urdf.LIMIT + '<dynamics friction="1"/>'),
    )
    description = read_description(path)
    assert description.warnings == (
        "unknown element <bumper> ignored",
        "no <dynamics>, damping taken as 0: joint ab",
        "dry friction ignored: joint bc",
        "the effort limit is 0: joint ab",
        "the range is empty: joint ab",
    )
    bodies = welded_bodies(description.links, description.joints, description.root)
    assert odd_bodies(bodies, floating=False) == [
        "link 'b': no body has principal inertias 1, 1, 3 kg m^2: the largest exceeds the sum of the others"
    ]
    warned = [warning.split(":")[0] for warning in odd_bodies(bodies, floating=True)]
    assert warned == ["link 'b'", "link 'a'", "link 'a'"]


def test_text_that_reaches_outside_is_refused(urdf) -> None:
    secret = urdf.write_text("secret", "secret.txt")
    link = urdf.link("a")
    attacks = [
        f'<!DOCTYPE robot [<!ENTITY x SYSTEM "{secret.as_uri()}">]><robot name="r">&x;{link}</robot>',
        f'<!DOCTYPE robot [<!ENTITY % x SYSTEM "{secret.as_uri()}">%x;]><robot name="r">{link}</robot>',
        f'<!DOCTYPE robot [<!ENTITY a "{"ha" * 99}"><!ENTITY b "{"&a;" * 99}"><!ENTITY c "{"&b;" * 99}">'
        f'<!ENTITY d "{"&c;" * 99}">]><robot name="&d;">{link}</robot>',
        f'<!DOCTYPE robot SYSTEM "{secret.as_uri()}"><robot name="r">{link}</robot>',
    ]
    for attack in attacks:
        for data in (attack.encode(), attack.encode("utf-16")):
            with pytest.raises(DescriptionError, match=r"declares|no well-formed XML") as caught:
                read_description(urdf.write_text(data))
            assert len(str(caught.value)) < 1000


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "no well-formed XML"),
        ("not XML", "no well-formed XML"),
        ('<robot name="r"><link name="a"></robot>', "no well-formed XML"),
        (b"\x00\xff\xfe", "no well-formed XML"),
        ('<?xml version="1.0" encoding="nonsense"?><robot name="r"/>', "no well-formed XML"),
        ("<sdf/>", "<sdf> .line 1.: is the outermost element"),
        ("<robot/>", "<robot> .line 1.: has no 'name'"),
    ],
)
def test_text_that_is_no_urdf(urdf, content: str | bytes, message: str) -> None:
    with pytest.raises(DescriptionError, match=message) as caught:
        read_description(urdf.write_text(content))
    assert "<string>" not in str(caught.value)
    assert "{" not in str(caught.value)


def test_files_that_cannot_be_read(tmp_path, urdf, monkeypatch) -> None:
    for path, message in (
        (tmp_path / "none.urdf", "cannot be read: No such file"),
        (tmp_path, "is no file"),
        (tmp_path / "a\0b", "cannot be read: .*null"),
        (tmp_path / ("x" * 5000), "cannot be read: File name too long"),
    ):
        with pytest.raises(DescriptionError, match=message):
            read_description(path)
    monkeypatch.setattr(read_module, "MOST_BYTES", 100)
    with pytest.raises(DescriptionError, match="is 101 bytes long, allowed are 100"):
        read_description(urdf.write_text("x" * 101))


def test_reading_prints_and_logs_nothing(urdf, capfd, caplog) -> None:
    with pytest.raises(DescriptionError):
        read_description(urdf.write_text("<robot"))
    assert read_description(urdf.write("<größe/>", urdf.link("a"))).warnings
    description = read_description(find_urdf("servicer"))
    pin.buildModelFromXML(description.to_pinocchio_xml("s/"))
    assert capfd.readouterr() == ("", "")
    assert caplog.records == []


def test_comments_and_other_encodings_are_read(urdf) -> None:
    text = textwrap.dedent(f"""\
        <?xml version="1.0" encoding="iso-8859-1"?>
        <!-- häßlich -->
        <robot name="r"><link name="grün">{urdf.INERTIAL}<!-- inside --></link><gazebo/></robot>
        """)
    description = read_description(urdf.write_text(text.encode("iso-8859-1")))
    assert description.root == "grün"
    assert pin.buildModelFromXML(description.to_pinocchio_xml("ö/")).existFrame("ö/grün")
    assert description.warnings == ()
