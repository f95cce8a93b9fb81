"""Base class of results that are no single simulation."""

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
    """Data of an animated page, and the results in it."""

    data: dict[str, Any]
    results: Sequence[Result]


class Study(Tabular):
    """Result that is no single simulation: a campaign, a comparison, a plan, a study of plans.

    A kind of study overrides the pictures that it has.

    Attributes:
        name: Name of the kind in messages.
        file: File by which the folder of such a study is known.
        folder: Folder that holds the study, if it is saved.
    """

    name: ClassVar[str]
    file: ClassVar[str]
    folder: Path | None

    @classmethod
    @abstractmethod
    def load(cls, path: StrPath) -> Self:
        """Read the folder of a study.

        Raises:
            ResultError: If it holds none.
        """

    def drawings(self, simulated: Sequence[Result]) -> dict[str, Drawing]:
        """Figures by name.

        Args:
            simulated: Results that are drawn with the study, such as the simulation that follows a plan.

        Raises:
            ResultError: If such a study has no figures of its own.
        """
        message = f"a {self.name} has no figures of its own; `spacerobot report` makes a page of it"
        raise ResultError(message, source=self.folder)

    @abstractmethod
    def playback(self, progress: Progress) -> Playback:
        """Data of the animated page.

        Args:
            progress: Called with a few words whenever a step that may take a while begins.

        Raises:
            ResultError: If nothing can be played.
        """

    @abstractmethod
    def page(self, progress: Progress) -> str:
        """Self-contained HTML page about the study.

        Args:
            progress: As of :meth:`playback`.

        Raises:
            ResultError: If such a study has no page.
        """

    def first_view(self) -> dict[str, Any] | None:
        """Data of a page that is served while :meth:`playback` is computed; None if that takes no time."""
        return None
