"""Mangled scenarios: every shipped scenario and example with values, tags and nesting that do not belong.

``python -m tests.oracles.mangled --cases 10000 --seed 1`` tries so many and reports each that ends in
anything but a scene or one line of :class:`~spacerobot.SpaceRobotError`, or takes more than 15 s of
processor time; with ``--rollouts`` small scenes, which are simulated too.
"""

from __future__ import annotations

import argparse
import collections
import copy
import functools
import random
import re
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from optim.campaign.sampling.parameter_space import campaign_of, resolve_space
from optim.planning.formulation.formulate import formulate_phases
from optim.planning.studies.design_study import design_variables
from optim.problem.scene_recipe import tuning_of
from optim.problem.variables import variables_of
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import DivergedError, SpaceRobotError
from spacerobot.scenario.document import parse_yaml
from spacerobot.scenario.load import to_document, validate
from spacerobot.scene import build_scene
from spacerobot.scene.overlaps import overlaps
from spacerobot.simulation import simulate

ROOT = Path(__file__).parents[2]
SOURCES = tuple(
    sorted([*(ROOT / "spacerobot" / "scenarios").glob("*.yaml"), *(ROOT / "examples").glob("*.yaml")])
)

WRONG = (
    *(
        "~",
        "true",
        "0",
        "-1",
        "1",
        "1e308",
        "-1e308",
        "1e-320",
        ".nan",
        ".inf",
        "9223372036854775808",
        "1" + "0" * 400,
    ),
    *(
        "-9223372036854775809",
        "''",
        "text",
        "'1.5'",
        "0x10",
        "a/b",
        "target/body",
        "../x",
        "'*'",
        "a.b",
        "\u00e9",
    ),
    *("[]", "{}", "[[]]", "[[[[1]]]]", "[0, 0, 0]", "[1e308, 1e308, 1e308]", "[~]", "[text]", "[1, 2]"),
    *(
        "[9223372036854775808, 0, 0]",
        "[a, b]",
        "{'': {}}",
        "{kind: ~}",
        "{kind: []}",
        "{kind: hold}",
        "{a: 1}",
        "{a: ~}",
    ),
    *("{a: text}", "{a: [1]}", "{a: {b: {c: 1}}}", "[[1, 2, 3], [4]]", "2001-01-01", "1_000"),
)
"""YAML for values that hardly any key allows."""

FACTORS = (0.0, -1.0, 1e-15, 1e-9, 1e-4, 1e-2, 1e2, 1e4, 1e9, 1e15)
"""Factors of numbers, which have the right type then."""
MAX_CPU_S = 15.0
"""Processor time that a case may take."""
ROLLED = ("bounce.yaml", "drift.yaml", "reach.yaml", "checkcase-9b.yaml")
"""Sources that are simulated in a moment."""
MAX_DURATION_S = 0.05

TAGS = ("float", "int", "bool", "null", "str", "seq", "map", "binary", "set", "timestamp", "merge", "value")
NAMES = ("x", "tip", "target", "rpr1", "kp", "a.b", "", "*", "3", "body")


@dataclass(frozen=True)
class Case:
    """A mangled scenario.

    Attributes:
        source: The file that it was made of.
        document: What became of it: YAML, or what YAML holds.
        is_simulated: Whether the scene is simulated, too.
    """

    source: Path
    document: Any
    is_simulated: bool = False


class OverrunError(Exception):
    """More processor time than a case may take."""


@functools.cache
def _text(source: Path) -> str:
    return source.read_text(encoding="utf-8")


@functools.cache
def filled(source: Path) -> Any:
    """A scenario with every default, and what its URDFs give, filled in."""
    return to_document(
        build_scene(validate(parse_yaml(_text(source)), source=source), source=source).scenario
    )


@functools.cache
def _wrong() -> tuple[Any, ...]:
    return tuple(parse_yaml(text) for text in WRONG)


def mangle(rng: random.Random) -> Case:
    """Draw a source, and mangle it as text or, with every key filled in, as a document."""
    source = rng.choice(SOURCES)
    if rng.random() < 0.3:
        return Case(source, _mangled_text(rng, _text(source)))
    return Case(source, _mangled_document(rng, copy.deepcopy(filled(source))))


def _mangled_document(rng: random.Random, document: Any) -> Any:
    """Change one to three places; each section is as likely, however long it is."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        top = rng.choice(list(document))
        places = [(document, top)]
        for holder, key in places:  # which grows
            value = holder[key]
            if isinstance(value, dict | list):
                places += [
                    (value, inner) for inner in (value if isinstance(value, dict) else range(len(value)))
                ]
        holder, key = rng.choice(places)
        value = holder[key]
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if is_number and rng.random() < 0.5:
            holder[key] = value * rng.choice(FACTORS) if value else rng.choice(FACTORS)
            continue
        match rng.choice(("wrong", "wrong", "wrong", "wrap", "drop", "rename", "transplant")):
            case "wrong":
                holder[key] = copy.deepcopy(rng.choice(_wrong()))
            case "wrap":
                for _ in range(rng.choice((1, 2, 60))):
                    value = [value]
                holder[key] = value
            case "drop" if holder is not document or len(document) > 1:
                del holder[key]
            case "rename" if isinstance(holder, dict):
                holder[rng.choice(NAMES)] = holder.pop(key)
            case "transplant":
                other, place = rng.choice(places)
                holder[key] = copy.deepcopy(other[place])
            case _:
                pass
    return document


def _mangled_text(rng: random.Random, text: str) -> str:
    """Give one or two lines of a YAML text another value, tag or indentation, or a wrong character."""
    for _ in range(rng.choice((1, 1, 2))):
        lines = text.split("\n")
        at = rng.choice([i for i, line in enumerate(lines) if line.partition("#")[0].strip()])
        line, fill = lines[at], rng.choice(WRONG)
        key, colon, value = line.partition(": ")
        match rng.choice(("line", "scalar", "tag", "tag", "indent", "character")):
            case "line" if colon:
                lines[at] = f"{key}: {fill}"
            case "scalar":
                found = re.search(r"(?<=[ \[])[-\w./]+(?=[],}]|$)", line)
                if found:
                    lines[at] = line[: found.start()] + fill + line[found.end() :]
            case "tag":
                empty = rng.choice(("''", "maybe", "1", "1e3", "1:30", value.strip(), value.strip()))
                lines[at] = f"{key}: !!{rng.choice(TAGS)} {empty}"
            case "indent":
                lines[at] = line[rng.randrange(3) :] if rng.random() < 0.5 else "  " + line
            case _:
                i = rng.randrange(len(line) + 1)
                lines[at] = (
                    line[:i] + rng.choice("{}[]:,-#&*!|>'\"%@`? \t\x00") + line[i + rng.randrange(2) :]
                )
        text = "\n".join(lines)
    return text


MOTION = {"name", "description", "simulation", "tuning", "campaign", "plan"}
"""Sections on which no closed loop depends."""


def use(case: Case) -> None:
    """Read a scenario, build its scene, and whatever its sections describe.

    Raises:
        SpaceRobotError: What is wrong with it.
    """
    source, document = case.source, case.document
    if isinstance(document, str):
        document = parse_yaml(document, source=source)
    scene = build_scene(validate(document, source=source), source=source)
    overlaps(scene)
    scenario, faults = scene.scenario, []
    uses: list[Callable[[], object]] = []
    if scenario.plan is not None:
        uses.append(lambda: formulate_phases(scene))
        if scenario.plan.design:
            uses.append(lambda: design_variables(scene))
    if scenario.tuning is not None:
        uses.append(lambda: variables_of(scene, tuning_of(scene).variables))
    if scenario.campaign is not None:
        uses.append(lambda: resolve_space(scene, campaign_of(scene)))
    found, original = to_document(scenario), filled(source)
    if any(found[key] != original[key] for key in found.keys() - MOTION):
        uses.append(lambda: build_closed_loop(scene))
    for each in uses:
        try:
            each()
        except SpaceRobotError as fault:
            faults.append(fault)
    if case.is_simulated:
        simulate(scene, backend="interpreted")
    if faults:
        raise faults[0]


def judged(case: Case | Callable[[], object]) -> str | None:
    """What is wrong with how a case ends; None if it is a scene, or an error of one line, in time."""

    def overrun(*_: object) -> None:
        raise OverrunError(f"more than {MAX_CPU_S:g} s of processor time")

    # the handler runs as soon as a library that is at work returns
    before = signal.signal(signal.SIGPROF, overrun)
    signal.setitimer(signal.ITIMER_PROF, MAX_CPU_S)
    try:
        with np.errstate(all="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            use(case) if isinstance(case, Case) else case()
    except SpaceRobotError as fault:
        text = str(fault)
        codes = (2, DivergedError.exit_code)  # a rollout that is not carried out diverged
        if "\n" in text or not 10 < len(text) < 1500 or fault.exit_code not in codes:
            return f"not a line that a person can act on: {text!r}"
    except Exception as fault:
        trace = traceback.extract_tb(fault.__traceback__)
        own = [f"{Path(at.filename).name}:{at.lineno}" for at in trace if str(ROOT) in at.filename]
        return f"{type(fault).__name__}: {str(fault)[:150]} at {' '.join(own[-5:])}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
    return None


def cases(seed: int, count: int) -> Iterator[Case]:
    """So many cases; the same for the same seed."""
    rng = random.Random(seed)
    return (mangle(rng) for _ in range(count))


def rollouts(seed: int, count: int) -> Iterator[Case]:
    """So many cases of small scenes that are simulated; the same for the same seed."""
    rng = random.Random(seed)
    sources = [source for source in SOURCES if source.name in ROLLED]
    for _ in range(count):
        source = rng.choice(sources)
        document = copy.deepcopy(filled(source))
        document["simulation"] |= {"duration": MAX_DURATION_S, "output_step": MAX_DURATION_S / 5}
        mangled = _mangled_document(rng, document)
        section = mangled.get("simulation")
        duration = section.get("duration") if isinstance(section, dict) else None
        short = isinstance(duration, int | float) and duration <= 10 * MAX_DURATION_S
        yield Case(source, mangled, is_simulated=short)


def _main() -> int:
    options = argparse.ArgumentParser()
    options.add_argument("--cases", type=int, default=1000)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--rollouts", action="store_true", help="small scenes, which are simulated")
    options.add_argument("--keep", type=Path, help="folder for the texts that fail")
    chosen = options.parse_args()
    found: dict[str, list[int]] = collections.defaultdict(list)
    made = rollouts if chosen.rollouts else cases
    for number, case in enumerate(made(chosen.seed, chosen.cases)):
        wrong = judged(case)
        if wrong is not None:
            found[wrong].append(number)
            print(number, case.source.name, wrong, flush=True)
            if chosen.keep is not None:
                chosen.keep.mkdir(parents=True, exist_ok=True)
                (chosen.keep / f"{chosen.seed}-{number}-{case.source.name}").write_text(str(case.document))
    print(f"{sum(map(len, found.values()))} of {chosen.cases} cases fail, {len(found)} ways")
    return bool(found)


if __name__ == "__main__":
    sys.exit(_main())
