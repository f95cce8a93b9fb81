"""Generated reference pages have every key, kind, quantity and option, with its unit and description."""

import ast
import importlib
import importlib.util
import re
from pathlib import Path

import pytest

from spacerobot.elements import FAMILIES, PLANS, kinds
from spacerobot.quantities import quantities
from spacerobot.scenario.load import json_schema
from tests.oracles.syntax_trees import parsed_modules

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
    texts = {name: page() for name, page in pages.items() if name.startswith("scenario")}
    for name, section in json_schema()["$defs"].items():
        if "properties" not in section:
            continue
        (text,) = (text for text in texts.values() if f"{{ #section-{name.lower()} }}" in text)
        (table,) = re.findall(rf"{{ #section-{name.lower()} }}\n.*?(?=\n## |\Z)", text, re.DOTALL)
        for key, own in section["properties"].items():
            (row,) = re.findall(rf"^\| `{key}` \|.*$", table, re.MULTILINE)
            assert own.get("unit", "") in row
            assert len(re.split(r"(?<!\\)\|", row)) == 8, row
    bounds = ">\N{NO-BREAK SPACE}0, &lt;=\N{NO-BREAK SPACE}1e+06"
    row = f"| `duration` | number | `10.0` | s | {bounds} | simulated time |"
    assert row in texts["scenario simulation"]
    assert all(f"| `{key}` |" in texts["scenario"] for key in json_schema()["properties"])


def test_links_between_sections_have_targets(pages):
    texts = {
        name.removeprefix("scenario").strip(): page() for name, page in pages.items() if "scenario" in name
    }
    for page, text in texts.items():
        for home, target in re.findall(r"\]\(([\w/]*(?:\.md)?)#([\w-]+)\)", text):
            name = home.removeprefix("scenario/").removesuffix(".md") or page
            assert f"{{ #{target} }}" in texts[name], (page, target)
            assert home.startswith("scenario/") or page


def test_kinds_quantities_and_commands_are_listed(pages):
    elements, metrics, commands = (pages[name]() for name in ("elements", "quantities", "command line"))
    assert all(f"| `{name}` |" in elements for family in FAMILIES for name in kinds(family))
    assert all(f"| `{name}` |" in metrics for name in quantities())
    assert all(
        f"## spacerobot {name}\n" in commands for name in ("run", "plan", "tune", "campaign", "studio")
    )
    assert re.search(r"^\| `--set` \|.*dotted path", commands, re.MULTILINE)


def test_every_module_that_derives_a_law_is_on_the_page_of_laws(pages):
    laws = pages["laws"]()
    first = {
        path: text.partition("\n")[0].rstrip(".")
        for path, tree in parsed_modules("spacerobot", "optim", "viz")
        if "$$" in (text := ast.get_docstring(tree) or "")
    }
    assert len(first) > 20
    assert [path for path, line in first.items() if f"### {line}\n" not in laws] == []


def test_methods_are_listed_by_family(pages):
    text = pages["methods"]()
    rows = {family: re.findall(rf"^\| {family}: .*$", text, re.MULTILINE) for family in (*FAMILIES, *PLANS)}
    assert all(len(found) == 1 for found in rows.values())
    sensor = re.split(r"(?<!\\)\|", rows["sensor"][0])
    assert "`is_ideal`" in sensor[2]
    assert "`reads_motors`" in sensor[3]
    assert "`is_ideal`" not in sensor[3]
    assert "`spring_wrench` (with has_springs)" in rows["grasp"][0]


INTERNAL = {"spacerobot.cli"}
"""Packages with a page of their own elsewhere."""


def test_every_public_module_has_a_place_in_the_reference():
    text = "\n".join(page.read_text() for page in (DOCS / "reference" / "api").glob("*.md"))
    shown = re.findall(r"^::: ([\w.]+)", text, re.MULTILINE)
    found = {
        f"{package}.{path.stem}"
        for package in ("spacerobot", "optim", "viz")
        for path in (DOCS.parent / package).iterdir()
        if (path.suffix == ".py" or (path / "__init__.py").exists()) and not path.stem.startswith("_")
    }
    named = set(re.findall(r"<!-- names of ([\w.]+) -->", text))
    homes = {
        getattr(getattr(importlib.import_module(p), n), "__module__", None)
        for p in named
        for n in importlib.import_module(p).__all__
    }
    missing = {
        module
        for module in found - INTERNAL
        if module not in homes | named
        and not any(name == module or name.startswith(f"{module}.") for name in shown)
    }
    assert missing == set()
    assert found >= INTERNAL
