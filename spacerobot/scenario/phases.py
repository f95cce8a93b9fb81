"""Phases of a simulation: changes to the scenario, end conditions, and next phases."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal

from pydantic import Field, model_validator

from spacerobot.common.errors import near_names
from spacerobot.common.section import Name, Section, quantity

END = "end"
"""Name of the next phase that ends the simulation."""


class Settled(Section):
    """Condition that a body is nearly at rest."""

    of: Name = Field(
        default="target", description="a robot's name, or target: the body whose root link is meant"
    )
    speed: float = quantity("m/s", "maximum speed of its root link", gt=0)
    spin_deg: float | None = quantity("deg/s", "maximum spin", default=None, gt=0)
    dwell: float = quantity("s", "time for which both must hold", default=0.0, ge=0)


class Limit(Section):
    """Condition that an output, or the norm of a vector output, passes a limit."""

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
        """Condition in a few words."""
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
        conditions = [name for name, value in self if value is not None]
        if len(conditions) != 1:
            names = ", ".join(type(self).model_fields)
            raise ValueError(f"found {', '.join(conditions) or 'none'}, allowed: one of {names}")
        return self

    def words(self) -> str:
        """Condition in a few words."""
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
        """Changes to the scenario, nested as in it."""
        sections = {"robots": self.robots, "target": self.target, "grasps": self.grasps}
        return {key: value for key, value in sections.items() if value}

    @property
    def ends(self) -> bool:
        """Whether the phase may end before the simulation, except by ``abort``."""
        return self.until is not None or self.timeout is not None


Phases = Mapping[str, Phase]


def successors(phases: Phases) -> dict[str, tuple[str, str]]:
    """Next phases of each phase: after ``until``, and after ``timeout``."""
    names = list(phases)
    next_phases = {}
    for name, default in zip(names, [*names[1:], END], strict=True):
        following = phases[name].next or default
        next_phases[name] = (following, phases[name].on_timeout or following)
    return next_phases


def _following(phases: Phases) -> dict[str, set[str]]:
    """All possible next phases of each phase, including END and those after an abort."""
    return {
        name: {*(follows if phases[name].ends else ()), *filter(None, (phases[name].on_abort,))}
        for name, follows in successors(phases).items()
    }


def reached_from(name: str, phases: Phases) -> set[str]:
    """Phases that are reachable from a phase."""
    following, reachable, unvisited = _following(phases), set[str](), [name]
    while unvisited:
        new = following[unvisited.pop()] - reachable - {END}
        reachable |= new
        unvisited += new
    return reachable


def ways(name: str, phases: Phases) -> str:
    """End conditions of a phase and the next phases, in words."""
    phase, (following, on_timeout) = phases[name], successors(phases)[name]
    texts = [] if phase.until is None else [f"{phase.until.words()} -> {following}"]
    if phase.timeout is not None:
        latest = " at the latest" if phase.until is not None else ""
        texts.append(f"after {phase.timeout:g} s{latest} -> {on_timeout}")
    if phase.abort is not None:
        texts.append(f"abort {phase.abort.words()} -> {phase.on_abort}")
    return "; ".join(texts) or "to the end of the simulation"


def differences(phase: Phase) -> list[str]:
    """Changes of a phase to the scenario, in words."""
    texts = [
        f"{path} {value:g}" for path, value in _differing(phase.changes) if isinstance(value, float | int)
    ]
    texts += [
        f"{path} {value['kind']}" for path, value in _differing(phase.changes) if isinstance(value, dict)
    ]
    texts += [f"{path} rests" for path, value in _differing(phase.changes) if value is None]
    if phase.captures is not None:
        texts.append(f"may close: {', '.join(phase.captures) or 'none'}")
    if phase.releases:
        texts.append(f"releases: {', '.join(phase.releases)}")
    return [*texts, "controllers are reset"] if phase.reset else texts


def _differing(changes: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Iterate over the dotted paths and values of a phase's changes; a reference is a single value."""
    for key, value in changes.items():
        if isinstance(value, Mapping) and key != "reference":
            yield from _differing(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def check_phases(phases: Phases, grasps: Mapping[str, Any], bodies: list[str]) -> None:
    """Check the names in phases, that all phases can be reached, and that no cycle takes zero time.

    Args:
        phases, grasps: Sections of the scenario.
        bodies: Names of the robots and the target.

    Raises:
        ValueError: If a check fails; the message begins with the dotted path.
    """
    for name, phase in phases.items():
        if name == END:
            raise ValueError(
                f"phases.{END}: the name is reserved for the end of the simulation; rename the phase"
            )
        for key, named, allowed in _names(phase, [*phases, END], list(grasps), bodies):
            if named not in allowed:
                what = (
                    "phase"
                    if key in ("next", "on_timeout", "on_abort")
                    else "grasp"
                    if "settled" not in key
                    else "body"
                )
                raise ValueError(f"phases.{name}.{key}: no {what} {named!r}; {near_names(named, allowed)}")
        for grasp in (*(phase.captures or ()), *((phase.until and phase.until.captured) or ())):
            if grasps[grasp].capture is None and grasps[grasp].begins == "open":
                raise ValueError(f"phases.{name}: grasp {grasp!r} has no `capture`, so it never closes")
        released = {grasp for other in phases.values() for grasp in other.releases}
        for grasp in (phase.until and phase.until.released) or ():
            if grasps[grasp].release is None and grasp not in released:
                raise ValueError(
                    f"phases.{name}.until.released: {grasp!r} is never released; add a `release`, or list it "
                    "in a phase's `releases`"
                )
    for grasp, section in grasps.items():
        may_close = any(phase.captures is None or grasp in phase.captures for phase in phases.values())
        if section.begins == "open" and not may_close:
            raise ValueError(
                f"grasps.{grasp}.capture: never holds, for no phase names {grasp!r} in `captures`"
            )
    # every phase must be reachable from the first one
    first = next(iter(phases))
    reached = {first} | reached_from(first, phases)
    for name in phases:
        if name not in reached:
            earlier = list(phases)[list(phases).index(name) - 1]
            why = f"; {earlier!r} never ends" if not phases[earlier].ends else ""
            raise ValueError(
                f"phases.{name}: never reached{why}; lead to it by `next`, `on_timeout` or `on_abort`"
            )
    # a phase that waits for a grasp must begin with it closed, or permit its capture: sets of grasps that may
    # be closed at the begin and during each phase, propagated along the longest possible path
    follows, at_begin = _following(phases), {name: set[str]() for name in phases}
    at_begin[next(iter(phases))] = {name for name, grasp in grasps.items() if grasp.begins == "closed"}
    during = dict(at_begin)
    for name in [*phases] * len(phases):
        phase = phases[name]
        closing = grasps if phase.captures is None else phase.captures
        closes = {grasp for grasp in closing if grasps[grasp].capture is not None}
        during[name] = (at_begin[name] - set(phase.releases)) | closes
        for following in follows[name]:
            if following != END:
                at_begin[following] |= during[name]
    for name, phase in phases.items():
        for grasp in (phase.until and phase.until.captured) or ():
            if grasp not in during[name]:
                raise ValueError(
                    f"phases.{name}.until.captured: never holds, for {grasp!r} is open when the phase begins "
                    "and `captures` does not name it"
                )
    # no cycle of phases whose conditions are all satisfied already, so that no time would pass
    next_phases = successors(phases)
    for first in phases:
        name, cycle = first, list[str]()
        while name in phases and name not in cycle and _ends_at_once(phases[name]):
            cycle.append(name)
            name = next_phases[name][0]
        if name == first and cycle and not _contradict([phases[each] for each in cycle]):
            way = " -> ".join([*cycle, first])
            raise ValueError(f"phases.{first}: no time passes in {way}: each ends as soon as it begins")


def check_planned(names: list[str], phases: Phases) -> None:
    """Check that the phases of a plan are the scenario's first phases in their order.

    Raises:
        ValueError: If they are not; the message begins with the dotted path.
    """
    if not names:
        return
    for name in names:
        if name not in phases:
            hint = near_names(name, phases) if phases else "the scenario has no `phases`"
            raise ValueError(f"plan.phases.{name}: no phase {name!r}; {hint}")
    order, next_phases = list[str](), successors(phases)
    while len(order) < len(names):
        order.append(next_phases[order[-1]][0] if order else next(iter(phases)))
        if order[-1] == END:
            break
    for name, expected in zip(names, order, strict=True):
        if name != expected:
            raise ValueError(
                f"plan.phases.{name}: found where {expected!r} is in turn; plan the scenario's first phases, "
                "as they follow each other"
            )


def _names(
    phase: Phase, following: list[str], grasps: list[str], bodies: list[str]
) -> Iterator[tuple[str, str, list[str]]]:
    """Iterate over the names in a phase: key, name, and names allowed there."""
    for key, name in (("next", phase.next), ("on_timeout", phase.on_timeout), ("on_abort", phase.on_abort)):
        if name is not None:
            yield key, name, following
    until = phase.until or PhaseEnd(time=1.0)
    named = {"captures": phase.captures, "releases": phase.releases}
    named |= {"until.captured": until.captured, "until.released": until.released}
    for key, names in named.items():
        for name in names or ():
            yield key, name, grasps
    if until.settled is not None:
        yield "until.settled.of", until.settled.of, bodies


def _ends_at_once(phase: Phase) -> bool:
    """Whether a phase may end as soon as it begins, because its grasps are captured or released already."""
    until = phase.until
    return until is not None and (until.captured is not None or until.released is not None)


def _contradict(phases: list[Phase]) -> bool:
    """Whether one phase waits for the capture of a grasp and another for its release."""
    ends = [phase.until for phase in phases if phase.until is not None]
    captured = {name for until in ends for name in until.captured or ()}
    return any(name in captured for until in ends for name in until.released or ())
