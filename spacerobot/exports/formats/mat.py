"""MAT-file of MATLAB."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from spacerobot.common.registry import registered
from spacerobot.exports.export_format import ExportFormat, NoOptions, Source
from spacerobot.exports.signals import time_variables

if TYPE_CHECKING:
    from spacerobot.api.results import PlanResult
    from spacerobot.result import Result


@registered
class Mat(ExportFormat):
    """Arrays of all variables."""

    name: ClassVar[str] = "mat"
    place: ClassVar[float] = 11
    summary: ClassVar[str] = "every variable as an array with units and labels, MAT-file version 5"
    suffixes: ClassVar[tuple[str, ...]] = (".mat",)
    takes: ClassVar[tuple[Source, ...]] = ("result", "plan")

    def write(self, source: Result | PlanResult, path: Path, options: NoOptions) -> None:
        """Write ``time`` (nt x 1), each variable (nt x ...), and structures with their attributes.

        The structures ``units``, ``descriptions`` and ``dimensions`` have a field for each variable,
        ``labels`` one for each dimension. ``events`` is a structure array with the fields ``time_s``,
        ``kind`` and ``who``.
        """
        from scipy.io import savemat

        from spacerobot.result import Result

        del options
        data, content = source.data, dict[str, Any]()
        attributes: dict[str, dict[str, Any]] = {"units": {}, "descriptions": {}, "dimensions": {}}
        labels: dict[str, Any] = {}
        for name, variable in time_variables(data):
            content[name] = variable.values
            attributes["units"][name] = str(variable.attrs.get("units", "1"))
            attributes["descriptions"][name] = str(variable.attrs.get("long_name", name))
            attributes["dimensions"][name] = _cells(variable.dims)
            labels |= {str(dim): _cells(data[dim].values) for dim in variable.dims[1:]}
        content |= attributes | {"time": data.time.values, "labels": labels}
        if isinstance(source, Result):
            events = source.summary.get("events", [])
            fields = [("time_s", object), ("kind", object), ("who", object)]
            rows = [(event["time_s"], event["kind"], event["who"]) for event in events]
            content["events"] = np.array(rows, dtype=fields)
        # without compression, whose bytes depend on zlib's version; long_field_names allows 63 characters
        savemat(path, content, appendmat=False, long_field_names=True, oned_as="column")


def _cells(texts: Any) -> Any:
    """Cell array of texts."""
    return np.array([str(text) for text in texts], dtype=object)
