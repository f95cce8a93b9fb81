"""Texts generated when the site is built: scenario, elements, quantities, command line, packages, laws."""

from __future__ import annotations

import ast
import functools
import inspect
import pkgutil
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import FunctionType
from typing import Any

Schema = Mapping[str, Any]
BOUNDS = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}
SECTIONS = 2
"""Heading level of the first heading on a generated page, below the page's own."""


def cell(text: str) -> str:
    """Text as one cell of a table."""
    return re.sub(r"[^\S\N{NO-BREAK SPACE}]+", " ", text).replace("|", "\\|").replace("<", "&lt;")


SCENARIO_PAGES: dict[str, tuple[str, ...]] = {
    "robots": ("Robot",),
    "controllers": ("tip_controller", "robot_controller"),
    "references": ("reference",),
    "actuators": ("actuator",),
    "sensors": ("Sensors", "sensor"),
    "estimators": ("estimator",),
    "flexible_links": ("flexible_link",),
    "target": ("Target",),
    "grasps": ("grasp",),
    "contacts": ("contact", "shape"),
    "environment": ("environment",),
    "phases": ("Phase",),
    "simulation": ("Simulation",),
    "tuning": ("Tuning",),
    "campaign": ("Campaign",),
    "plan": ("PlanSection",),
}
"""Pages of the scenario reference: the first definitions of each, by name or by family of elements."""


@functools.cache
def definitions() -> dict[str, dict[str, Schema]]:
    """Definitions of the scenario's schema by page.

    A page begins with its own ones, and those that they refer to follow, if no earlier page has them.
    """
    from spacerobot.elements import FAMILIES, kinds
    from spacerobot.scenario.load import json_schema

    schema = json_schema()["$defs"]
    first: dict[str, list[str]] = {}
    for page, names in SCENARIO_PAGES.items():
        classes = [[kind.__name__ for kind in kinds(n).values()] if n in FAMILIES else [n] for n in names]
        first[page] = [name for group in classes for name in group]
    placed = {name for names in first.values() for name in names}
    pages: dict[str, dict[str, Schema]] = {}
    for page, names in first.items():
        pages[page] = {}
        while names:
            name, *names = names
            pages[page][name] = schema[name]
            new = [other for other in referred(schema[name]) if other not in placed]
            placed.update(new)
            names += new
    return pages


def link(name: str, page: str) -> str:
    """Link from a page of the scenario reference to the section about a definition; empty: the overview."""
    home = next(home for home, names in definitions().items() if name in names)
    folder = "" if page else "scenario/"
    title = title_of(name, definitions()[home][name])
    return f"[{title}]({'' if home == page else f'{folder}{home}.md'}#{anchor(name)})"


def title_of(name: str, schema: Schema) -> str:
    """Title of the section about a definition: its kind in a scenario, if it has one."""
    kind = schema.get("properties", {}).get("kind", {}).get("const")
    return f"`{kind}`" if kind else name


def anchor(name: str) -> str:
    """Anchor of the section about a definition of the schema."""
    return f"section-{name.lower()}"


def referred(schema: Schema) -> Iterator[str]:
    """Names of the definitions that a key's schema refers to, each once, in their order."""
    text = re.findall(r"'\$ref': '#/\$defs/(\w+)'", str(dict(schema)))
    yield from dict.fromkeys(text)


def type_of(schema: Schema, page: str) -> str:
    """Type of a key in words, with links from a page to the sections that it may hold."""
    links = [link(name, page) for name in referred(schema)]
    if "patternProperties" in schema or isinstance(schema.get("additionalProperties"), dict):
        return "by name: " + (", ".join(links) or "values")
    options = [one for one in schema.get("anyOf", [schema]) if one.get("type") != "null"]
    words = list(dict.fromkeys(_plain(one) for one in options if "$ref" not in str(one)))
    return " or ".join([word for word in words if word] + ([", ".join(links)] if links else [])) or "any"


def _plain(schema: Schema) -> str:
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    if "const" in schema:
        return f"`{schema['const']}`"
    kind = str(schema.get("type", ""))
    if kind == "array":
        count = schema.get("minItems")
        return f"list of {count}" if count and count == schema.get("maxItems") else "list"
    names = {"string": "text", "object": "section", "boolean": "true or false", "integer": "whole number"}
    return names.get(kind, kind)


def range_of(schema: Schema) -> str:
    """Bounds of a key's number, from the key itself and from its alternatives."""
    entries = [
        f"{sign}\N{NO-BREAK SPACE}{one[key]:g}"
        for one in (schema, *schema.get("anyOf", ()))
        for key, sign in BOUNDS.items()
        if key in one
    ]
    return ", ".join(dict.fromkeys(entries))


def default_of(name: str, schema: Schema, required: Mapping[str, Any] | list[str]) -> str:
    """Default of a key; sections and empty mappings have none that would help a reader."""
    if name in required:
        return "required"
    value = schema.get("default")
    if value is None or value in ("", []) or isinstance(value, dict):
        return ""
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return f"`{text}`"


def section_table(schema: Schema, page: str) -> str:
    """Keys of one section as a table on a page."""
    rows = ["| key | type | default | unit | range | description |", "|---|---|---|---|---|---|"]
    required = schema.get("required", [])
    first_keys: dict[str, str] = {}  # a long list of kinds is shown once
    for name, own in schema.get("properties", {}).items():
        type_text = type_of(own, page)
        first_key = first_keys.setdefault(type_text, name)
        if first_key != name and type_text.count("](") > 2:
            type_text = f"as `{first_key}`"
        described = cell(re.sub(r"\s*\[[^\[\]]*\]$", "", str(own.get("description", ""))))
        cells = (type_text, default_of(name, own, required), own.get("unit", ""), range_of(own))
        rows.append(f"| `{name}` | " + " | ".join(cell(str(c)) for c in cells) + f" | {described} |")
    return "\n".join(['<div class="keys" markdown>\n', *rows, "\n</div>"])


def scenario() -> str:
    """Keys of the first level of a scenario, and the sections of each page."""
    from spacerobot.scenario.load import json_schema

    lists = [
        f"- [{page}](scenario/{page}.md): {', '.join(link(name, '') for name in names)}"
        for page, names in definitions().items()
    ]
    return "\n".join([section_table(json_schema(), ""), "", f"{'#' * SECTIONS} All sections", "", *lists])


def scenario_page(page: str) -> str:
    """Every key of the sections on one page of the scenario reference."""
    parts = []
    for name, own in definitions()[page].items():
        if "properties" in own:
            first = cell(str(own.get("description", "")).split("\n\n")[0])
            heading = f"{'#' * SECTIONS} {title_of(name, own)} {{ #{anchor(name)} }}"
            parts.append(f"{heading}\n\n{first}\n\n{section_table(own, page)}")
    return "\n\n".join(parts)


def elements() -> str:
    """Every kind of element by family."""
    from spacerobot.elements.core.kind_table import markdown

    return re.sub(r"^### ", "#" * SECTIONS + " ", markdown(), flags=re.MULTILINE)


def methods() -> str:
    """Methods of each family's base class: those that kinds must define, and those that some override."""
    from spacerobot.common.registry import requirement
    from spacerobot.elements import FAMILIES, PLANS, Element, kinds

    rows = ["| family: base class | required | optional |", "|---|---|---|"]
    named = {("all", Element): tuple(kind for family in FAMILIES for kind in kinds(family).values())}
    for family in (*FAMILIES, *PLANS):
        shipped = tuple(kind for kind in kinds(family).values() if kind.__module__.startswith("spacerobot."))
        bases = (base for kind in shipped for base in kind.__mro__ if "family" in vars(base))
        named[family, next(bases)] = shipped
    for (family, base), shipped in named.items():
        needed, optional = [], []
        for name in vars(base):
            rule = requirement(base, name)
            member = inspect.getattr_static(base, name)
            if rule is not None:
                needed.append(f"`{name}`{rule}: {_first_line(member)}")
            elif (
                not name.startswith("_")
                and isinstance(member, FunctionType | property | classmethod)
                and any(inspect.getattr_static(kind, name) is not member for kind in shipped)
            ):
                optional.append(f"`{name}`: {_first_line(member)}")
        texts = ("<br>".join(cell(text) for text in column) for column in (needed, optional))
        rows.append(f"| {family}: `{base.__name__}` | " + " | ".join(texts) + " |")
    return "\n".join(rows)


def _first_line(member: Any) -> str:
    text = (inspect.getdoc(member) or "").partition("\n")[0]
    return re.sub(r":\w+:`~?\.?([\w.]+)`", r"`\1`", text).replace("``", "`")


def quantities() -> str:
    """Every registered quantity with its names in scenarios."""
    from spacerobot.quantities import quantities as registered

    titles = ("name", "unit", "description", "over time")
    uses = (
        "`campaign.limits`",
        "`tuning.constraints`",
        "`tuning.objective`",
        "`plan.costs`",
        "`plan.limits`",
    )
    rows = [f"| {' | '.join((*titles, *uses))} |", "|---" * (len(titles) + len(uses)) + "|"]
    for name, own in registered().items():
        limits = (f"`{own.limit}`", f"`max_{own.limit}`") if own.limit else ("", "")
        weight = f"`{own.weight}` [{own.weight_unit('objective')}]" if own.weight else ""
        cost = f"`{own.cost}` [{own.weight_unit()}]" if own.cost else ""
        described = f"{own.label}: {own.description}" if own.description else own.label
        bounds = ", ".join(f"`{bound.key}` [{bound.unit}]" for bound in own.bounds)
        cells = (own.unit, described, own.reducer, *limits, weight, cost, bounds)
        rows.append(f"| `{name}` | " + " | ".join(cell(c) for c in cells) + " |")
    return "\n".join(rows)


def command_line() -> str:
    """Every command with its help, arguments and options, from the Typer application."""
    import typer

    from spacerobot.cli.app import app

    group = typer.main.get_command(app)
    parts = [_options(group)]
    for name, command in group.commands.items():  # type: ignore[attr-defined]
        parts.append(f"{'#' * SECTIONS} spacerobot {name}\n\n{command.help.strip()}\n\n{_options(command)}")
    return "\n\n".join(parts)


def _options(command: Any) -> str:
    rows = ["| argument or option | default | description |", "|---|---|---|"]
    for parameter in command.params:
        if parameter.name == "help" or getattr(parameter, "hidden", False):
            continue
        is_option = parameter.param_type_name == "option"
        names = ", ".join(
            f"`{name}`" for name in (parameter.opts if is_option else [str(parameter.name).upper()])
        )
        value = parameter.default
        default = "" if value is None or value is False or callable(value) or value == () else f"`{value}`"
        rows.append(f"| {names} | {default} | {cell(parameter.help or '')} |")
    return "\n".join(rows)


def packages() -> str:
    """Modules and packages with the first lines of their docstrings."""
    return "\n".join(_modules(("spacerobot", "optim", "viz"), levels=2))


def _modules(folders: tuple[str, ...], levels: int) -> Iterator[str]:
    root = Path(__file__).parents[1]
    for folder in folders:
        for found in pkgutil.iter_modules([str(root / folder)]):
            name = f"{folder}/{found.name}"
            file = root / name / "__init__.py" if found.ispkg else root / f"{name}.py"
            text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or ""
            if found.name[0] != "_" and (found.ispkg or folder.count("/") == 0):
                yield f"- `{name}`: {text.partition(chr(10))[0].replace('``', '`')}"
            if found.ispkg and levels > 1:
                yield from (f"    {line}" for line in _modules((name,), levels - 1))


def laws() -> str:
    """Docstrings of the modules that derive a law, by family of elements."""
    root = Path(__file__).parents[1]
    parts = []
    for folder, title in LAWS.items():
        derivations = [
            text
            for file in sorted((root / folder).glob("*.py"))
            if "$$" in (text := ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "")
        ]
        parts += [f"{'#' * SECTIONS} {title}"] * bool(derivations)
        for text in derivations:
            heading, _, body = text.partition("\n")
            parts.append(f"{'#' * (SECTIONS + 1)} {heading.rstrip('.')}\n{body}")
    return "\n\n".join(parts)


LAWS = {
    "spacerobot/elements/controllers": "Controllers",
    "spacerobot/elements/actuators": "Actuators",
    "spacerobot/elements/contacts": "Contacts",
    "spacerobot/elements/estimators": "Estimators",
    "spacerobot/elements/sensors": "Sensors",
    "spacerobot/elements/flexible": "Flexible links",
    "spacerobot/elements/core": "Sampling",
    "spacerobot/closedloop": "Closed loop",
    "spacerobot/dynamics": "Dynamics",
    "optim": "Identification",
}
"""Packages whose modules derive laws, with the headings of their sections."""

PAGES: dict[str, Callable[[], str]] = {
    "scenario": scenario,
    **{f"scenario {page}": functools.partial(scenario_page, page) for page in SCENARIO_PAGES},
    "elements": elements,
    "methods": methods,
    "quantities": quantities,
    "command line": command_line,
    "packages": packages,
    "laws": laws,
}
"""What a line ``<!-- generated: NAME -->`` is replaced by."""
