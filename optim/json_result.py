"""Results that are one JSON file, alone or beside the scenario of a design."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, ClassVar, Self

from optim.json_values import write_json
from spacerobot.common.files import StrPath, readable, write_text
from spacerobot.common.tables import Tabular
from spacerobot.result import check_folder
from spacerobot.result.store import SCENARIO
from spacerobot.scenario.load import to_yaml
from spacerobot.scene import Scene


class JsonResult(Tabular):
    """Base class of dataclasses that are saved as JSON.

    Attributes:
        key: The file's one key.
    """

    key: ClassVar[str]

    def save(self, path: StrPath) -> None:
        """Write it to a JSON file.

        Raises:
            ResultError: If the file cannot be written.
        """
        write_json(path, {self.key: asdict(self)})  # type: ignore[call-overload]

    @classmethod
    def load(cls, path: StrPath) -> Self:
        """Read what :meth:`save` wrote.

        Raises:
            ResultError: If it cannot be read.
        """
        with readable(cls.key.replace("_", " "), Path(path)):
            return cls.of_fields(json.loads(Path(path).read_text(encoding="utf-8"))[cls.key])

    @classmethod
    def of_fields(cls, fields: dict[str, Any]) -> Self:
        """The result with the fields of a file."""
        return cls(**fields)


def write_design(folder: StrPath, file: str, data: dict[str, Any], scene: Scene) -> None:
    """Write a JSON file about a design, and ``scenario.yaml`` unless a result of the design is there.

    Args:
        folder: Folder of the design.
        file: Name of the file, by which the folder is known.
        data: Content of the file.
        scene: Scene of the design.

    Raises:
        ResultError: If the folder holds something else or cannot be written.
    """
    folder = Path(folder)
    check_folder(folder, file)
    if not (folder / SCENARIO).is_file():
        write_text(folder / SCENARIO, to_yaml(scene.scenario))
    write_json(folder / file, data)
