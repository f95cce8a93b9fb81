"""Result of a simulation: labelled data, summary and scenario."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import DivergedError
from spacerobot.common.files import StrPath
from spacerobot.common.tables import Table
from spacerobot.common.tabular import Tabular
from spacerobot.result.store import read_result, write_result
from spacerobot.result.summary_types import Summary
from spacerobot.result.table import Row, cause_words, headline, result_tables, status_text
from spacerobot.result.trust import fast_words
from spacerobot.scenario import Scenario
from spacerobot.scene import Scene, build_scene

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Result(Tabular):
    """Result of one simulation.

    Attributes:
        scenario: Resolved scenario; a second simulation of it has the same result.
        data: Signals over time with labels and units; see :mod:`spacerobot.result.dataset`.
        summary: Status and headline numbers, as in ``summary.json``; see
            :class:`spacerobot.result.summary_types.Summary`.
        folder: Folder that the result was read from or written to, or None.
    """

    scenario: Scenario
    data: xr.Dataset
    summary: Summary
    folder: Path | None = None

    def save(self, folder: StrPath) -> Result:
        """Write the result to a folder.

        An earlier result in the folder, and the pages and figures made from it, are replaced.

        Returns:
            Result: The result with its folder.

        Raises:
            ResultError: If the folder cannot be written; its earlier content is then unchanged.
            KeyboardInterrupt: After Ctrl-C during the write; the result is written nevertheless.
        """
        write_result(Path(folder), self.scenario, self.data, self.summary)
        return dataclasses.replace(self, folder=Path(folder))

    @classmethod
    def load(cls, folder: StrPath) -> Result:
        """Read the folder of a result.

        Raises:
            ResultError: If the folder has no complete result, or one with another version's layout.
        """
        return cls(*read_result(Path(folder)), Path(folder))

    @property
    def completed(self) -> bool:
        """Whether the rollout reached its end."""
        return bool(self.summary["status"]["state"] == "completed")

    def require_completed(self) -> None:
        """Check that the rollout reached its end.

        Raises:
            DivergedError: If it diverged or chattered; with the time, and what may help.
        """
        if self.completed:
            return
        status, step = self.summary["status"], self.summary["engine"]["step_s"]
        folder_note = f"; kept up to there in {self.folder}" if self.folder is not None else ""
        when = f"after {status['diverged_at_s']:.6g} s{cause_words(status)}"
        if status["state"] == "chattering":
            raise DivergedError(
                f"the rollout chattered {when}: too many events in too short a time{folder_note}"
            )
        hint = f"the step of {step:g} s may be too large (leave it out to have one chosen)" if step else ""
        hints = "".join(f"; {words}" for words in (hint, fast_words(self.summary["fastest_joint"])) if words)
        raise DivergedError(f"the rollout diverged {when}{hints}{folder_note}")

    def array(self, name: str) -> Array:
        """Values of a variable, or labels of a dimension, ten times faster than ``data[name].values``."""
        return np.asarray(self.data.variables[name].values)

    @property
    def led_tips(self) -> list[str]:
        """Labels of the tips that have a reference or controller of their own."""
        unled = self.summary.get("unled_tips", ())
        return [str(tip) for tip in self.array("tip") if tip not in unled]

    def scene(self) -> Scene:
        """Scene of the simulation, built from its scenario."""
        return build_scene(self.scenario, source=self.folder / "scenario.yaml" if self.folder else None)

    def headline(self) -> list[Row]:
        """Headline numbers of the result: names and values as texts."""
        return headline(self.summary, self.data, self.scenario.body_label("target"))

    def __repr__(self) -> str:
        """Name and status, in one line."""
        return f"<Result {self.scenario.name}: {status_text(self.summary['status'])}>"

    def content(self) -> list[Table]:
        """Tables of headline numbers, events, and plans of model predictive control."""
        return result_tables(self.scenario, self.summary, self.data)
