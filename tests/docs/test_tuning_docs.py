"""What README and docs/tuning.md say of the comparison is what its data says."""

from __future__ import annotations

import pytest

from benchmarks.tuning_docs import BLOCK, PAGES, filled


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_verdicts_and_tables_are_computed_from_the_data(page):
    text = page.read_text(encoding="utf-8")
    assert any(what == "verdict" for _, what in BLOCK.findall(text))
    assert filled(text) == text
