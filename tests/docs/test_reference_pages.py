"""Generated reference pages have every key, kind, quantity and option, with its unit and description."""

import importlib.util
import re
from pathlib import Path

import pytest

from spacerobot.elements import FAMILIES, kinds
from spacerobot.quantities import quantities
from spacerobot.scenario.load import json_schema

DOCS = Path(__file__).parents[2] / "docs"


@pytest.fixture(scope="module")
def pages():
    spec = importlib.util.spec_from_file_location("reference_pages", DOCS / "reference_pages.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.PAGES


def test_every_generated_page_has_its_place(pages):
    named = [re.findall(r"<!-- generated: ([\w ]+) -->", page.read_text()) for page in DOCS.rglob("*.md")]
    assert sorted(name for names in named for name in names) == sorted(pages)


def test_every_key_of_the_schema_has_a_row_with_its_unit_and_range(pages):
    text = pages["scenario"]()
    for name, section in json_schema()["$defs"].items():
        if "properties" not in section:
            continue
        (table,) = re.findall(rf"{{ #section-{name.lower()} }}\n.*?(?=\n## |\Z)", text, re.DOTALL)
        for key, own in section["properties"].items():
            (row,) = re.findall(rf"^\| `{key}` \|.*$", table, re.MULTILINE)
            assert own.get("unit", "") in row
            assert len(re.split(r"(?<!\\)\|", row)) == 8, row
    assert "| `duration` | number | `10.0` | s | > 0, &lt;= 1e+06 | simulated time |" in text


def test_links_between_sections_have_targets(pages):
    text = pages["scenario"]()
    targets = set(re.findall(r"{ #([\w-]+) }", text))
    assert not set(re.findall(r"\]\(#([\w-]+)\)", text)) - targets


def test_kinds_quantities_and_commands_are_listed(pages):
    elements, metrics, commands = (pages[name]() for name in ("elements", "quantities", "command line"))
    assert all(f"| `{name}` |" in elements for family in FAMILIES for name in kinds(family))
    assert all(f"| `{name}` |" in metrics for name in quantities())
    assert all(
        f"## spacerobot {name}\n" in commands for name in ("run", "plan", "tune", "campaign", "studio")
    )
    assert re.search(r"^\| `--set` \|.*dotted path", commands, re.MULTILINE)
