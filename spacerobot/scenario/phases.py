"""Phases: what differs from the scenario for a while, how that ends, and what follows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from pydantic import Field, model_validator

from spacerobot.common.errors import near_names
from spacerobot.common.section import Name, Section, quantity

END = "end"
"""What follows a phase that ends the simulation."""


class Settled(Section):
    """Condition that a body is nearly at rest."""

    of: Name = Field(
        default="target", description="a robot's name, or target: the body whose root link is meant"
    )
    speed: float = quantity("m/s", "maximum speed of its root link", gt=0)
    spin_deg: float | None = quantity("deg/s", "maximum spin", default=None, gt=0)
    dwell: float = quantity("s", "time for which both must hold", default=0.0, ge=0)


class Limit(Section):
    """An output that passes a limit: a number, or the length of a vector."""

    output: str = Field(min_length=1, description="name of the output, as in the result: grasp_force")
    of: str | None = Field(default=None, description="of which tip, body or grasp; none for the whole scene")
    above: float | None = quantity("unit of the output", "passed where it rises above", default=None)
    below: float | None = quantity("unit of the output", "passed where it falls below", default=None)

    @model_validator(mode="after")
    def _check(self) -> Limit:
        if (self.above is None) == (self.below is None):
            raise ValueError("give either `above` or `below`")
        return self

    def words(self) -> str:
        """It, in a few words."""
        side = "above" if self.above is not None else "below"
        of = f" of {self.of}" if self.of else ""
        return f"when {self.output}{of} is {side} {self.below if self.above is None else self.above:g}"


class PhaseEnd(Section):
    """End of a phase, by one of these conditions."""

    time: float | None = quantity("s", "time since the phase began", default=None, gt=0)
    captured: tuple[Name, ...] | None = Field(default=None, min_length=1, description="all these grasps hold")
    released: tuple[Name, ...] | None = Field(
        default=None, min_length=1, description="all these grasps have been released"
    )
    settled: Settled | None = Field(default=None, description="a body hardly moves")
    limit: Limit | None = Field(default=None, description="an output passes a limit")

    @model_validator(mode="after")
    def _check(self) -> PhaseEnd:
        given = [name for name, value in self if value is not None]
        if len(given) != 1:
            names = ", ".join(type(self).model_fields)
            raise ValueError(f"found {', '.join(given) or 'none'}, allowed: one of {names}")
        return self

    def words(self) -> str:
        """It, in a few words."""
        if self.time is not None:
            return f"after {self.time:g} s"
        if self.settled is not None:
            held = f" for {self.settled.dwell:g} s" if self.settled.dwell else ""
            return f"when {self.settled.of} moves slower than {self.settled.speed:g} m/s{held}"
        if self.limit is not None:
            return self.limit.words()
        kind, names = ("captured", self.captured) if self.captured else ("released", self.released)
        return f"when {' and '.join(names or ())} {'is' if len(names or ()) == 1 else 'are'} {kind}"


class Phase(Section):
    """Phase of a simulation: changes to the scenario, condition of its end, and the next phase."""

    until: PhaseEnd | None = Field(default=None, description="condition of its end")
    timeout: float | None = quantity("s", "it ends at the latest after so long", default=None, gt=0)
    next: Name | None = Field(
        default=None, description="phase that follows, or end; the next one, end for the last, if not given"
    )
    on_timeout: Name | None = Field(
        default=None, description="next phase after a `timeout`; as `next` if not given"
    )
    abort: Limit | None = Field(
        default=None, description="an output passes a limit, as of a detected failure: it ends at once"
    )
    on_abort: Name | None = Field(default=None, description="next phase after an `abort`")
    captures: tuple[Name, ...] | None = Field(
        default=None,
        description="grasps that may close in it, including released ones; if not given, every open grasp "
        "that has not been released",
    )
    releases: tuple[Name, ...] = Field(default=(), description="grasps that are released when it begins")
    begins_at: Literal["pose", "reference"] = Field(
        default="pose",
        description="start of its own references: the tips' poses, or the ends of the preceding references",
    )
    reset: bool = Field(
        default=False,
        description="whether controllers' states are reset when it begins; if false they are kept",
    )
    robots: dict[str, Any] = Field(
        default={},
        description="what differs, nested as in the scenario: references, numbers of controllers and "
        "sensors, null for a controller that rests; `*` in a name matches any letters",
    )
    target: dict[str, Any] = Field(default={}, description="changes: the reference of the object")
    grasps: dict[str, Any] = Field(default={}, description="numbers that differ")

    @model_validator(mode="after")
    def _check(self) -> Phase:
        if self.on_timeout is not None and self.timeout is None:
            raise ValueError("on_timeout: never followed, for there is no `timeout`")
        if (self.abort is None) != (self.on_abort is None):
            raise ValueError("abort: give it with `on_abort`, the phase that follows, or none of them")
        if self.next is not None and self.until is None and self.timeout is None:
            raise ValueError("next: never followed; define the end of the phase by `until` or `timeout`")
        return self

    @property
    def changes(self) -> dict[str, Any]:
        """Differences from the scenario, nested as in it."""
        found = {"robots": self.robots, "target": self.target, "grasps": self.grasps}
        return {key: value for key, value in found.items() if value}

    @property
    def ends(self) -> bool:
        """Whether it ends before the simulation does."""
        return self.until is not None or self.timeout is not None


Phases = Mapping[str, Phase]


def successors(phases: Phases) -> dict[str, tuple[str, str]]:
    """Successors of each phase: at its end, and at its end by ``timeout``."""
    names = list(phases)
    found = {}
    for name, default in zip(names, [*names[1:], END], strict=True):
        following = phases[name].next or default
        found[name] = (following, phases[name].on_timeout or following)
    return found


def _following(phases: Phases) -> dict[str, set[str]]:
    """Phases that may follow each phase at once, however it ends; END among them."""
    return {
        name: {*(follows if phases[name].ends else ()), *filter(None, (phases[name].on_abort,))}
        for name, follows in successors(phases).items()
    }


def reached_from(name: str, phases: Phases) -> set[str]:
    """Phases that may follow a phase, at once or later."""
    following, found, left = _following(phases), set[str](), [name]
    while left:
        new = following[left.pop()] - found - {END}
        found |= new
        left += new
    return found


def ways(name: str, phases: Phases) -> str:
    """Conditions that end a phase and what follows, in words."""
    phase, (following, on_timeout) = phases[name], successors(phases)[name]
    found = [] if phase.until is None else [f"{phase.until.words()} -> {following}"]
    if phase.timeout is not None:
        latest = " at the latest" if phase.until is not None else ""
        found.append(f"after {phase.timeout:g} s{latest} -> {on_timeout}")
    if phase.abort is not None:
        found.append(f"abort {phase.abort.words()} -> {phase.on_abort}")
    return "; ".join(found) or "to the end of the simulation"


def differences(phase: Phase) -> list[str]:
    """Differences of a phase from the scenario, in words."""
    found = [
        f"{path} {value:g}" for path, value in _differing(phase.changes) if isinstance(value, float | int)
    ]
    found += [
        f"{path} {value['kind']}" for path, value in _differing(phase.changes) if isinstance(value, dict)
    ]
    found += [f"{path} rests" for path, value in _differing(phase.changes) if value is None]
    if phase.captures is not None:
        found.append(f"may close: {', '.join(phase.captures) or 'none'}")
    if phase.releases:
        found.append(f"releases: {', '.join(phase.releases)}")
    return [*found, "controllers are reset"] if phase.reset else found


def _differing(changes: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Numbers, nulls and whole references that a phase names, with their dotted paths."""
    for key, value in changes.items():
        if isinstance(value, Mapping) and key != "reference":
            yield from _differing(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def check_phases(phases: Phases, grasps: Mapping[str, Any], bodies: list[str]) -> None:
    """Refuse names that do not exist, phases that are never reached, and cycles without time passing.

    Raises:
        ValueError: Its text begins with the dotted path.
    """
    for name, phase in phases.items():
        if name == END:
            raise ValueError(
                f"phases.{END}: the name is reserved for the end of the simulation; rename the phase"
            )
        for key, found, allowed in _names(phase, [*phases, END], list(grasps), bodies):
            if found not in allowed:
                what = (
                    "phase"
                    if key in ("next", "on_timeout", "on_abort")
                    else "grasp"
                    if "settled" not in key
                    else "body"
                )
                raise ValueError(f"phases.{name}.{key}: no {what} {found!r}; {near_names(found, allowed)}")
        for grasp in (*(phase.captures or ()), *((phase.until and phase.until.captured) or ())):
            if grasps[grasp].capture is None and grasps[grasp].begins == "open":
                raise ValueError(f"phases.{name}: grasp {grasp!r} has no `capture`, so it never closes")
        let_go = {found for other in phases.values() for found in other.releases}
        for grasp in (phase.until and phase.until.released) or ():
            if grasps[grasp].release is None and grasp not in let_go:
                raise ValueError(
                    f"phases.{name}.until.released: {grasp!r} is never released; add a `release`, or list it "
                    "in a phase's `releases`"
                )
    for grasp, section in grasps.items():
        lets = any(phase.captures is None or grasp in phase.captures for phase in phases.values())
        if section.begins == "open" and not lets:
            raise ValueError(
                f"grasps.{grasp}.capture: never holds, for no phase names {grasp!r} in `captures`"
            )
    # refuse phases that nothing leads to
    first = next(iter(phases))
    reached = {first} | reached_from(first, phases)
    for name in phases:
        if name not in reached:
            earlier = list(phases)[list(phases).index(name) - 1]
            why = f"; {earlier!r} never ends" if not phases[earlier].ends else ""
            raise ValueError(
                f"phases.{name}: never reached{why}; lead to it by `next`, `on_timeout` or `on_abort`"
            )
    # refuse phases that wait for grasps which are open when they begin and may not close in them
    follows, before = _following(phases), {name: set[str]() for name in phases}
    before[next(iter(phases))] = {name for name, grasp in grasps.items() if grasp.begins == "closed"}
    held = dict(before)
    for name in [*phases] * len(phases):  # as often as a way through all of them is long
        phase = phases[name]
        closing = grasps if phase.captures is None else phase.captures
        closes = {grasp for grasp in closing if grasps[grasp].capture is not None}
        held[name] = (before[name] - set(phase.releases)) | closes
        for following in follows[name]:
            if following != END:
                before[following] |= held[name]
    for name, phase in phases.items():
        for grasp in (phase.until and phase.until.captured) or ():
            if grasp not in held[name]:
                raise ValueError(
                    f"phases.{name}.until.captured: never holds, for {grasp!r} is open when the phase begins "
                    "and `captures` does not name it"
                )
    # refuse phases that end at once in turn: their grasps are captured or released as it is
    next_ones = successors(phases)
    for first in phases:
        name, seen = first, list[str]()
        while name in phases and name not in seen and _ends_at_once(phases[name]):
            seen.append(name)
            name = next_ones[name][0]
        if name == first and seen and not _contradict([phases[at] for at in seen]):
            way = " -> ".join([*seen, first])
            raise ValueError(f"phases.{first}: no time passes in {way}: each ends as soon as it begins")


def check_planned(names: list[str], phases: Phases) -> None:
    """Refuse a plan of other phases than the first ones, in turn.

    Raises:
        ValueError: Its text begins with the dotted path.
    """
    if not names:
        return
    for name in names:
        if name not in phases:
            told = near_names(name, phases) if phases else "the scenario has no `phases`"
            raise ValueError(f"plan.phases.{name}: no phase {name!r}; {told}")
    turn, follows = list[str](), successors(phases)
    while len(turn) < len(names):
        turn.append(follows[turn[-1]][0] if turn else next(iter(phases)))
        if turn[-1] == END:
            break
    for name, wanted in zip(names, turn, strict=True):
        if name != wanted:
            raise ValueError(
                f"plan.phases.{name}: found where {wanted!r} is in turn; plan the scenario's first phases, "
                "as they follow each other"
            )


def _names(
    phase: Phase, following: list[str], grasps: list[str], bodies: list[str]
) -> Iterator[tuple[str, str, list[str]]]:
    """Names that a phase mentions: key, name, those allowed there."""
    for key, found in (("next", phase.next), ("on_timeout", phase.on_timeout), ("on_abort", phase.on_abort)):
        if found is not None:
            yield key, found, following
    until = phase.until or PhaseEnd(time=1.0)
    named = {"captures": phase.captures, "releases": phase.releases}
    named |= {"until.captured": until.captured, "until.released": until.released}
    for key, names in named.items():
        for name in names or ():
            yield key, name, grasps
    if until.settled is not None:
        yield "until.settled.of", until.settled.of, bodies


def _ends_at_once(phase: Phase) -> bool:
    """Whether it ends as soon as it begins, if its grasps are as it waits for."""
    until = phase.until
    return until is not None and (until.captured is not None or until.released is not None)


def _contradict(phases: list[Phase]) -> bool:
    """Whether a grasp must be captured for one of them to end, and released for another."""
    ends = [phase.until for phase in phases if phase.until is not None]
    captured = {name for until in ends for name in until.captured or ()}
    return any(name in captured for until in ends for name in until.released or ())
