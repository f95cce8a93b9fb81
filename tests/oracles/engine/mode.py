"""What holds between two events: the phase, the laws of its controllers, and what leads each tip."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from spacerobot.common.errors import ScenarioError
from spacerobot.scenario import Robot, Scenario
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneReference
from tests.oracles.engine.actuation import Delivery, deliveries
from tests.oracles.engine.kinematics import Kinematics
from tests.oracles.engine.life import Life
from tests.oracles.engine.references import Begins, Leads, Motion, leading
from tests.oracles.engine.robot_law import RobotLaw, robot_law
from tests.oracles.engine.tip_control import Channel, tip_law


@dataclass(frozen=True)
class Lead:
    """What leads a tip since a time [s]."""

    reference: SceneReference
    since: float
    leads: Leads

    def at(self, t: float, within: float, kinematics: Kinematics) -> Motion:
        """Motion at time t [s], by the piece that holds at ``within`` [s]."""
        return self.leads.at(t - self.since, within - self.since, kinematics)

    @property
    def breakpoints(self) -> Iterator[float]:
        """Times at which it is not smooth [s]."""
        for end in (*self.reference.config.jumps(), *self.leads.ends):
            yield self.since + end


@dataclass(frozen=True)
class Mode:
    """What holds between two events.

    Attributes:
        phase: Its name, empty where there are no phases.
        lives: Of the grasps that open or close, by name.
        leads: What leads the tips, by label.
        began_at: When the phase began [s].
        on: Switches of actuators that are on.
    """

    phase: str
    lives: Mapping[str, Life]
    leads: Mapping[str, Lead]
    began_at: float = 0.0
    on: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Laws:
    """Controllers as they are in one phase; the states of all phases' are the same.

    Attributes:
        scene: The scene with the numbers of the phase.
        keys: Places of channels and controllers in the scenario, in this order.
        rest: Which of the channels and controllers, in this order, rest.
        deliveries: Actuators, in the order in which they act.
    """

    scene: Scene
    keys: tuple[str, ...]
    channels: tuple[Channel, ...]
    controllers: tuple[RobotLaw, ...]
    rest: tuple[bool, ...]
    deliveries: tuple[Delivery, ...]

    @property
    def blocks(self) -> tuple[Channel | RobotLaw, ...]:
        """Channels and controllers."""
        return (*self.channels, *self.controllers)


def laws_of(scene: Scene) -> dict[str, Laws]:
    """Laws by the phase's name; under no name where there are no phases.

    Raises:
        ScenarioError: If an element, or what a phase asks for, has no second writing.
    """
    base = _laws(scene)
    if not scene.scenario.phases:
        return {"": base}
    found = {}
    for name in scene.scenario.phases:
        own = _laws(_during(scene, scene.scenario.during(name)))
        found[name] = _completed(own, base, name)
    return found


def _completed(own: Laws, base: Laws, phase: str) -> Laws:
    """Laws of a phase with the scenario's own blocks, at rest, for those that the phase does without."""
    first = dict(zip(base.keys, base.blocks, strict=True))
    blocks: dict[str, Any] = dict(zip(own.keys, own.blocks, strict=True))
    for key, block in blocks.items():
        if key not in first or first[key].state_names != block.state_names:
            raise _refused(base.scene, f"phases.{phase}.robots", "other states of a controller")
    every = [blocks.get(key, block) for key, block in first.items()]
    cut = len(base.channels)
    return Laws(
        own.scene,
        base.keys,
        tuple(every[:cut]),
        tuple(every[cut:]),
        tuple(key not in blocks for key in base.keys),
        own.deliveries,
    )


def _refused(scene: Scene, where: str, what: str) -> ScenarioError:
    return ScenarioError(
        f"found {what!r}, which has no second writing, so the pinocchio engine cannot check it; take "
        "`simulation.engine: casadi`",
        source=scene.source,
        where=where,
    )


def _laws(scene: Scene) -> Laws:
    channels = {
        f"{tip.path}.{key}": tip_law(controller, scene, tip, key)
        for tip in scene.tips
        for key, controller in tip.config.elements()
    }
    controllers = {
        f"{body.path}.{key}": robot_law(controller, scene, body, key)
        for body in scene.robots
        if isinstance(body.config, Robot)
        for key, controller in body.config.elements()
    }
    keys = (*channels, *controllers)
    laws = tuple(channels.values()), tuple(controllers.values())
    return Laws(scene, keys, *laws, (False,) * len(keys), deliveries(scene))


def _during(scene: Scene, scenario: Scenario) -> Scene:
    """Scene with the sections of another scenario of the same bodies, tips and grasps."""
    bodies = {}
    for body in scene.bodies:
        own = scenario.target if body.path == "target" else scenario.robots[body.name]
        if own is None:  # a target that a phase takes away cannot be written
            raise ScenarioError("found none", source=scene.source, where="target")
        bodies[body.name] = replace(body, config=own)
    tips = {
        tip.label: replace(
            tip,
            body=bodies[tip.body.name],
            config=scenario.robots[tip.body.name].tips[tip.label.partition("/")[2]],
        )
        for tip in scene.tips
    }
    grasps = tuple(
        replace(grasp, tip=tips[grasp.tip.label], config=scenario.grasps[grasp.name])
        for grasp in scene.grasps
    )
    return replace(scene, bodies=tuple(bodies.values()), tips=tuple(tips.values()), grasps=grasps)


def led(
    scene: Scene,
    phase: str,
    now: Kinematics,
    t: float,
    before: Mapping[str, Lead],
) -> dict[str, Lead]:
    """What leads each tip in a phase that begins at time t [s]; a reference that led before goes on."""
    found = {}
    from_reference = bool(phase) and scene.scenario.phases[phase].begins_at == "reference"
    for tip in scene.tips:
        reference, old = (
            next(r for r in tip.references if not phase or phase in r.phases),
            before.get(tip.label),
        )
        if old is not None and old.reference is reference:
            found[tip.label] = old
            continue
        ahead = old.at(t, t, now) if old is not None and from_reference else None
        begins = Begins(scene, tip, now, reference.from_target, ahead)
        found[tip.label] = Lead(reference, t, leading(reference.config, begins))
    return found
