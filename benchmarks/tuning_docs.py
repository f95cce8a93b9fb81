"""Tables of a comparison in docs/validation: ``python -m benchmarks.tuning_docs OUT [OUT ...]``.

Each folder was written by ``spacerobot compare``. Its data, without single runs, is stored in ``docs/data``;
the texts between the marks are made from it, and a test compares them.
"""

from __future__ import annotations

import dataclasses
import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from optim.comparison import tables
from optim.comparison.conclusion import conclusion
from spacerobot.common.tables import Table

ROOT = Path(__file__).parents[1]
DATA = ROOT / "docs" / "data"
PAGES = tuple(ROOT / "docs" / "validation" / name for name in ("tuning_results.md", "tuning_suite.md"))
BLOCK = re.compile(r"<!-- (\w+): (conclusion|table) -->\n.*?<!-- end -->", re.DOTALL)
BASELINES = ("random", "sobol")
"""Methods without a column, since they rarely reach a target."""
OMITTED_KEYS = ("runs", "trials", "log", "values", "profiles", "largest_errors_m")


def without_runs(value: Any) -> Any:
    """Data of the tables, without single runs."""
    if isinstance(value, Mapping):
        # `runs` is a list of all runs in one place, a count in the other
        return {k: without_runs(v) for k, v in value.items() if k not in OMITTED_KEYS or isinstance(v, int)}
    return [without_runs(item) for item in value] if isinstance(value, list) else value


def to_one_percent(data: Mapping[str, Any]) -> Table:
    """Table of expected running times to 1 %; those to other targets are in `docs/data`."""
    table = tables.summary_table(data)
    columns = [i for i, heading in enumerate(table.headings) if i != 1 and heading not in BASELINES]
    rows = tuple(tuple(row[i] for i in columns) for row in table.rows if row[1] == "1 %")
    return dataclasses.replace(table, headings=tuple(table.headings[i] for i in columns), rows=rows)


def blocks(data: Mapping[str, Any]) -> dict[str, str]:
    """Generated texts by the name of their mark."""
    return {
        # the table shows where another method is better
        "conclusion": f"**{conclusion(data).split('; elsewhere')[0].rstrip('.')}.**",
        "table": to_one_percent(data).markdown(),
    }


def filled(text: str) -> str:
    """Page with new texts between its marks."""

    def block_text(match: re.Match[str]) -> str:
        name, block = match.groups()
        data = json.loads((DATA / f"comparison-{name}.json").read_text(encoding="utf-8"))
        return f"<!-- {name}: {block} -->\n{blocks(data)[block]}\n<!-- end -->"

    return BLOCK.sub(block_text, text)


def main(folders: list[str]) -> None:
    """Store the data of comparisons and write the pages."""
    DATA.mkdir(exist_ok=True)
    for folder in folders:
        data = json.loads((Path(folder) / "comparison.json").read_text(encoding="utf-8"))
        text = json.dumps(without_runs(data), indent=1) + "\n"
        (DATA / f"comparison-{data['name']}.json").write_text(text, encoding="utf-8")
    for page in PAGES:
        page.write_text(filled(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
