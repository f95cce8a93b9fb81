"""Periods and steps are bounded by how often they fit into the simulated time."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from spacerobot.common.errors import ScenarioError
from spacerobot.common.section import RECURS, Section
from spacerobot.scenario.catalogue import find_scenario
from spacerobot.scenario.document import read_document
from spacerobot.scenario.load import to_document, validate
from spacerobot.scenario.paths import assign, get
from spacerobot.scenario.recurrences import recurring

NAMES = (
    "docking-as-flown",
    "capture-as-flown",
    "caught-unknown",
    "detumble",
    "examples/docking-receding.yaml",
)


def sections(base: type[Section] = Section) -> Iterator[type[Section]]:
    """All kinds of section."""
    for each in base.__subclasses__():
        yield each
        yield from sections(each)


def test_every_period_and_step_is_bounded():
    unbounded = []
    for each in sections():
        for name, field in each.model_fields.items():
            extra = field.json_schema_extra
            is_time = isinstance(extra, dict) and extra.get("unit") == "s"
            if is_time and name.rpartition("_")[2] in ("period", "step") and RECURS not in extra:
                unbounded.append(f"{each.__name__}.{name}")
    assert unbounded == []


@pytest.mark.parametrize("name", NAMES)
def test_a_period_that_is_too_short_is_refused_in_one_line(name):
    scenario = validate(read_document(find_scenario(name)))
    document, duration = to_document(scenario), scenario.simulation.duration
    checked = list[str]()
    for path, time, most in recurring(scenario, ""):
        assert duration / time <= most
        owner = path.rpartition(".")[0]
        changed = assign(document, path, duration / most / 2)
        for key in {"delay", "minimum_on_time", "resolution"} & set(
            get(document, owner)
        ):  # at most some periods long
            changed = assign(changed, f"{owner}.{key}", 0)
        with pytest.raises(ScenarioError) as caught:
            validate(changed)
        message = str(caught.value)
        assert f"{path}: found {duration / most / 2:g} s, {2 * most:.3g} times" in message
        assert f"allowed: at most {most:g} times" in message
        assert "\n" not in message
        checked.append(path)
    assert {"simulation.output_step"} < set(checked)


@pytest.mark.parametrize("step", [5e-14, 1e-300, 5e-324])
def test_a_series_of_a_campaign_is_bounded(step):
    document = read_document(find_scenario("paper"))
    document["campaign"] |= {"series": ["tip_error"], "series_step": step}
    with pytest.raises(ScenarioError, match=r"campaign\.series_step: found .* allowed: at most 1e\+07 times"):
        validate(document)
