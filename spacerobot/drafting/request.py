"""Request for a draft, and the checks of its files, without the packages that a draft needs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from spacerobot.common.errors import ScenarioError
from spacerobot.common.files import StrPath
from spacerobot.description.find import find_urdf


@dataclass(frozen=True)
class DraftRequest:
    """Request for a draft of a scenario.

    Attributes:
        robots, target: URDF files, or names of shipped ones.
        tips: Tip link of each robot, or one name for all; chosen automatically if empty.
        frames: Mating frame of the target for each robot; chosen automatically if empty.
        base: Joint of the bases; if None, ``planar`` if every robot is planar, else ``free_flyer``.
        bus, mounts: URDF of a spacecraft, in place of ``robots``, and its arms in the form of
            :func:`read_mounts`. The first arm holds the target; the joints of the others are locked.
        include: Equipment of the spacecraft for a capture: ``wheels``, ``thrusters``, ``filters``.
        point: For a capture, in place of ``frames``: point of the target's surface, in the frame of its root
            link (3,) [m].
    """

    robots: Sequence[str]
    target: str
    tips: Sequence[str] = ()
    frames: Sequence[str] = ()
    base: str | None = None
    bus: str | None = None
    mounts: Sequence[str] = ()
    include: Sequence[str] = ()
    point: Sequence[float] | None = None

    def check_files(self, file: StrPath | None) -> Path:
        """Check that the URDFs exist and the scenario's file does not.

        Args:
            file: File of the scenario; None for the default.

        Returns:
            Path: File of the scenario.

        Raises:
            ScenarioError: If neither robots nor a bus are named, or the file exists.
            DescriptionError: If a URDF is not found.
        """
        if not (self.robots or self.bus):
            raise ScenarioError("found none, allowed: --robot, or --bus with --mount", where="--robot")
        for urdf in (*self.robots, *filter(None, (self.bus, self.target))):
            find_urdf(urdf, Path.cwd())
        place = Path(f"{Path(self.bus or self.robots[0]).stem}.yaml" if file is None else file)
        check_absence(place)
        return place


def check_absence(file: Path) -> None:
    """Check that a file does not exist.

    Raises:
        ScenarioError: If it exists.
    """
    if file.exists():
        raise ScenarioError("exists already; name another file by --out", source=file)
