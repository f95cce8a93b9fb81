"""Numbers that a mission's page states, for comparison with a fresh simulation."""

import re
from pathlib import Path

FOLDER = Path(__file__).parents[2] / "docs" / "validation"
NUMBER = re.compile(r"-?\d+(?:\.(\d+))?(?:e([+-]?\d+))?")


def stated(page):
    """Text of the column "here" by the first cell of its row, of all tables of a page that have one."""
    found, column = {}, None
    for line in (FOLDER / f"{page}.md").read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if not line.startswith("|"):
            column = None
        elif "here" in cells:
            column = cells.index("here")
        elif column is not None and not set(line) <= set("|-"):
            assert cells[0] not in found, f"{page}.md has two rows of that name: {cells[0]}"
            found[cells[0]] = cells[column]
    return found


def check(page, measured):
    """Compare measured numbers with those of a page, to half a unit of the last digit that it states.

    Args:
        page: Name of the mission.
        measured: Numbers by the first cell of their row, every row that has a number; a row that says "less
            than" states a bound.
    """
    rows = {name: text for name, text in stated(page).items() if NUMBER.search(text)}
    assert rows.keys() == measured.keys()
    for name, value in measured.items():
        number = NUMBER.search(rows[name])
        shown = float(number[0])
        half = 0.5 * 10.0 ** (int(number[2] or 0) - len(number[1] or ""))
        close = abs(value) < shown if "less than" in name else abs(value - shown) <= 1.001 * half
        assert close, f"{page}.md, {name}: stated {number[0]}, found {value:.6g}"
