"""What may happen next to a scene, written again: guards that rise above zero, and what follows."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.scenario.phases import END, Limit, Settled, successors
from spacerobot.scene import SceneGrasp
from spacerobot.scene.scene import SceneContact
from tests.oracles.engine.contacts import Touch, dissipation_of
from tests.oracles.engine.engine import Engine
from tests.oracles.engine.grasps import Coupling, grasp_of
from tests.oracles.engine.impact import strike
from tests.oracles.engine.life import Life, draws, room
from tests.oracles.engine.mode import Mode, Touching, led
from tests.oracles.engine.moment import Event, Moment
from tests.oracles.engine.outputs import outputs_at
from tests.oracles.engine.sight import Holding, holding

KINDS = (
    *("captured", "entered", "left", "drawn", "released", "slipped"),
    *("touched", "parted", "loosened", "pressed"),
    *("phase", "end", "settling", "moving", "reference"),
    *("saturated", "freed", "control", "cut", "measured"),
)
"""Kinds of events that have a second writing; instants at which references jump are known beforehand."""


def armed(engine: Engine) -> tuple[Event, ...]:
    """What may happen in the engine's present mode, in the order in which it does at one instant."""
    living = [grasp for grasp in engine.now.scene.grasps if grasp.name in engine.mode.lives]
    lives = [event for grasp in living for event in _life(engine, grasp)]
    contacts = [
        event
        for contact in engine.scene.contacts
        for place in range(len(contact.pairs))
        for event in _pair(engine, contact, place)
    ]
    phases = _phase(engine) if engine.mode.phase else ()
    return (*lives, *contacts, *_turns(engine), *_measured(engine), *phases)


def happen(engine: Engine, event: Event, moment: Moment) -> Array:
    """Put the engine into the mode behind an event; the state afterwards (nx,)."""
    if event.then is None:
        return moment.x
    x, before = moment.x.copy(), engine.mode
    taken = 0.0 if event.springs is None else _stored(moment, event.springs)
    engine.mode = event.then(moment)
    if event.state is not None:
        x = event.state(Moment(engine, moment.t, moment.x, moment.within))
    if event.impact:
        struck = strike(engine, moment.kinematics, moment.t)
        x[engine.model.nq : engine.model.nq + engine.model.nv] = struck.velocity
        taken += struck.loss
        lives = dict(engine.mode.lives)
        for name, impulse in struck.impulses.items():
            if name in lives:
                life = lives[name]
                lives[name] = replace(
                    life, impulse=life.impulse + impulse[:3], couple=life.couple + impulse[3:]
                )
        engine.mode = replace(engine.mode, lives=lives)
    if "event" in engine.works:
        x[len(x) - len(engine.works) + engine.works.index("event")] += taken
    if engine.mode.phase != before.phase and engine.scene.scenario.phases[engine.mode.phase].reset:
        first, own = engine.model.nq + engine.model.nv, engine.first_states(moment.kinematics, moment.t)
        x[first : first + len(own)] = own
    return x


def _stored(moment: Moment, grasp: SceneGrasp) -> float:
    found = grasp_of(grasp.config, moment.engine.scene, grasp, moment.relative(grasp))
    return found.energy if isinstance(found, Coupling) else 0.0


def _turns(engine: Engine) -> Iterator[Event]:
    """Switches of actuators that may turn; which there are does not depend on the state."""
    first = engine.x0 if engine.now.deliveries else None
    if first is None:
        return
    for k, one in enumerate(engine.instant(0.0, first).solution.delivered):
        for j, turn in enumerate(one.turns):
            turned = {name for name, value in turn.sets.items() if (name in engine.mode.on) != value}
            if not turned and turn.states is None:
                continue
            on = engine.mode.on.symmetric_difference(turned)

            def guard(moment: Moment, k: int = k, j: int = j) -> float:
                return moment.instant.solution.delivered[k].turns[j].guard

            def then(_: Moment, on: frozenset[str] = on) -> Mode:
                return replace(engine.mode, on=on)

            def state(moment: Moment, k: int = k, j: int = j) -> Array:
                x, states = moment.x.copy(), moment.instant.solution.delivered[k].turns[j].states
                if states is not None:
                    x[engine.driven(k)] = states()
                return x

            jumps = state if turn.states is not None else None
            yield Event(turn.name, turn.kind, turn.who, guard, then, state=jumps)


def _measured(engine: Engine) -> Iterator[Event]:
    """Sensors that measure at instants."""
    for sensor in holding(engine.now.scene):
        due = engine.mode.held[sensor.name].due

        def then(moment: Moment, sensor: Holding = sensor) -> Mode:
            return engine.mode.with_measured(sensor, moment.kinematics)

        name, who = f"{sensor.name}.measured", sensor.sight.tip.label
        yield Event(name, "measured", who, functools.partial(_since, due), then)


def _since(due: float, moment: Moment) -> float:
    return moment.t - due


def _life(engine: Engine, grasp: SceneGrasp) -> Iterator[Event]:
    """What may happen to a grasp."""
    life = engine.mode.lives[grasp.name]
    if life.closed:
        yield from _held(engine, grasp, life)
    else:
        yield from _open(engine, grasp, life)


def _becomes(engine: Engine, grasp: SceneGrasp, **changes: object) -> Callable[[Moment], Mode]:
    life = replace(engine.mode.lives[grasp.name], **changes)  # type: ignore[arg-type]
    return lambda _: engine.mode.with_life(grasp.name, life)


def _open(engine: Engine, grasp: SceneGrasp, life: Life) -> Iterator[Event]:
    """How an open grasp comes to be captured."""
    capture, name, phase = grasp.config.capture, grasp.name, engine.mode.phase
    allowed = engine.scene.scenario.phases[phase].captures if phase else None
    free = not life.released and (allowed is None or name in allowed)
    if capture is None:
        return

    def inside(moment: Moment) -> float:
        return room(engine.scene, capture, moment.relative(grasp))

    def closes(moment: Moment) -> Mode:
        relative = moment.relative(grasp)
        return engine.mode.with_life(name, life.captured(engine.scene, capture, relative, moment.t))

    def captured(guard: Callable[[Moment], float]) -> Event:
        return Event(f"{name}.captured", "captured", name, guard, closes, grasp.config.is_rigid)

    at, dwell = capture.at, capture.dwell
    if at is not None:
        if free:
            yield captured(lambda m: m.t - at)
    elif not dwell:
        if free:
            yield captured(inside)
    elif not life.inside:
        if free:

            def enters(moment: Moment) -> Mode:
                return engine.mode.with_life(name, replace(life, inside=True, entered_at=moment.t))

            yield Event(f"{name}.entered", "entered", name, inside, enters)
    else:
        leaves = _becomes(engine, grasp, inside=False)
        yield Event(f"{name}.left", "left", name, lambda m: -inside(m), leaves)
        if free:
            yield captured(lambda m: m.t - life.entered_at - dwell)


def _held(engine: Engine, grasp: SceneGrasp, life: Life) -> Iterator[Event]:
    """How a grasp that holds is drawn in, lets go or slips off."""
    name, release, phase = grasp.name, grasp.config.release, engine.mode.phase
    if life.drawing and draws(grasp):
        until = life.captured_at + life.draw_time
        still = _becomes(engine, grasp, drawing=False)
        yield Event(f"{name}.drawn", "drawn", name, lambda m: m.t - until, still)

    def opened(how: str, kind: str, guard: Callable[[Moment], float]) -> Event:
        opens = engine.mode.with_life(name, life.opened())
        return Event(f"{name}.{how}", kind, name, guard, lambda _: opens, springs=grasp)

    if release is not None and release.at is not None:
        at = release.at
        yield opened("released", "released", lambda m: m.t - at)
    if phase and name in engine.scene.scenario.phases[phase].releases:
        yield opened("release_commanded", "released", lambda _: 1.0)
    for place, key in enumerate(("force", "torque")):
        most = None if release is None else getattr(release, key)
        if most is not None:

            def pulled(moment: Moment, place: int = place, most: float = most) -> float:
                load = _load(moment, grasp)[place]
                return float(load @ load) / most**2 - 1

            yield opened(f"slipped_by_{key}", "slipped", pulled)


def _load(moment: Moment, grasp: SceneGrasp) -> tuple[Array, Array]:
    """Force and torque of a grasp on the target."""
    found = grasp_of(grasp.config, moment.engine.scene, grasp, moment.relative(grasp))
    if isinstance(found, Coupling):
        return found.force, found.torque
    wrenches = moment.instant.solution.wrenches
    return next((force, torque) for own, _, force, torque in wrenches if own.name == grasp.name)


def _pair(engine: Engine, contact: SceneContact, place: int) -> Iterator[Event]:
    """Where a pair of shapes touches and parts, and where its force ends because it would pull."""
    name = f"{contact.name}.{place + 1}" if len(contact.pairs) > 1 else contact.name
    now, taken = engine.mode.touching.get(name), dissipation_of(contact.config)

    def event(kind: str, becomes: Touching | None, guard: Callable[[Touch], float]) -> Event:
        """One of this pair, and how it touches afterwards."""
        after = engine.mode.with_touching(name, becomes)
        return Event(
            f"{name}.{kind}",
            kind,
            contact.name,
            lambda moment: guard(moment.touches[contact.name][place]),
            lambda _: after,
        )

    if now is None:
        yield event("touched", "pressed", lambda touch: -touch.gap)
        return
    yield event("parted", None, lambda touch: touch.gap)
    if taken and now == "pressed":
        yield event("loosened", "loose", lambda touch: taken * touch.opening - 1)
    elif taken:
        yield event("pressed", "pressed", lambda touch: 1 - taken * touch.opening)


def _phase(engine: Engine) -> Iterator[Event]:
    """How the present phase ends."""
    name, mode = engine.mode.phase, engine.mode
    phase, (following, on_timeout) = (
        engine.scene.scenario.phases[name],
        successors(engine.scene.scenario.phases)[name],
    )
    until = phase.until
    if until is not None and until.settled is not None and until.settled.dwell:
        settled, room_left = until.settled, _slowly(engine, until.settled)
        if mode.settling:
            moves = replace(mode, settling=False)
            yield Event(f"{name}.moving", "moving", settled.of, lambda m: -room_left(m), lambda _: moves)
        else:

            def settles(moment: Moment) -> Mode:
                return replace(mode, settling=True, settled_at=moment.t)

            yield Event(f"{name}.settling", "settling", settled.of, room_left, settles)
    for how, guard in _conditions(engine):
        follows = {"timeout": on_timeout, "abort": phase.on_abort}.get(how, following)
        if follows == END:
            yield Event(f"{name}.{how}", "end", name, guard, None)
        else:
            yield Event(f"{name}.{how}", "phase", follows, guard, functools.partial(_next, engine, follows))


def _next(engine: Engine, name: str, moment: Moment) -> Mode:
    """Another phase begins."""
    lives, mode = dict(engine.mode.lives), engine.mode
    for grasp in engine.scene.scenario.phases[name].captures or ():
        if grasp in lives:
            lives[grasp] = replace(lives[grasp], released=False)
    own = engine.laws[name].scene
    leads = led(own, name, moment.kinematics, moment.t, mode.leads, mode.held)
    return replace(
        mode, phase=name, lives=lives, leads=leads, began_at=moment.t, settling=False, settled_at=0.0
    )


def _conditions(engine: Engine) -> Iterator[tuple[str, Callable[[Moment], float]]]:
    """Ways in which the present phase may end, with their guards."""
    mode = engine.mode
    phase = engine.scene.scenario.phases[mode.phase]
    until, latest = phase.until, phase.timeout
    if until is not None and until.time is not None:
        time = until.time
        yield "time", lambda m: m.t - mode.began_at - time
    elif until is not None and until.settled is not None:
        dwell = until.settled.dwell
        if not dwell:
            yield "settled", _slowly(engine, until.settled)
        elif mode.settling:
            yield "settled", lambda m: m.t - mode.settled_at - dwell
    elif until is not None and until.limit is not None:
        yield "limit", _passing(engine, until.limit)
    elif until is not None and until.captured:
        if all(engine.is_closed(grasp) for grasp in until.captured):
            yield "captured", lambda _: 1.0
    elif until is not None and all(
        grasp in mode.lives and mode.lives[grasp].released for grasp in until.released or ()
    ):
        yield "released", lambda _: 1.0
    if phase.abort is not None:
        yield "abort", _passing(engine, phase.abort)
    if latest is not None:
        yield "timeout", lambda m: m.t - mode.began_at - latest


def _slowly(engine: Engine, settled: Settled) -> Callable[[Moment], float]:
    """Above zero where a body hardly moves."""
    frame = engine.scene.body(settled.of).root_frame

    def guard(moment: Moment) -> float:
        motion = moment.kinematics.frame(frame).velocity
        rates = [float(np.linalg.norm(motion[:3])) / settled.speed]
        if settled.spin_deg is not None:
            rates.append(float(np.degrees(np.linalg.norm(motion[3:]))) / settled.spin_deg)
        return 1 - max(rates) ** 2

    return guard


def _passing(engine: Engine, limit: Limit) -> Callable[[Moment], float]:
    """Above zero where an output has passed its limit."""
    scene = engine.scene
    labels = {
        "tip": [tip.label for tip in scene.tips],
        "body": [body.name for body in scene.bodies],
        "grasp": [grasp.name for grasp in scene.grasps],
        "contact": [contact.name for contact in scene.contacts],
    }.get(limit.output.partition("_")[0], [])
    if limit.of is not None and limit.of not in labels:
        raise ScenarioError(f"no {limit.of!r}; {near_names(limit.of, labels)}", source=scene.source)
    place = labels.index(limit.of) if limit.of is not None else 0

    def guard(moment: Moment) -> float:
        """A number against the limit, or the square of a vector's size against that of the limit."""
        value = outputs_at(engine, moment.t, moment.x, moment.within)[limit.output]
        own = value.reshape(len(labels), -1)[place] if limit.of is not None else value
        if limit.above is not None:
            sign, most = 1.0, limit.above
        else:
            sign, most = -1.0, limit.below or 0.0
        if len(own) == 1:
            return sign * float(own[0] - most)
        return sign * (float(own @ own) - most * abs(most))

    return guard
