"""The table of kinds, in the documentation and on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest

from spacerobot.elements import FAMILIES, kinds
from spacerobot.elements.table import fields_of, markdown

ROOT = Path(__file__).parents[2]


def test_the_documentation_lists_every_kind():
    text = (ROOT / "docs" / "elements.md").read_text(encoding="utf-8")
    assert markdown().strip() in text, "docs/elements.md: take the table of `spacerobot kinds --markdown`"


@pytest.mark.parametrize("family", FAMILIES)
def test_every_key_is_told_with_its_meaning(family):
    for kind in kinds(family).values():
        assert all(meaning for _, _, meaning in fields_of(kind)), kind
