"""xacro files: expanded in a confined process for a scenario of one's own, never for a result."""

from __future__ import annotations

import hashlib
import importlib.util
import math
import sys

import pytest
import yaml

import spacerobot as sr
from spacerobot.cli.app import main
from spacerobot.common.errors import DescriptionError, ScenarioError
from spacerobot.description import read_description, xacro
from spacerobot.description.xacro_expression import ExpressionError, evaluate
from spacerobot.result import Result
from spacerobot.scenario.load import to_yaml
from spacerobot.scenario.yaml_text import Loader

NAMESPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
MACRO = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="m" value="{mass}"/>
<xacro:include filename="{included}"/>
{more}<xacro:body name="a"/><xacro:body name="b"/>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>
</robot>"""
BODY = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="body" params="name">
<link name="${name}"><inertial><mass value="${2 * m}"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
</xacro:macro></robot>"""
LEVELS = 9
BOMB = "".join(
    f'<xacro:macro name="m{k}">{f"<xacro:m{k + 1}/>" * 10 if k < LEVELS else "<frame/>"}</xacro:macro>'
    for k in range(LEVELS + 1)
)

needs_package = pytest.mark.skipif(importlib.util.find_spec("xacro") is None, reason="needs xacro")


@pytest.fixture
def xacro_file(urdf):
    urdf.write_text(BODY, "body.xacro")

    def write(mass="1.5", included="body.xacro", more="", name="arm.urdf.xacro"):
        return urdf.write_text(MACRO.format(mass=mass, included=included, more=more), name)

    return write


@needs_package
def test_a_xacro_file_is_expanded(xacro_file, capfd):
    path = xacro_file()
    description = read_description(path)
    assert [link.mass for link in description.links] == [3, 3]
    assert description.path == path
    assert description.sha256 != hashlib.sha256(path.read_bytes()).hexdigest()
    # the hash is of all that the file includes
    assert description.sha256 != read_description(xacro_file(mass="2")).sha256
    assert capfd.readouterr() == ("", "")


@needs_package
def test_files_of_the_package_arguments_and_yaml_are_read(xacro_file, urdf):
    # a package with its macros in another folder, and a second one beside it
    urdf.write_text("<package/>", "mine/package.xml")
    urdf.write_text("<package/>", "bodies/package.xml")
    urdf.write_text(BODY, "bodies/macros/body.xacro")
    urdf.write_text("masses: {light: 0.25, list: [1, 2]}", "mine/config/masses.yaml")
    mass = "${xacro.load_yaml('../config/masses.yaml').masses.light + $(arg extra)}"
    more = '<xacro:arg name="extra" default="1"/>'
    path = xacro_file(mass, "$(find bodies)/macros/body.xacro", more, "mine/urdf/arm.xacro")
    assert [link.mass for link in read_description(path).links] == [2.5, 2.5]


@pytest.mark.parametrize(
    ("mass", "message"),
    [
        ("${1 / 0}", "division by zero when evaluating"),
        ("${().__class__.__base__.__subclasses__()}", "attribute '__class__' of a tuple"),
        ("${python.type(1)}", "attribute 'type' of a NameSpace"),
        ("${9**9**9}", "more than 100000 bits"),
        ("${list(range(10**9))}", "needs more than 1024 MiB of memory"),
        ("${max(range(10**12))}", "more than 1 s of processor time"),
        ("${load_yaml('/etc/passwd')}", "/etc/passwd: may read only in"),
        ("${load_yaml('../secret.yaml')}", "secret.yaml: may read only in"),
        ("${load_yaml('linked.yaml')}", "linked.yaml: may read only in"),
        ("$(env HOME)", "reads the environment variable HOME"),
        ("$(eval __import__('os').system('true'))", "not allowed|invalid|not defined|was never closed"),
        ("$(find etc)", "no package 'etc'"),
        ("$(find ../mine)", "no package '../mine'"),
    ],
)
@needs_package
def test_a_xacro_file_cannot_escape(mass, message, xacro_file, urdf, monkeypatch):
    monkeypatch.setattr(xacro, "MAX_CPU_S", 1)
    secret = urdf.write_text("a: 1", "secret.yaml")
    urdf.write_text(BODY, "mine/body.xacro")
    (urdf.folder / "mine" / "linked.yaml").symlink_to(secret)
    path = xacro_file(mass, name="mine/arm.xacro")
    with pytest.raises(DescriptionError, match=f"xacro cannot expand it: .*({message})") as caught:
        read_description(path)
    assert "\n" not in str(caught.value)
    assert "Traceback" not in str(caught.value)


@pytest.mark.parametrize(
    ("included", "more", "message"),
    [
        ("none.xacro", "", "No such file"),
        ("/etc/hostname", "", "/etc/hostname: may read only in"),
        ("../body.xacro", "", "body.xacro: may read only in"),
        ("/etc/host*", "", "unknown macro name"),
        ("${'body' + '.xacro' * 10**9}", "", "more than 100000 bits or items"),
        ("body.xacro", f"{BOMB}<xacro:m0/>", "creates more than 30000 elements"),
        ("body.xacro", '<xacro:macro name="n"><xacro:n/></xacro:macro><xacro:n/>', "nested too deeply"),
    ],
)
@needs_package
def test_includes_and_macros_are_bounded(included, more, message, xacro_file, urdf):
    urdf.write_text(BODY, "mine/body.xacro")
    with pytest.raises(DescriptionError, match=f"xacro cannot expand it: .*{message}"):
        read_description(xacro_file(included=included, more=more, name="mine/arm.xacro"))


@pytest.mark.parametrize(
    "expression",
    [
        "().__class__",
        "(1).__class__.__mro__",
        "''.__class__",
        "[].append(1)",
        "'{0.__class__}'.format(1)",
        "'{a}'.format_map(x)",
        "f'{x.__class__}'",
        "(i for i in [1]).gi_frame.f_globals",
        "[i for i in [1]].__class__",
        "math.__loader__",
        "len.__self__",
        "len.__globals__",
        "lambda: 1",
        "(lambda: 1)()",
        "__import__('os')",
        "__builtins__",
        "open('/etc/passwd')",
        "eval('1')",
        "getattr(x, 'y')",
        "x.__dict__",
        "(y := 1)",
        "{**x}",
        "len(**x)",
        "[i for i.x in [1]]",
        "9 ** 9 ** 9",
        "1 << 10 ** 9",
        "'a' * 10 ** 9",
        "10 ** 9 * [1]",
        "'%999999999d' % 1",
        "'%*d' % (10 ** 9, 1)",
        "10 ** 20000 * 10 ** 20000",
    ],
)
def test_expressions_reach_nothing_but_their_symbols(expression):
    with pytest.raises((ExpressionError, NameError)):
        evaluate(expression, {"x": {"a": 1}, "len": len, "math": {"pi": math.pi}})


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("-(1 + 2 * 3) / 4 % 3", -(1 + 2 * 3) / 4 % 3),
        ("2 ** 10 // 3", 341),
        ("math.pi / 2", math.pi / 2),
        ("'left' if side > 0 and not flipped else 'right'", "left"),
        ("1 < side <= 3 or flipped", True),
        ("[k * v for k, v in [(1, 2), (3, 4)] if v > 2]", [12]),
        ("sum(i for i in [1, 2, 3])", 6),
        ("max(*[1, 2])", 2),
        ("names.get('b', 'none').upper()", "NONE"),
        ("names.a[1:]", "bc"),
        ("'%.3f' % 1.5", "1.500"),
        ("'a' in names", True),
    ],
)
def test_expressions_compute(expression, value):
    symbols = {"side": 2, "flipped": False, "math": {"pi": math.pi}, "names": {"a": "abc"}}
    assert evaluate(expression, symbols | {"sum": sum, "max": max}) == value


@pytest.mark.parametrize("name", ["arm.urdf", "arm.xml"])
def test_no_other_file_is_expanded(name, xacro_file):
    with pytest.raises(DescriptionError, match=r"line 2: found <xacro:property>, allowed in files named \*"):
        read_description(xacro_file(name=name))


def test_without_the_package_the_message_says_how(xacro_file, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with pytest.raises(DescriptionError, match=r"belongs to xacro; `pip install 'spacerobot\[xacro\]'`"):
        read_description(xacro_file())


@pytest.fixture
def scenario(xacro_file, tmp_path):
    """A scenario with a robot written for xacro, of one joint that turns."""
    xacro_file()
    path = tmp_path / "own.yaml"
    path.write_text(
        "robots: {one: {urdf: arm.urdf.xacro, base: {joint: free_flyer}, joints: {j: {rate_deg: 5}}}}\n"
        "simulation: {duration: 0.1, step: 0.01, output_step: 0.05}\n"
    )
    return path


@needs_package
def test_results_hold_the_expanded_file_and_never_expand(scenario, tmp_path, monkeypatch, capsys, undrawn):
    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["spacerobot", *map(str, arguments)])
        with pytest.raises(SystemExit) as left:
            main()
        return left.value.code or 0, " ".join(capsys.readouterr().err.split())

    scene = sr.load_scene(scenario)
    text = scene.scenario.robots["one"].expanded_urdf
    assert '<mass value="3.0"/>' in text
    assert "expanded_urdf: |" in to_yaml(scene.scenario)
    sr.simulate(scene, backend="interpreted").save(tmp_path / "out")

    def expand(source):
        raise AssertionError(f"{source} is expanded")

    monkeypatch.setattr("spacerobot.scene.resolve.expand_xacro", expand)
    monkeypatch.setattr("spacerobot.description.read.expand_xacro", expand)
    again = Result.load(tmp_path / "out")
    assert again.scenario.robots["one"].expanded_urdf == text
    assert again.scene().bodies[0].description.sha256 == scene.bodies[0].description.sha256
    assert call("report", tmp_path / "out")[0] == 0
    # a folder that somebody changed, so that it would have to be expanded again
    file = tmp_path / "out" / "scenario.yaml"
    document = yaml.load(file.read_text(), Loader)
    del document["robots"]["one"]["expanded_urdf"]
    file.write_text(yaml.dump(document))
    for command in (
        ["report"],
        ["animate", "--html", tmp_path / "page.html"],
        ["figures", "--out", tmp_path / "figures"],
        ["passive-safety", "--until", "1"],
    ):
        code, error = call(command[0], tmp_path / "out", *command[1:])
        assert code == 2
        assert "a xacro program, which is expanded for a scenario of your own only" in error
    with pytest.raises(ScenarioError, match="xacro program"):
        sr.load_scene(scenario, expand_xacro=False)


@needs_package
def test_another_file_is_expanded_again(scenario, xacro_file, tmp_path):
    xacro_file(mass="5", name="heavy.xacro")
    scene = sr.load_scene(scenario, {"robots.one.urdf": "heavy.xacro"})
    assert scene.scenario.robots["one"].links["a"].mass == 10
    text = scene.bodies[0].description.to_pinocchio_xml("")
    (tmp_path / "plain.urdf").write_text(text)
    plain = sr.load_scene(scenario, {"robots.one.urdf": "plain.urdf"})
    assert plain.scenario.robots["one"].expanded_urdf is None
