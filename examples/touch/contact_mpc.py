r"""Predictive control of contacts: hands choose when, how far and how fast they close on a tumbling body.

For the scenario `touch`, whose hands otherwise wait for the corners of the cube; `compare.py` compares both.
In each period, candidates for the next approach of each hand are rolled out over the horizon with the scene's
own closed loop, contacts included, from the present state. The one with the least cost is begun, and replaced
in the next period by a better one:

$$ J = w_f \hat f + \frac{1}{T} \int_t^{t+T} c\,\mathrm{d}t + c(t + T), \qquad
   c = \sqrt{v^2 + (r \omega)^2} + w_g \sum_h \lvert d_h - d \rvert, \qquad
   \hat f = \left( \frac{1}{\tau} \int_0^{t+T} \sum_h \lvert f_h \rvert^4\,\mathrm{d}t \right)^{1/4}, $$

with the velocity v and the spin of the body relative to the hands, distances $d_h$ of the hands from it, and
forces $f_h$ on them; $\hat f$ is about the peak of the strongest strike, of length $\tau$. Its integral
begins with the simulation: contacts that are gentler than an earlier strike do not raise the peak and cost
nothing. If it began at t, every touch would have a price, and the hands would not push a slow body into the
cage. The candidates are drawn (random shooting); nothing is differentiated. The state is known exactly, the
friction is assumed.
"""

import math
from collections.abc import Collection
from typing import Literal

import casadi as ca
import numpy as np
from pydantic import Field

import spacerobot as sr
from spacerobot.elements import (
    Contribution,
    Output,
    Reference,
    RobotContext,
    RobotController,
    SectionContext,
    State,
    TimeProfile,
    quantity,
)
from spacerobot.scene import build_scene

APPROACH = ("begin", "duration", "first", "depth")
"""Numbers of an approach."""
STRIKE_S, FORCE_N, SMALL = 0.1, 10.0, 1e-6
"""Length of a strike, unit of forces in the integral, and what keeps the root of a square smooth."""


@sr.register
class Approach(Reference):
    """From one depth to another along a direction; `contact_mpc` sets the numbers in flight."""

    kind: Literal["approach"] = "approach"
    direction: tuple[float, float, float] = quantity(
        "1", "direction of depths, world axes", default=(0, 1, 0)
    )
    first: float = quantity("m", "depth until it begins", default=0.0)
    depth: float = quantity("m", "depth where it ends", default=0.0)
    begin: float = quantity("s", "when it begins", default=0.0)
    duration: float = quantity("s", "time it takes", default=1.0, gt=0)

    def moved(self, context: SectionContext) -> TimeProfile:
        """By the blend of fifth degree."""
        begin, duration, first, depth = (context.number(key) for key in APPROACH)
        s = ca.fmin(ca.fmax((context.time - begin) / duration, 0), 1)
        along, way = ca.DM(self.direction), depth - first
        return TimeProfile(
            along * (first + way * s**3 * (10 - 15 * s + 6 * s**2)),
            along * way * 30 * (s * (1 - s)) ** 2 / duration,
            along * way * 60 * s * (1 - s) * (1 - 2 * s) / duration**2,
        )


@sr.register
class ContactMpc(RobotController):
    """Begin the approaches of the hands whose predicted contacts slow the body at the least cost."""

    kind: Literal["contact_mpc"] = "contact_mpc"
    period: float = quantity("s", "time between two choices", default=0.25, gt=0)
    horizon: float = quantity("s", "time that is predicted", default=1.5, gt=0)
    candidates: int = Field(default=32, ge=3, description="number of approaches that are predicted")
    depth: float = quantity("m", "largest depth of an approach", default=0.06, gt=0)
    slowest: float = quantity("s", "longest time of an approach", default=4.0, gt=0)
    friction: float = quantity("1", "coefficient of friction that predictions assume", default=0.2, ge=0)
    radius: float = quantity("m", "lever r at which the spin counts as a velocity", default=0.2, gt=0)
    distance: float = quantity("m", "distance d of a hand from the body in the cage", default=0.23, ge=0)
    force_weight: float = quantity("m/(N s)", "weight of the peak force", default=0.01, ge=0)
    gap_weight: float = quantity("1/s", "weight of the distances", default=0.5, ge=0)
    frame: str = Field(default="body", description="link of the target that is touched")
    sampled: None = Field(default=None, description="none: it is periodic by itself")
    held: bool = Field(default=False, description="none: filled in by the simulation")

    @property
    def update_scheme(self) -> str:
        """Choices are made in Python."""
        return f"{__name__}:ContactScheme"

    def reads(self) -> set[str]:
        """Wrenches on the tips."""
        return {"tip_force", "tip_torque"}

    def build(self, robot: RobotContext) -> Contribution:
        """Parts of the cost: two integrals, and the present cost."""
        if not self.held:
            raise sr.SpaceRobotError(
                "kind contact_mpc chooses in Python, which has no gradient: simulations, batches and "
                "campaigns call it; gradients, searches and margins do not",
                where=robot.context.path,
            )
        plant, number = robot.plant, robot.context.number
        link = int(plant.model.getFrameId(f"target/{self.frame}"))
        place, (velocity, spin) = plant.placement(link)[1], plant.velocity(link)
        count = len(robot.tips)
        moving = velocity - sum(tip.velocity for tip in robot.tips) / count
        turning = number("radius") * (spin - sum(tip.angular_velocity for tip in robot.tips) / count)
        speed = ca.sqrt(ca.sumsqr(moving) + ca.sumsqr(turning) + SMALL)
        apart = [ca.norm_2(place - tip.position) - number("distance") for tip in robot.tips]
        cost = speed + number("gap_weight") * sum(ca.sqrt(gap**2 + SMALL) for gap in apart)
        forces = [ca.sumsqr(tip.measured_wrench()[:3]) / FORCE_N**2 for tip in robot.tips]
        rates = {"effort": sum(force**2 for force in forces), "waited": cost}
        states = [
            State(f"{robot.name}/{robot.key}.{name}", ca.SX.sym(name), ca.SX(1, 1), rate)
            for name, rate in rates.items()
        ]
        values = {"cost": cost} | {name: state.symbol for name, state in zip(rates, states, strict=True)}
        outputs = tuple(
            Output(
                f"{robot.key}_input_{name}",
                value,
                "1",
                f"{name} of contacts",
                f"{name}_of",
                robot.name,
                False,
            )
            for name, value in values.items()
        )
        return Contribution(states=tuple(states), outputs=outputs)

    def words(self) -> str:
        """Period and horizon."""
        return f"contacts chosen every {self.period:g} s, {self.horizon:g} s ahead"


class ContactScheme:
    """See :class:`spacerobot.updates.scheme.UpdateScheme`."""

    measures: dict[str, str] = {}  # noqa: RUF012 (the interface)

    def __init__(self, scene, robot, key):
        self.scene, self.robot, self.key = scene, robot, key
        self.config = scene.scenario.robots[robot].controllers[key]
        self.duration_s, self.period_s = scene.scenario.simulation.duration, self.config.period
        choices = math.ceil(self.duration_s / self.period_s)
        self.prediction_s = choices * self.config.candidates * self.config.horizon
        self.intervals = {"the period of contact_mpc": self.config.period}
        self.summary = self.config.words()

    @classmethod
    def of(cls, scene, vary: Collection[str] = ()):
        """The scene, whose only such controller may act."""
        del vary
        robots = scene.scenario.robots.items()
        (found,) = [
            (name, key)
            for name, robot in robots
            for key, one in robot.controllers.items()
            if one.kind == "contact_mpc"
        ]
        path = f"robots.{found[0]}.controllers.{found[1]}.held"
        return cls(build_scene(scene.scenario, {path: True}, source=scene.source), *found)

    def check_batch(self) -> None:
        """Batches are allowed."""

    def start(self, plant, workers, backend, notify):
        """Choices for some simulations."""
        del workers, backend, notify
        return ContactChoices(self, plant)


class ContactChoices:
    """Approaches of N simulations, chosen between the pieces of their rollouts."""

    def __init__(self, scheme, plant):
        self.scheme, self.plant = scheme, plant
        count, places = len(plant.start), {path: i for i, path in enumerate(plant.loop.parameter_paths)}
        self.next, self.faults = np.zeros(count), [None] * count
        robot = f"robots.{scheme.robot}"
        self._hands = np.array(  # (hands, numbers of an approach)
            [
                [places[f"{robot}.tips.{tip}.reference.{key}"] for key in APPROACH]
                for tip, section in scheme.scene.scenario.robots[scheme.robot].tips.items()
                if section.reference.kind == "approach"
            ]
        )
        self._frictions = [
            places[path]
            for path in (f"contacts.{name}.friction" for name in scheme.scene.scenario.contacts)
            if path in places
        ]

    def candidates(self, update: int, now: float, depths):
        """Approaches (rows, candidates, hands, numbers) from the present depths (rows, hands).

        The same are drawn for every simulation: a hand may wait, and then close or open, slowly or fast.
        """
        config, generator = self.scheme.config, np.random.default_rng(update)
        count, hands = config.candidates, len(self._hands)
        uniforms = generator.random((count, hands, 3))
        uniforms[count // 2 :, 1:] = uniforms[count // 2 :, :1]  # of one half the hands move together
        approaches = np.empty((len(depths), count, hands, len(APPROACH)))
        approaches[..., 0] = now + config.horizon / 2 * np.maximum(0.0, 2 * uniforms[..., 0] - 1)
        approaches[..., 1] = 0.4 * (config.slowest / 0.4) ** uniforms[..., 1]
        approaches[..., 2] = depths[:, None, :]
        approaches[..., 3] = config.depth * np.clip(1.4 * uniforms[..., 2] - 0.2, 0, 1)
        approaches[:, 1, :, 3] = depths  # stay
        return approaches

    def update(self, rows):
        """Choose the approaches of some simulations that are at the same time."""
        plant, config, key = self.plant, self.scheme.config, self.scheme.key
        update = round(self.next[rows[0]] / config.period)
        now, count = update * config.period, config.candidates
        present = plant.parameters[rows][:, self._hands]
        begin, duration, first, depth = np.moveaxis(present, -1, 0)
        s = np.clip((now - begin) / duration, 0, 1)
        approaches = self.candidates(update, now, first + (depth - first) * s**3 * (10 - 15 * s + 6 * s**2))
        approaches[:, 0] = present  # go on
        predicted = np.repeat(plant.parameters[rows], count, axis=0)
        predicted[:, self._hands] = approaches.reshape(-1, *self._hands.shape)
        predicted[:, self._frictions] = config.friction
        ends = plant.roll(predicted, np.repeat(plant.start[rows], count, axis=0), config.horizon)
        inputs = {
            name: np.array([end[f"{key}_input_{name}"] for end in ends.inputs]).reshape(-1, count)
            for name in ("cost", "effort", "waited")
        }
        started = [np.ravel(plant.inputs[row].get(f"{key}_input_waited", [0.0])) for row in rows]
        peak = FORCE_N * (inputs["effort"].clip(0) / STRIKE_S) ** 0.25
        waited = (inputs["waited"] - started) / config.horizon
        cost = config.force_weight * peak + waited + inputs["cost"]
        best = np.nanargmin(np.where(np.isfinite(cost), cost, 1e300), axis=1)
        plant.parameters[rows[:, None, None], self._hands] = approaches[np.arange(len(rows)), best]
        self.next[rows] = (update + 1) * config.period

    def finish(self) -> None:
        """Nothing."""

    def summary(self):
        """No entries."""
        return {}

    def measures(self):
        """No statistics."""
        return {}
