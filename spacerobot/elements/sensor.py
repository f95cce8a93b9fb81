"""Sensors: what a controller reads of a signal (section 1.6 of the paper)."""

from __future__ import annotations

from typing import ClassVar

import casadi as ca

from spacerobot.elements.context import Affine
from spacerobot.elements.element import Element
from spacerobot.elements.section_context import SectionContext


class Sensor(Element):
    """A sensor of one signal, the same for every component; its reading is linear in the signal.

    Attributes
    ----------
    holds
        Whether it measures only now and then, by its number ``period`` [s], and holds what it measured.
    """

    family: ClassVar[str] = "sensor"
    holds: ClassVar[bool] = False

    def affine(self, context: SectionContext) -> Affine:
        """Offset a and scale b of the reading a + b s."""
        raise NotImplementedError

    @property
    def is_ideal(self) -> bool:
        """Whether it reads the signal as it is."""
        raise NotImplementedError


def ideal(signal: str) -> Affine:
    """Sensor without error, which costs nothing."""
    del signal
    return None, ca.SX(1)


def measured(sensor: Affine, signal: ca.SX) -> ca.SX:
    """Signal as its sensor gives it: a + b s."""
    offset, scale = sensor
    return scale * signal if offset is None else offset + scale * signal
