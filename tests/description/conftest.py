"""Small URDFs for tests, built from text."""

from __future__ import annotations

from pathlib import Path

import pytest


class UrdfText:
    """Writes small robots; every part can be replaced by a text of the test's own."""

    INERTIA = '<inertia ixx="0.1" iyy="0.2" izz="0.25" ixy="0.01" ixz="0" iyz="0"/>'
    INERTIAL = f'<inertial><mass value="2"/>{INERTIA}</inertial>'
    LIMIT = '<limit lower="-1" upper="1" effort="5" velocity="2"/>'
    DYNAMICS = '<dynamics damping="0.1"/>'

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def link(self, name: str, inside: str = INERTIAL) -> str:
        return f'<link name="{name}">{inside}</link>'

    def joint(
        self, name: str, parent: str, child: str, kind: str = "revolute", inside: str = LIMIT + DYNAMICS
    ) -> str:
        ends = f'<parent link="{parent}"/><child link="{child}"/>'
        return f'<joint name="{name}" type="{kind}">{ends}{inside}</joint>'

    def two_links(self, joint: str = LIMIT + DYNAMICS, *, kind: str = "revolute", b: str = INERTIAL) -> Path:
        return self.write(self.link("a"), self.link("b", b), self.joint("j", "a", "b", kind, joint))

    def write(self, *parts: str) -> Path:
        return self.write_text("\n".join(['<robot name="r">', *parts, "</robot>"]))

    def write_text(self, text: str | bytes, name: str = "own.urdf") -> Path:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return path


@pytest.fixture
def urdf(tmp_path: Path) -> UrdfText:
    return UrdfText(tmp_path)
