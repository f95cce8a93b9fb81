"""Conclusions and tables of docs/validation follow from the data of the comparison."""

from __future__ import annotations

import pytest

from benchmarks.tuning_docs import BLOCK, PAGES, filled


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_conclusions_and_tables_are_computed_from_the_data(page):
    text = page.read_text(encoding="utf-8")
    assert any(block == "conclusion" for _, block in BLOCK.findall(text))
    assert filled(text) == text
