"""xacro files: expanded where the package is installed, refused in one line where it is not."""

from __future__ import annotations

import hashlib
import sys

import pytest

from spacerobot.description import read_description
from spacerobot.errors import DescriptionError

MACRO = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="m" value="{mass}"/>
<xacro:include filename="{included}"/>
<xacro:body name="a"/><xacro:body name="b"/>
<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>
</robot>"""
BODY = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="body" params="name">
<link name="${name}"><inertial><mass value="${2 * m}"/><inertia ixx="1" iyy="1" izz="1"/></inertial></link>
</xacro:macro></robot>"""


@pytest.fixture
def xacro_file(urdf):
    urdf.write_text(BODY, "body.xacro")
    return lambda mass="1.5", included="body.xacro", name="arm.urdf.xacro": urdf.write_text(
        MACRO.format(mass=mass, included=included), name
    )


def test_a_xacro_file_is_expanded_whatever_its_name(xacro_file, capfd):
    pytest.importorskip("xacro")
    for name in ("arm.urdf.xacro", "arm.urdf"):
        path = xacro_file(name=name)
        description = read_description(path)
        assert [link.mass for link in description.links] == [3, 3]
        assert description.path == path
        assert description.sha256 != hashlib.sha256(path.read_bytes()).hexdigest()
    # the hash is of all that the file includes
    assert description.sha256 != read_description(xacro_file(mass="2")).sha256
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("options", [{"included": "none.xacro"}, {"mass": "${1 / 0}"}, {"mass": "$(find x)"}])
def test_what_xacro_cannot_expand_is_one_line(xacro_file, options):
    pytest.importorskip("xacro")
    path = xacro_file(**options)
    with pytest.raises(DescriptionError, match="xacro cannot expand it") as caught:
        read_description(path)
    assert "\n" not in str(caught.value)


def test_without_the_package_the_message_says_how(xacro_file, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacro", None)
    with pytest.raises(DescriptionError, match=r"belongs to xacro; `pip install 'spacerobot\[xacro\]'`"):
        read_description(xacro_file())
