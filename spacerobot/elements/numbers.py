"""Time and the numbers of a section, as a law sees them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import casadi as ca

from spacerobot.symbolic import Constants, Parameters


@dataclass(frozen=True)
class Context:
    """Time and the numbers of one section.

    Attributes
    ----------
    path
        Dotted path of the section.
    time
        Symbol of time (1x1) [s].
    parameters, constants
        The scenario's numbers, and what is computed of them once for each rollout.
    """

    path: str
    time: ca.SX
    parameters: Parameters
    constants: Constants

    def at(self, path: str) -> Context:
        """The same for another section."""
        return dataclasses.replace(self, path=path)

    def number(self, key: str) -> ca.SX:
        """A number of the section (1x1), in the section's unit."""
        return self.once(key, self.parameters(f"{self.path}.{key}"))

    def vector(self, key: str, factor: float = 1.0) -> ca.SX:
        """Three numbers of the section times a factor (3x1); exact zeros are structural."""
        found = self.parameters.sparse_vector(f"{self.path}.{key}")
        return self.once(key, found * factor if factor != 1.0 else found)

    def once(self, name: str, expression: ca.SX) -> ca.SX:
        """Expression of the parameters alone, computed once for each rollout; any shape."""
        return self.constants.hoist(f"{self.path}.{name}", expression)

    def jump(self, key: str, time: float | None = None) -> ca.SX:
        """Time (1x1) [s] at which the law jumps, to be compared with time and used for nothing else.

        Steps end there. It is the number that stands at ``key``, or ``time`` where it is no number.
        """
        at = self.parameters(f"{self.path}.{key}") if time is None else ca.SX(time)
        return self.constants.jump(f"{self.path}.{key}", at)

    def switch(self, name: str, initial: bool = False) -> ca.SX:
        """Switch of the section (1x1): 1 or 0, turned by events alone; its symbol is named ``path.name``."""
        return self.constants.switch(f"{self.path}.{name}", initial)
