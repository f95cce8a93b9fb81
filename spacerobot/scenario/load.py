"""Conversion between plain documents and scenarios, with the first error in one line."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from spacerobot.common.errors import ScenarioError
from spacerobot.elements.core.registry import kinds
from spacerobot.quantities import planned
from spacerobot.scenario.paths import Document, assign, expand, get
from spacerobot.scenario.scenario import Scenario
from spacerobot.scenario.units import unit_at
from spacerobot.scenario.validation_errors import explain_all
from spacerobot.scenario.yaml_text import Dumper

SHOWN_ERRORS = 3
"""Maximum number of errors after the first one that a message states."""
PLAUSIBLE_NUMBERS = (1.0, 1e-3, 1e3)
"""Numbers in place of wrong ones, with which their units are looked up."""


def validate(document: Document, *, source: Path | str | None = None) -> Scenario:
    """Validate a document and return its scenario.

    Raises:
        ScenarioError: For the first invalid value: its dotted path, the value and the allowed values.
    """
    try:
        return Scenario.model_validate(document)
    except ValidationError as fault:
        messages = explain_all(fault.errors(include_url=False), document)
        units = _units(document, [place for place, text in messages.items() if "allowed: " in text])
        (where, first), *others = ((place, text + units.get(place, "")) for place, text in messages.items())
        shown = "".join(f"; {place}: {text}" for place, text in others[:SHOWN_ERRORS])
        rest = f"; and {len(others) - SHOWN_ERRORS} more errors" if len(others) > SHOWN_ERRORS else ""
        raise ScenarioError(f"{first}{shown}{rest}", source=source, where=where or None) from None
    except RecursionError:
        raise ScenarioError("nested too deeply", source=source) from None


def _units(document: Document, paths: Sequence[str]) -> dict[str, str]:
    """Units at paths with wrong values of a document, as `` [kg]``; none if it has other errors."""
    for number in PLAUSIBLE_NUMBERS:
        try:
            mended = document
            for path in paths:
                mended = assign(mended, path, number)
            scenario = Scenario.model_validate(mended)
            units = {path: unit_at(scenario, path) for path in paths}
        except (ScenarioError, LookupError, AttributeError, ValueError, TypeError):
            continue
        return {path: f" [{unit}]" for path, unit in units.items() if unit not in ("1", "SI")}
    return {}


def to_document(scenario: Scenario) -> Document:
    """Plain document of a scenario, including defaults, for YAML and dotted paths."""
    return scenario.model_dump(mode="json")


def apply_changes(
    document: Document, changes: Iterable[tuple[str, Any]], *, source: Path | str | None = None
) -> Document:
    """Apply changes in order and validate the result, since some changes are valid only together.

    Args:
        document: Plain document of a valid scenario.
        changes: Dotted paths, which may contain ``*``, and new values.
        source: Source for error messages.

    Returns:
        dict: The changed document, which includes the defaults of sections that changes create.

    Raises:
        ScenarioError: If a path matches nothing, or the changed document is invalid.
    """
    changed = ChangedDocument(document, source)
    for pattern, value in changes:
        changed.apply(pattern, value)
    return to_document(validate(changed.document, source=source))


class ChangedDocument:
    """Scenario document to which several changes are applied before it is validated.

    A path may lead into a section that an earlier change created without its defaults. Only then the defaults
    are filled in between two changes.

    Args:
        document: Plain document of a valid scenario.
        source: Source for error messages.
    """

    def __init__(self, document: Document, source: Path | str | None = None) -> None:
        self.document, self.source = document, source
        self._has_new_sections = False

    def apply(self, pattern: str, value: Any) -> None:
        """Apply one change.

        Args:
            pattern: Dotted path, may contain ``*``.
            value: New value.

        Raises:
            ScenarioError: If the path matches nothing.
        """
        if "*" in pattern and self._has_new_sections:  # their default keys match too
            self._fill_defaults()
        try:
            changed = assign(self.document, pattern, value)
        except ScenarioError:
            self._fill_defaults()
            try:
                changed = assign(self.document, pattern, value)
            except ScenarioError as fault:
                raise ScenarioError(
                    fault.message, source=self.source, where=f"change {fault.where}"
                ) from None
        self._has_new_sections |= not self._replaces_number(pattern, value)
        self.document = changed

    def _replaces_number(self, pattern: str, value: Any) -> bool:
        """Whether a change replaces only numbers by a number, which creates no section."""
        try:
            replaced = [get(self.document, path) for path in expand(self.document, pattern)]
        except ScenarioError:
            return False
        return all(isinstance(one, int | float) for one in (value, *replaced))

    def _fill_defaults(self) -> None:
        """Fill in the defaults of all sections, if the document is valid."""
        with contextlib.suppress(ScenarioError):
            self.document, self._has_new_sections = to_document(validate(self.document)), False


def check_changes(
    scenario: Scenario, changes: Iterable[tuple[str, Any]], *, source: Path | str | None = None
) -> None:
    """Check changes before URDFs are read, as far as their paths do not depend on URDFs.

    Raises:
        ScenarioError: If a change names no section, or the changed scenario is invalid.
    """
    changed = ChangedDocument(to_document(scenario), source)
    for pattern, value in changes:
        if ".links." in pattern:  # checked together with the URDF
            return
        try:
            changed.apply(pattern, value)
        except ScenarioError:
            section = pattern.partition(".")[0]
            if section in changed.document or "*" in section:  # the URDF may define the value
                return
            raise
    validate(changed.document, source=source)


def to_yaml(scenario: Scenario) -> str:
    """YAML text of a scenario, including defaults, which reads back to the same scenario."""
    return yaml.dump(to_document(scenario), Dumper=Dumper, sort_keys=False, allow_unicode=True, width=110)


def json_schema() -> dict[str, Any]:
    """JSON schema of scenario files, for editors."""
    dialect = "https://json-schema.org/draft/2020-12/schema"
    schema = {"$schema": dialect, **Scenario.model_json_schema(), "title": "spacerobot scenario"}
    for section in schema["$defs"].values():
        paths = section["properties"].get("paths")
        if paths is not None:  # a single path may be written without a list
            several = {key: paths.pop(key) for key in ("type", "items", "minItems") if key in paths}
            paths["anyOf"] = [{"type": "string"}, several]
    duration = schema["$defs"]["PlanSection"]["properties"]["duration"]  # a number is a fixed duration
    duration["anyOf"] = [{"type": "number", "exclusiveMinimum": 0}, {"$ref": duration.pop("$ref")}]
    definitions = schema["$defs"]
    options: dict[str, dict[str, list[Any]]] = {"costs": {}, "limits": {}}
    for name, weighed in planned().items():
        unit, text = weighed.weight_unit(), f"weight: {weighed.description}"
        number = {"type": "number", "description": f"{text} [{unit}]", "unit": unit, "minimum": 0}
        options["costs"][name] = [number, {"$ref": "#/$defs/PlanCost"}]
    for name, kind in kinds("plan_limit").items():
        place, short = f"#/$defs/{kind.__name__}", getattr(kind, "short", None)
        alone = [definitions[kind.__name__]["properties"][short]] if short else []
        options["limits"][name] = [*alone, {"$ref": place}]
    for key, named in options.items():  # an entry named by its kind may be a number or list
        entries = definitions["PlanSection"]["properties"][key]
        (section,) = entries.pop("patternProperties").values()
        entries["additionalProperties"] = section
        entries["properties"] = {name: {"anyOf": [*each, {"type": "null"}]} for name, each in named.items()}
    return schema
