"""Base class of export formats."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar, Literal

from spacerobot.common.registry import EXPORT_FORMATS, Registry, required
from spacerobot.common.section import Section

Source = Literal["result", "plan", "scene"]
"""Kind of source: a ``Result``, a ``PlanResult`` or a ``Scene``."""


class NoOptions(Section):
    """Options of a format without options."""


class ExportFormat:
    """Base class of export formats.

    A format derives from this class, states its name, and is decorated with
    :func:`spacerobot.common.registry.registered`. Packages that it needs are imported by
    :func:`spacerobot.common.optional.optional_module` in :meth:`write`.

    Attributes:
        name, place: Name of the format, and position in lists.
        summary: Short description for lists and the documentation.
        suffixes: File suffixes that select the format, such as ``.csv``; empty if it is selected by name
            only.
        takes: Supported sources, the preferred one first. Results and plans are exported as their scenes if
            only ``scene`` is supported.
        options: Options of the format: keyword arguments of :func:`spacerobot.export`, and command-line
            options.
    """

    registry: ClassVar[Registry] = EXPORT_FORMATS
    name: ClassVar[str]
    place: ClassVar[float] = 100.0
    summary: ClassVar[str] = ""
    suffixes: ClassVar[tuple[str, ...]] = ()
    takes: ClassVar[tuple[Source, ...]] = ("result",)
    options: ClassVar[type[Section]] = NoOptions

    @required()
    def write(self, source: Any, path: Path, options: Any) -> None:
        """Write a file or a folder.

        Args:
            source: A result, a plan or a scene, as listed in :attr:`takes`.
            path: File or folder, which does not exist yet: it is in a temporary folder, has the final name,
                and is moved when this method returns.
            options: Instance of :attr:`options`.

        Raises:
            SpaceRobotError: If the source has no counterpart in the format, or an optional package is
                missing.
        """
        raise NotImplementedError
