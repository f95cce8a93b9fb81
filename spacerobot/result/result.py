"""The result of a simulation: labelled data, a summary, and the scenario that made it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from spacerobot.common.arrays import Array
from spacerobot.common.files import StrPath
from spacerobot.common.tables import Table, Tabular
from spacerobot.result.store import read_result, write_result
from spacerobot.result.summary_types import Summary
from spacerobot.result.table import Row, headline, result_tables, status_text
from spacerobot.scenario import Scenario
from spacerobot.scene import Scene, build_scene


@dataclass(frozen=True)
class Result(Tabular):
    """Result of one simulation.

    Attributes:
        scenario: The resolved scenario; running it again gives the same result.
        data: Everything over time, labelled and with units; see :mod:`spacerobot.result.dataset`.
        summary: Numbers and status, as in ``summary.json``; see
            :class:`spacerobot.result.summary_types.Summary`.
        folder: Where it was read from or written to, if it was.
    """

    scenario: Scenario
    data: xr.Dataset
    summary: Summary
    folder: Path | None = None

    def save(self, folder: StrPath) -> Result:
        """Write it; a result that is there already is replaced, with the pages and figures made from it.

        Returns:
            Result: The same, knowing its folder.

        Raises:
            ResultError: If the folder cannot be written; what was there before is then still there.
            KeyboardInterrupt: If Ctrl-C came meanwhile; the result is then written all the same.
        """
        write_result(Path(folder), self.scenario, self.data, self.summary)
        return dataclasses.replace(self, folder=Path(folder))

    @classmethod
    def load(cls, folder: StrPath) -> Result:
        """Read the folder of a result.

        Raises:
            ResultError: If it is not a complete result, or one of another version's layout.
        """
        return cls(*read_result(Path(folder)), Path(folder))

    @property
    def completed(self) -> bool:
        """Whether the rollout reached its end."""
        return bool(self.summary["status"]["state"] == "completed")

    def array(self, name: str) -> Array:
        """Values of a variable, or labels of a dimension: ``data[name].values`` in a tenth of the time."""
        return np.asarray(self.data.variables[name].values)

    @property
    def led_tips(self) -> list[str]:
        """Labels of the tips that a reference or a controller of their own leads."""
        unled = self.summary.get("unled_tips", ())
        return [str(tip) for tip in self.array("tip") if tip not in unled]

    def scene(self) -> Scene:
        """The scene it was simulated in, built anew from its scenario."""
        return build_scene(self.scenario, source=self.folder / "scenario.yaml" if self.folder else None)

    def headline(self) -> list[Row]:
        """Main figures of the result, as rows of two texts."""
        return headline(self.summary, self.data, self.scenario.body_label("target"))

    def __repr__(self) -> str:
        """Name and status, in one line."""
        return f"<Result {self.scenario.name}: {status_text(self.summary['status'])}>"

    def content(self) -> list[Table]:
        """Main figures, events, and the plans of model predictive control."""
        return result_tables(self.scenario, self.summary, self.data)
