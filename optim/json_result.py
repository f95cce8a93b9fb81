"""Results that are one JSON file: the fields of a dataclass under a key that names what it is."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any, ClassVar, Self

from optim.json_values import plain
from spacerobot.common.errors import ResultError
from spacerobot.common.files import StrPath, write_text
from spacerobot.common.tables import Tabular


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
        data = {self.key: plain(asdict(self))}  # type: ignore[call-overload]
        write_text(Path(path), json.dumps(data, indent=2, allow_nan=False) + "\n")

    @classmethod
    def load(cls, path: StrPath) -> Self:
        """Read what :meth:`save` wrote.

        Raises:
            ResultError: If it cannot be read.
        """
        try:
            return cls.of_fields(json.loads(Path(path).read_text(encoding="utf-8"))[cls.key])
        except (OSError, ValueError, KeyError, TypeError) as fault:
            what = cls.key.replace("_", " ")
            raise ResultError(f"holds no {what} that can be read: {fault}", source=Path(path)) from None

    @classmethod
    def of_fields(cls, fields: dict[str, Any]) -> Self:
        """The result with the fields of a file."""
        return cls(**fields)
