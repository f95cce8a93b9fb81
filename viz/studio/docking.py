"""Docking of uploaded robots: URDFs to choose from, the drafted scenario, and its plan."""

from __future__ import annotations

import itertools
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from optim.planning.output.plan_folder import FOLLOWED, SUMMARY, write
from optim.planning.search.make_plan import make_plan
from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.common.files import write_text
from spacerobot.description.find import shipped_names, shipped_urdf_folder
from spacerobot.description.read import read_description
from spacerobot.drafting import DraftRequest, draft_capture, surface_point
from spacerobot.drafting.arms import ends
from spacerobot.result.store import check_folder
from spacerobot.scenario.document import parse_yaml
from spacerobot.scenario.load import validate
from spacerobot.scene import Scene, build_scene
from viz.page.animation import still
from viz.studio.bookmarks import place
from viz.studio.edited_text import edited
from viz.studio.job import Job
from viz.studio.messages import Request

DEPTHS = ("*.urdf", "*/*.urdf", "*/*/*.urdf")
"""Patterns of the URDFs that are searched for below the working folder."""

MOST_URDFS = 300
"""Maximum number of URDFs found in a folder."""

PLACED = {
    "position": "target.base.position",
    "velocity": "target.base.velocity",
    "spin_deg": "target.base.spin_deg",
}
"""Settings of the object's motion that may replace drafted ones."""

LEADS_ELSEWHERE = re.compile(r"""xacro|<!\w|filename\s*=\s*["'](?:[/\\]|[^"']*(?::|\.\.))""")
"""Patterns of an uploaded URDF that could refer to other files."""


@dataclass(frozen=True)
class UrdfChoice:
    """URDFs that a page may use: shipped ones, those in the working folder, and uploaded ones.

    Attributes:
        working: Folder in which the studio was started.
        folder: Only folder in which files are written.
    """

    working: Path
    folder: Path

    def files(self) -> dict[str, Path]:
        """Files by the names used in the page; links that lead out of the two folders are left out."""
        files = {name: shipped_urdf_folder() / name for name in shipped_names()}
        for top in (self.working.resolve(), self.folder.resolve()):
            paths = itertools.islice((path for pattern in DEPTHS for path in top.glob(pattern)), MOST_URDFS)
            inside = (path for path in sorted(paths) if path.resolve().is_relative_to(top))
            files |= {path.relative_to(top).as_posix(): path for path in inside}
        return files

    def find(self, name: str) -> Path:
        """File of a name.

        Raises:
            ScenarioError: If a page may not name it.
        """
        files = self.files()
        if name not in files:
            raise ScenarioError(
                f"found {name!r}, which was not offered; {near_names(name, files)}", where="urdf"
            )
        return files[name]

    def upload(self, name: str, text: str) -> str:
        """Write an uploaded URDF and return its name.

        Raises:
            ScenarioError, ResultError: If it refers to missing files, or to files outside the folder.
        """
        led = LEADS_ELSEWHERE.search(text)
        if led is not None:
            raise ScenarioError(
                f"found {led[0]!r}, allowed in an uploaded URDF: no xacro, and meshes in its folder alone; "
                "start the studio in the URDF's folder instead",
                where=name,
            )
        path = place(self.folder, Path(name).name, "urdf")
        self.folder.mkdir(parents=True, exist_ok=True)
        write_text(path, text)
        return path.name


@dataclass(frozen=True)
class Docking:
    """Draft of a docking: the scenario's text and scene, and the file that it is for."""

    file: Path
    text: str
    scene: Scene

    @classmethod
    def of(cls, request: Request, choice: UrdfChoice) -> Docking:
        """Draft of a docking from the page's choices.

        For a point on the surface, a URDF of the object with a mating frame there is written.

        Raises:
            ScenarioError, DescriptionError, ResultError: If no draft is possible.
        """
        more = request.more
        file = place(choice.folder, request.text("name"), "yaml")
        robot, target = (str(choice.find(request.text(name))) for name in ("robot", "target"))
        tips, frames = ([more[name]] if more.get(name) else [] for name in ("tip", "frame"))
        point = _numbers(more.get("point"), "point")
        order = DraftRequest([robot], target, tips, frames, more.get("base") or None)
        if point:
            order, urdf, text = surface_point(replace(order, frames=(), point=point), file)
            choice.folder.mkdir(parents=True, exist_ok=True)
            write_text(urdf, text)
        text, scene = draft_capture(order, file)
        values_by_path = {path: _numbers(more.get(key), key) for key, path in PLACED.items()}
        changes = {path: values for path, values in values_by_path.items() if values}
        if changes:
            changed = edited(text, changes)
            assert changed is not None, "the draft has no such section"
            text, source = changed, file.absolute()
            scene = build_scene(
                validate(parse_yaml(text, source=source), source=source), source=source, expand_xacro=True
            )
        return cls(file, text, scene)

    def plain(self, request: Request, choice: UrdfChoice) -> dict[str, Any]:
        """Message about it: text, first picture, links to choose from, and the proposed numbers."""
        robot, target = (read_description(choice.find(request.text(name))) for name in ("robot", "target"))
        grasp, base = (
            self.scene.grasps[0],
            self.scene.scenario.target.base if self.scene.scenario.target else None,
        )
        return {
            "type": "draft",
            "text": self.text,
            "file": str(self.file),
            "tips": ends(robot),
            "frames": [link.name for link in target.links],
            "chosen": {"tip": grasp.tip.label, "frame": grasp.config.frame},
            "place": {key: list(getattr(base, key)) for key in PLACED},
            "warnings": list(self.scene.warnings),
            "show": still(self.scene),
        }

    def write(self) -> Path:
        """Write the scenario, and return its file."""
        self.file.parent.mkdir(parents=True, exist_ok=True)
        write_text(self.file, self.text)
        return self.file


def _numbers(text: Any, where: str) -> list[float]:
    """Three numbers from a text ``x, y, z``; empty for an empty text.

    Raises:
        ScenarioError: If the text has another form.
    """
    if text in (None, ""):
        return []
    try:
        numbers = [float(part) for part in str(text).split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3:
        raise ScenarioError(f"found {text!r}, allowed: three numbers, as 0.1, 0, -0.2", where=where)
    return numbers


def plan(scene: Scene, folder: Path, job: Job) -> Path | None:
    """Plan the approach of a scene, and return the scenario that tracks the plan; None if cancelled.

    Args:
        scene: The scene, with a ``plan`` section.
        folder: Folder of the plan.
        job: Job that receives the progress.

    Raises:
        SpaceRobotError: If there is no plan section, or no plan passes the verification.
    """

    def tell(words: str) -> None:
        """Report progress."""
        if job.stop.is_set():
            raise KeyboardInterrupt  # as Ctrl-C does
        job.tell(always=True, progress=0.5, message=words)

    check_folder(folder, SUMMARY)
    try:
        planned = make_plan(scene, progress=tell)
    except KeyboardInterrupt:
        job.tell("stopped", progress=1.0, message="")
        return None
    write(planned, folder)
    followed = folder / FOLLOWED
    # the reopened page restores its state from this
    text = followed.read_text(encoding="utf-8")
    write_text(followed, re.sub(r"(?m)^name: .*$", f"name: {folder.name}", text, count=1))
    job.tell(
        "done",
        progress=1.0,
        message=f"cost {planned.cost:.4g}; opening the scenario that follows it",
    )
    return followed
