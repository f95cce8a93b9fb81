"""Base class of all elements."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from spacerobot.common.registry import required
from spacerobot.common.section import Section


class Element(Section):
    """Part of a closed loop or of a plan: its section of the scenario, and the law that it contributes.

    A kind is a subclass: its fields are the section's keys with units and ranges, ``kind`` is its name in a
    scenario, and ``build`` returns its law as CasADi expressions. Schema, messages, tuning, gradients,
    results and documentation are derived from these.

    Attributes:
        family: Family of elements: ``reference``, ``grasp``, ``contact``, ``tip_controller``,
            ``robot_controller``, ``actuator``, ``sensor``, ``estimator``, ``environment``, ``flexible_link``
            or ``shape``; for plans, ``goal`` or ``plan_limit``.
        fills: Key of the section that the content of its ``file`` fills in, if it has one.
        told_by: Key that identifies the kind in a section without ``kind``, if the family uses one.
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
            ScenarioError: If the file has another format, or no values for that section.
        """
        raise NotImplementedError

    def assumptions(self) -> list[str]:
        """Assumptions of its law, one sentence each."""
        return []

    def warnings(self) -> list[str]:
        """Warnings before it acts, a sentence each."""
        return []

    def words(self) -> str:
        """Short description with the main numbers, for ``spacerobot check``."""
        return self.kind
