"""Base class of campaigns, comparisons, plans and studies of plans."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from spacerobot.common.errors import ResultError
from spacerobot.common.files import StrPath
from spacerobot.common.tables import Tabular
from spacerobot.result import Result
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
        folder: Folder of the study; None if it is not saved.
    """

    name: ClassVar[str]
    file: ClassVar[str]
    folder: Path | None

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
