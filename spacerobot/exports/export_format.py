"""Base class of export formats."""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar, Literal

from spacerobot.common.registry import EXPORT_FORMATS, Registry, required
from spacerobot.common.section import Section

Source = Literal["result", "plan", "scene"]
"""Kind of what is exported: ``Result``, ``PlanResult`` or ``Scene`` of the namespace."""


class NoOptions(Section):
    """Options of a format that has none."""


class ExportFormat:
    """A format of other tools.

    A format derives from this class, states its name, and is decorated with
    :func:`spacerobot.common.registry.registered`. Packages that it needs are imported by
    :func:`spacerobot.common.optional.optional_module` in :meth:`write`.

    Attributes:
        name, place: On the command line, and its place in lists.
        summary: A few words for lists and the documentation.
        suffixes: Suffixes of files that are written in this format if none is named, ``.csv``; none where a
            path does not tell the format.
        takes: What it exports, the preferred one first. A result or a plan is exported as its scene if only
            ``scene`` is in the list.
        options: Its options, keyword arguments of :func:`spacerobot.export` and ``--options`` of the command
            line.
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
            source: A result, a plan or a scene, as :attr:`takes` allows.
            path: Path of the file or folder, which does not exist yet: a temporary one, of the final name,
                that is moved into place when this method returns.
            options: Instance of :attr:`options`.

        Raises:
            SpaceRobotError: If the source has no counterpart in the format, or a package is missing.
        """
        raise NotImplementedError
