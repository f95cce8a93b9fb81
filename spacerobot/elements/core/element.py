"""Base class of all elements."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from spacerobot.registry import required
from spacerobot.section import Section


class Element(Section):
    """A part of a closed loop, or of a plan: its section of the scenario, and the law that it contributes.

    A kind is one subclass: its fields are the section's keys with units and ranges, ``kind`` is its name in
    a scenario, and ``build`` gives its law as CasADi expressions. Everything else (schema, messages, tuning,
    gradients, results, documentation) follows from that.

    Attributes:
        family: Which elements it stands beside: ``reference``, ``grasp``, ``contact``, ``tip_controller``,
            ``robot_controller``, ``actuator``, ``sensor``, ``estimator``, ``environment``, ``flexible_link``
            or ``shape``; of a plan, ``goal`` or ``plan_limit``.
        fills: Key of the section that what stands in its ``file`` fills in, if it has one.
        told_by: Key that tells the kind in a section that does not name it, if its family is told apart so.
    """

    family: ClassVar[str]
    fills: ClassVar[str | None] = None
    told_by: ClassVar[str | None] = None

    kind: str

    @classmethod
    @required("fills")
    def read(cls, file: Path, where: str, phase: str | None = None) -> Mapping[str, Any]:
        """Values of a section from a file, in the form that :attr:`fills` takes.

        Args:
            file: The file.
            where: Dotted path of the section.
            phase: Phase whose values are read, if any.

        Raises:
            ScenarioError: If it is not such a file, or has nothing for that section.
        """
        raise NotImplementedError

    def assumptions(self) -> list[str]:
        """Assumptions where it acts, a sentence each."""
        return []

    def warnings(self) -> list[str]:
        """Warnings before it acts, a sentence each."""
        return []

    def words(self) -> str:
        """Short description with the main numbers, for ``spacerobot check``."""
        return self.kind
