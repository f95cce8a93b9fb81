"""Units as products of powers of SI base units."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
"""Base units of FMI."""

DERIVED: Mapping[str, Mapping[str, int]] = {
    "N": {"kg": 1, "m": 1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "Hz": {"s": -1},
    "1": {},
    "deg": {"rad": 1},
}
FACTORS = {"deg": math.pi / 180}
FACTOR = re.compile(r"([A-Za-z]+|1)(?:\^(\d+))?")


@dataclass(frozen=True)
class UnitDefinition:
    """A unit: ``factor`` times the product of powers of base units."""

    name: str
    exponents: Mapping[str, int]
    factor: float = 1.0


def unit_definition(name: str) -> UnitDefinition | None:
    """Definition of a unit such as ``N m s/rad`` or ``deg/s``; None if it is not a product of powers.

    Args:
        name: Factors separated by blanks; factors after a slash divide.
    """
    exponents, factor = dict.fromkeys(BASE, 0), 1.0
    for k, part in enumerate(name.split("/")):
        sign = -1 if k else 1
        for word in part.split():
            match = FACTOR.fullmatch(word)
            if match is None or match[1] not in (*BASE, *DERIVED):
                return None
            power = sign * int(match[2] or 1)
            factor *= FACTORS.get(match[1], 1.0) ** power
            for base, exponent in DERIVED.get(match[1], {match[1]: 1}).items():
                exponents[base] += power * exponent
    return UnitDefinition(name, {base: power for base, power in exponents.items() if power}, factor)
