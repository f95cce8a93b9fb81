"""What every element has in common."""

from __future__ import annotations

from typing import ClassVar

from spacerobot.section import Section


class Element(Section):
    """A part of the closed loop: its section of the scenario, and the law that it contributes.

    A kind is one subclass: its fields are the section's keys with units and ranges, ``kind`` is its name in
    a scenario, and ``build`` gives its law as CasADi expressions. Everything else (schema, messages, tuning,
    gradients, results, documentation) follows from that.

    Attributes
    ----------
    family
        Which elements it stands beside: ``reference``, ``grasp``, ``contact``, ``tip_controller``,
        ``robot_controller``, ``actuator`` or ``sensor``.
    """

    family: ClassVar[str]

    kind: str

    def assumptions(self) -> list[str]:
        """What is assumed where it acts, a sentence each."""
        return []

    def warnings(self) -> list[str]:
        """What a user should look at before it acts, a sentence each."""
        return []

    def words(self) -> str:
        """What it is, in a few words with its main numbers, for ``spacerobot check``."""
        return self.kind
