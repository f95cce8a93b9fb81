"""The table of kinds, on the command line and in the reference."""

from __future__ import annotations

import pytest

from spacerobot.elements import FAMILIES, kinds
from spacerobot.elements.core.kind_table import fields_of, markdown


def test_the_table_lists_every_kind():
    text = markdown()
    assert [name for family in FAMILIES for name in kinds(family) if f"| `{name}` |" not in text] == []


@pytest.mark.parametrize("family", FAMILIES)
def test_every_key_is_told_with_its_meaning(family):
    for kind in kinds(family).values():
        assert all(meaning for _, _, meaning in fields_of(kind)), kind
