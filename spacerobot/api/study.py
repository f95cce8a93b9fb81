"""Base class of campaigns, comparisons, plans and studies of plans."""

from __future__ import annotations

import shutil
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from spacerobot.common.errors import ResultError
from spacerobot.common.files import StrPath
from spacerobot.common.tabular import Tabular
from spacerobot.result import Result, check_folder
from spacerobot.simulation import Progress

if TYPE_CHECKING:
    from viz.figures import Drawing


@dataclass(frozen=True)
class Playback:
    """Data of an animated page, and the results in it.

    Attributes:
        data: JSON data of the page.
        results: Results that the page shows.
    """

    data: dict[str, Any]
    results: Sequence[Result]


class Study(Tabular):
    """Result of several simulations or of an optimisation: campaign, comparison, plan or study of plans.

    Attributes:
        name: Name of the kind of study in messages.
        file: File that identifies the folder of such a study.
        job: File by which the output folder is checked before a computation begins, a key of
            :data:`spacerobot.result.store.JOBS`.
        folder: Folder of the study; None if it is not saved.
        solution: Solved problems, of which :meth:`write` writes the files; None if the study was read.
    """

    name: ClassVar[str]
    file: ClassVar[str]
    job: ClassVar[str]
    folder: Path | None
    solution: Any = None

    def save(self, path: StrPath) -> Self:
        """Write the files of the study, or copy the folder that it was read from.

        Args:
            path: Folder; files of an earlier study of this kind are replaced.

        Returns:
            Study: The study with this folder.

        Raises:
            ResultError: If the folder has other content, cannot be written, or a copy would replace it.
        """
        target = Path(path)
        if self.solution is None:
            assert self.folder is not None  # a study without a solution was read from files
            return replace(self, folder=copied(self.folder, target))  # type: ignore[type-var]
        check_folder(target, self.job)
        return self.write(target)

    def write(self, folder: Path) -> Self:
        """Write the files of the solution, and return the study with this folder.

        Raises:
            ResultError: If the folder cannot be written.
        """
        raise NotImplementedError

    @classmethod
    @abstractmethod
    def load(cls, path: StrPath) -> Self:
        """Read the folder of a study.

        Raises:
            ResultError: If the folder has no such study.
        """

    def drawings(self, simulated: Sequence[Result]) -> dict[str, Drawing]:
        """Figures of the study by name.

        Args:
            simulated: Results that are drawn with the study, such as the simulation that follows a plan.

        Raises:
            ResultError: If this kind of study has no figures.
        """
        message = f"a {self.name} has no figures of its own; `spacerobot report` makes a page of it"
        raise ResultError(message, source=self.folder)

    @abstractmethod
    def playback(self, progress: Progress) -> Playback:
        """Data of the animated page.

        Args:
            progress: Callback with a short text, called when a step that may take long begins.

        Raises:
            ResultError: If this kind of study has no animation.
        """

    @abstractmethod
    def page(self, progress: Progress) -> str:
        """Self-contained HTML page about the study.

        Args:
            progress: As for :meth:`playback`.

        Raises:
            ResultError: If this kind of study has no page.
        """

    def first_view(self) -> dict[str, Any] | None:
        """Data of a page shown while :meth:`playback` is computed; None if that takes little time."""
        return None


def copied(folder: Path, path: StrPath) -> Path:
    """Copy a folder, unless ``path`` is that folder, and return the copy.

    Raises:
        ResultError: If the folder cannot be copied, or ``path`` exists.
    """
    target = Path(path)
    if target.resolve() == folder.resolve():
        return folder
    try:
        shutil.copytree(folder, target)
    except OSError as fault:
        raise ResultError(f"cannot be written: {fault}", source=target) from None
    return target
