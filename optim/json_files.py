"""JSON files: conversion of values, results kept as one file, and designs next to their scenario."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np

from spacerobot.common.files import StrPath, readable, write_text
from spacerobot.common.tabular import Tabular
from spacerobot.result import check_folder
from spacerobot.result.store import SCENARIO
from spacerobot.scenario.load import to_yaml
from spacerobot.scene import Scene


def plain(value: Any) -> Any:
    """Value of JSON: arrays and sequences as lists, NaN and infinity as None."""
    if isinstance(value, dict) or hasattr(value, "items"):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return [plain(item) for item in value.tolist()]
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def write_json(path: StrPath, value: Any) -> None:
    """Write a value as :func:`plain` makes it to a JSON file.

    Raises:
        ResultError: If it cannot be written.
    """
    write_text(path, json.dumps(plain(value), indent=1, allow_nan=False) + "\n")


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
    """Write a JSON file about a design, and ``scenario.yaml`` unless the folder has a result of the design.

    Args:
        folder: Folder of the design.
        file: Name of the file, which identifies folders of this kind.
        data: Content of the file.
        scene: Scene of the design.

    Raises:
        ResultError: If the folder has other content or cannot be written.
    """
    folder = Path(folder)
    check_folder(folder, file)
    if not (folder / SCENARIO).is_file():
        write_text(folder / SCENARIO, to_yaml(scene.scenario))
    write_json(folder / file, data)
