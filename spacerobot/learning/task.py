"""A scene as a task of reinforcement learning: what one environment and many of them have in common."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Literal, TypedDict, Unpack, get_type_hints

import numpy as np
from numpy.typing import NDArray

from spacerobot.closedloop import ClosedLoop
from spacerobot.closedloop.loop_cache import cached_closed_loop
from spacerobot.common.arrays import Array
from spacerobot.common.errors import ScenarioError, SpaceRobotError, near_names
from spacerobot.common.files import StrPath
from spacerobot.elements.controllers.controller import INPUT
from spacerobot.learning.actions import (
    KEY,
    Limits,
    is_number_of_scenario,
    select_actions,
    with_policy,
)
from spacerobot.learning.registration import ENVIRONMENTS
from spacerobot.learning.rewards import DIVERGED, OutputPart, Outputs, Reward, RewardFunction
from spacerobot.quantities import Quantity, quantities
from spacerobot.rollout import Measure, Measures, build_rollout, final
from spacerobot.rollout.resumable_loop import resumed, resumed_measures
from spacerobot.scene import Scene, build_scene, to_scene
from spacerobot.updates.plant import ROUNDING
from spacerobot.updates.scheme import update_schemes

MEASUREMENTS = (
    "joint_position",
    "joint_rate",
    "base_position",
    "base_orientation",
    "base_velocity",
    "base_spin",
)
"""Measurements of all robots, as their sensors show them, by short names."""
DEFAULT_OBSERVATIONS = (
    *MEASUREMENTS,
    "tip_position",
    "tip_velocity",
    "body_position",
    "body_rotation",
    "grasp_gap",
)
"""Observations where none are named, those that the scene has."""
EVENT, QUANTITY = "events.", "quantities."
"""Beginnings of the keys of a reward that name events and registered quantities."""
OUTPUT = "output."
"""Beginning of the names of measures that are outputs at the end of a step."""
ALIASES = {"collided": "touched"}
"""Kinds of events under a further name."""
NOISE_SEED = "simulation.noise_seed"
"""Seed of the sensors' noise, new in each episode."""
EPISODES = 1000.0
"""Expected number of episodes, for the choice between compiling and interpreting."""
JITTER_FREQUENCY_HZ = 1.0
"""Corner frequency of the high pass of the quantity ``jitter``."""


class EnvironmentOptions(TypedDict, total=False):
    """Options of an environment.

    Attributes:
        changes: Changes to the scenario, by dotted path.
        observations: Names of outputs (``grasp_gap``, or ``grasp_gap[left]`` for one label), or a mapping to
            their greatest magnitudes, at which observations are clipped; measurements of the joints and
            bases, poses of bodies and gaps of grasps by default.
        actions: Names or patterns of joints (``servicer/left_*``), of parts of base wrenches
            (``servicer/base.torque``) and of numbers of the scenario (``robots.*.tips.*.pid.kp``), or a
            mapping to their limits: a greatest magnitude, or a lowest and a highest value; all joints by
            default. The actions -1 and 1 are the limits.
        reward: Weights by the name of an output y (weight times |y| times the period), of
            ``quantities.NAME`` (weight times the increase in the step), of ``action`` (weight times the
            squared norm of the action times the period) and of ``events.KIND`` or ``events.NAME`` (bonus for
            each), or a function; minus ``grasp_gap`` and 10 for a capture by default.
        metrics: Names of registered quantities in the ``info`` at the end of an episode, in addition to
            those of the reward.
        terminations: Kinds or names of events that end an episode, such as ``captured``, ``collided``,
            ``released``, ``slipped``.
        limits: Greatest magnitudes of components of outputs, beyond which an episode ends.
        draws: Uncertain parameters of the initial state, as in a scenario's section
            ``campaign.parameters``, which they replace.
        period: Time between two actions [s].
        duration: Duration of an episode, at which it is truncated [s]; that of the scenario by default.
        feedback: Whether the scenario's controllers act in addition to the actions; by default where an
            action is a number of the scenario.
        backend: ``auto``, ``compiled`` or ``interpreted``.
    """

    changes: Mapping[str, Any]
    observations: Sequence[str] | Mapping[str, float]
    actions: Sequence[str] | Mapping[str, Limits]
    reward: Mapping[str, float] | RewardFunction
    metrics: Sequence[str]
    terminations: Sequence[str]
    limits: Mapping[str, float]
    draws: Mapping[str, Mapping[str, Any]]
    period: float
    duration: float
    feedback: bool
    backend: Literal["auto", "compiled", "interpreted"]


class SceneTask:
    """Spaces, reward, terminations and initial states of a scene, with the rollout of its steps.

    Attributes:
        scene: Scene with a policy for each robot.
        loop: Its closed loop, with the states that quantities need.
        rollout: Rollout of the resumable loop over one period.
        period, duration, steps: Time between two actions [s], duration of an episode [s], and its steps.
        observation_names, action_names: Name of each component.
        high: Bounds of the observations (n,).
        drawn: Indices of the drawn parameters.

    Args:
        scenario: A scene, the name or file of its scenario, or the name of an environment that ships.
        many: Whether batches are rolled out, instead of one simulation at a time.
        **options: See :class:`EnvironmentOptions`.

    Raises:
        ScenarioError: If the scene has no such outputs, actions or events, or Python updates controllers.
    """

    def __init__(
        self, scenario: Scene | StrPath, *, many: bool = False, **options: Unpack[EnvironmentOptions]
    ) -> None:
        from optim.campaign.sampling.parameter_space import gain_set

        if isinstance(scenario, str) and scenario in ENVIRONMENTS:
            shipped = dict(ENVIRONMENTS[scenario])
            scenario = shipped.pop("scenario", scenario)
            options = {**shipped, **options}  # type: ignore[typeddict-item]
        original, self._options = to_scene(scenario), options
        if options.get("changes"):
            original = build_scene(original.scenario, options["changes"], source=original.source)
        allowed = get_type_hints(EnvironmentOptions)
        for name in options:
            if name not in allowed:
                raise original.error(f"found the option '{name}', {near_names(name, allowed)}", "")
        self.period = float(options.get("period", 0.1))
        if not self.period > 0:
            raise original.error(f"period: found {self.period:g}, allowed: > 0 s", "")
        duration = options.get("duration", original.scenario.simulation.duration)
        changes: dict[str, Any] = {"simulation.duration": float(duration)}
        if "draws" in options:
            changes["campaign"] = {"parameters": options["draws"]}
        changed = build_scene(original.scenario, changes, source=original.source)
        if changed.scenario.campaign is not None:
            changed = gain_set(changed, {})
        acted = [name for name in options.get("actions") or () if is_number_of_scenario(name)]
        feedback = options.get("feedback", bool(acted))
        self.scene = with_policy(changed, self.period, feedback=feedback)
        if len(update_schemes(self.scene)) > 1 or self._has_other_updates():
            message = "feedback: controllers with a Python update cannot act in an environment"
            raise original.error(message, "")
        simulation = self.scene.scenario.simulation
        self.duration = simulation.duration
        self.steps = max(1, int(np.ceil(self.duration / self.period * (1 - ROUNDING))))
        actions = select_actions(self.scene, options.get("actions"))
        self._prepare_draws(changed)
        closed = self._closed_loop([one.name for one in actions if not one.robot])
        self._prepare_observations(closed)
        self._prepare_reward(closed)
        measures = self._measures(closed)
        self._prepare_actions(actions)
        self.sample_s = min(self.period, simulation.output_step or self.period)
        self.rollout = build_rollout(
            resumed(self.loop),
            duration_s=self.period,
            step_s=simulation.step,
            output_step_s=self.sample_s,
            tolerance=simulation.tolerance,
            method=simulation.method,
            backend=options.get("backend", "auto"),
            measures=resumed_measures(self.loop, measures),
            many=many,
            rollouts=EPISODES * self.steps,
        )

    def _has_other_updates(self) -> bool:
        robots = self.scene.scenario.robots.values()
        return any(
            one.update_scheme and key != KEY for robot in robots for key, one in robot.controllers.items()
        )

    def _prepare_draws(self, scene: Scene) -> None:
        """Distribution of the initial states: the campaign of the scene with its controllers."""
        from optim.campaign.sampling.parameter_space import resolve_space

        self._campaign = scene.scenario.campaign
        self._space = None if self._campaign is None else resolve_space(scene, self._campaign)

    def _closed_loop(self, acted: Sequence[str]) -> ClosedLoop:
        """Closed loop that depends on the numbers that actions and draws set.

        Exact zeros are structural unless they are named. Draws of controllers that were removed are left out.
        """
        varied_paths = () if self._space is None else self._space.paths
        loop = cached_closed_loop(self.scene, acted)
        zeros = [path for path in varied_paths if path not in loop.parameter_paths]
        while zeros:
            try:
                loop = cached_closed_loop(self.scene, [*acted, *zeros])
                break
            except ScenarioError as fault:
                if fault.where not in zeros:
                    raise
                zeros.remove(fault.where)
        places = {path: i for i, path in enumerate(loop.parameter_paths)}
        self._columns = [i for i, path in enumerate(varied_paths) if path in places]
        self.drawn = [places[varied_paths[i]] for i in self._columns]
        return loop

    def _output(self, loop: ClosedLoop, name: str, option: str) -> OutputPart:
        """Output of the closed loop, or one component, by the name of an output or a measurement."""
        stem, _, label = name.removesuffix("]").partition("[")
        names = loop.outputs.name_out()
        full = f"{KEY}{INPUT}{stem}"
        full = full if full in names else stem
        if full not in names:
            short = [one.removeprefix(f"{KEY}{INPUT}") for one in names]
            raise self.scene.error(f"{option}: found '{name}', {near_names(stem, short)}", "")
        size = loop.outputs.numel_out(full)
        if not size:
            raise self.scene.error(f"{option}: '{name}' has no component in this scene", "")
        if not label:
            return OutputPart(full, tuple(range(size)))
        labels = next(one.labels for one in loop.variables if one.name == full)
        if label not in labels:
            raise self.scene.error(f"{option}: found '{name}', {near_names(label, labels)}", "")
        each, place = size // len(labels), labels.index(label)
        return OutputPart(full, tuple(range(place * each, (place + 1) * each)))

    def _prepare_observations(self, loop: ClosedLoop) -> None:
        chosen = self._options.get("observations")
        if chosen is None:
            names = [name for name in loop.outputs.name_out() if loop.outputs.numel_out(name)]
            chosen = [one for one in DEFAULT_OBSERVATIONS if one in names or f"{KEY}{INPUT}{one}" in names]
        bounds = chosen if isinstance(chosen, Mapping) else dict.fromkeys(chosen, np.inf)
        self._observed = [self._output(loop, name, "observations") for name in bounds]
        sizes = [len(one.places) for one in self._observed]
        self.high = np.repeat(np.array(list(bounds.values()), dtype=float), sizes)
        self.observation_names = [
            f"{name}[{i}]" for name, size in zip(bounds, sizes, strict=True) for i in range(size)
        ]

    def _prepare_reward(self, loop: ClosedLoop) -> None:
        """Weights, bonuses, terminations and limits by names of the closed loop."""
        begins_open = any(grasp.config.begins == "open" for grasp in self.scene.grasps)
        default = {"grasp_gap": -1.0, f"{EVENT}captured": 10.0} if begins_open else {}
        reward = self._options.get("reward", default)
        self.function = reward if callable(reward) else None
        weights = {} if callable(reward) else {name: float(weight) for name, weight in reward.items()}
        effort = weights.pop("action", 0.0)
        bonuses = {
            self._event(loop, key.removeprefix(EVENT), "reward", DIVERGED): weights.pop(key)
            for key in list(weights)
            if key.startswith(EVENT)
        }
        weighed = [
            (self._quantity(key.removeprefix(QUANTITY), "reward"), weights.pop(key))
            for key in list(weights)
            if key.startswith(QUANTITY)
        ]
        parts = [(self._output(loop, name, "reward"), weight) for name, weight in weights.items()]
        self.reward = Reward(self.period, tuple(parts), effort, tuple(weighed), bonuses)
        metrics = [self._quantity(name, "metrics") for name in self._options.get("metrics", ())]
        self.quantities = list(dict.fromkeys([*(each for each, _ in weighed), *metrics]))
        self._terminations = {
            self._event(loop, one, "terminations") for one in self._options.get("terminations", ())
        }
        limits = self._options.get("limits", {})
        self._bounds = [(self._output(loop, name, "limits"), float(limit)) for name, limit in limits.items()]

    def _event(self, loop: ClosedLoop, name: str, option: str, *more: str) -> str:
        """Kind or name of an event of the closed loop."""
        name = ALIASES.get(name, name)
        allowed = dict.fromkeys([*(word for rule in loop.events for word in (rule.kind, rule.name)), *more])
        if name not in allowed:
            raise self.scene.error(f"{option}: found '{name}', {near_names(name, allowed)}", "")
        return name

    def _quantity(self, name: str, option: str) -> Quantity:
        registered = quantities()
        if name not in registered:
            raise self.scene.error(f"{option}: found '{name}', {near_names(name, registered)}", "")
        return registered[name]

    def _measures(self, loop: ClosedLoop) -> Measures:
        """Measures of a step: outputs at its end, and parts of the quantities of an episode."""
        from optim.problem.quantity_measures import context_of, measures_of, with_added_states

        self.loop: Any = with_added_states(loop, self.scene, self.quantities, JITTER_FREQUENCY_HZ)
        context = context_of(self.scene, self.loop)
        self.quantity_measures = dict[str, Measure]()
        for each in self.quantities:
            components, named = measures_of(each, context)
            if not components.labels:
                raise self.scene.error(f"{each.name}: {each.absent}", "")
            self.quantity_measures |= named
        parts = [*self._observed, *(one for one, _ in self.reward.outputs), *(one for one, _ in self._bounds)]
        names = loop.outputs.name_out() if self.function else list(dict.fromkeys(one.name for one in parts))
        self._outputs = [name for name in names if loop.outputs.numel_out(name)]
        outputs = {f"{OUTPUT}{name}": final(context.signals[name]) for name in self._outputs}
        return Measures(context.signals, {**self.quantity_measures, **outputs})

    def _prepare_actions(self, actions: Sequence[Any]) -> None:
        """Indices of the actions in the row of parameters, time, state and switches of a rollout."""
        self.action_names = [one.name for one in actions]
        held = {name: 1 + i for i, name in enumerate(self.loop.state_names)}
        numbers = {path: i for i, path in enumerate(self.loop.parameter_paths)}
        self._places = np.array(
            [
                len(numbers) + held[f"{one.robot}/{KEY}.held[{one.place}]"]
                if one.robot
                else numbers[one.name]
                for one in actions
            ],
            dtype=np.int64,
        )
        limits = np.array([one.limits for one in actions], dtype=float).reshape(-1, 2)
        self._low, self._high = limits.T

    def draw(self, generator: np.random.Generator) -> Array:
        """Draw the parameters (np,) of an episode."""
        from optim.campaign.sampling.samplers import draw

        parameters = np.array(self.loop.parameter_values, dtype=float)
        if self._campaign is not None and self._space is not None and self.drawn:
            request = {"design": "monte_carlo", "samples": 1, "seed": int(generator.integers(2**31))}
            values = self._space.values(draw(self._campaign.model_copy(update=request)))[0]
            parameters[self.drawn] = values[self._columns]
        if NOISE_SEED in self.loop.parameter_paths:
            parameters[self.loop.parameter_paths.index(NOISE_SEED)] = generator.integers(2**31)
        return parameters

    def drawn_numbers(self, parameters: Array) -> dict[str, float]:
        """Drawn numbers by dotted path, of the parameters (np,) of an episode."""
        return {self.loop.parameter_paths[place]: float(parameters[place]) for place in self.drawn}

    def begin(self, parameters: Array) -> Array:
        """Return the rows (N, np + 1 + nx + ns) from which rollouts with parameters (N, np) begin."""
        x0, c = (value.full().T for value in self.loop.setup(parameters.T))
        return np.hstack([parameters, np.zeros((len(parameters), 1)), x0, c[:, list(self.loop.switches)]])

    def act(self, rows: Array, actions: Array) -> Array:
        """Return rows (N, np + 1 + nx + ns) in which actions (N, m) are held."""
        actions = np.clip(actions, -1.0, 1.0)
        rows = rows.copy()
        rows[:, self._places] = self._low + 0.5 * (actions + 1.0) * (self._high - self._low)
        return rows

    def outputs(self, measures: Mapping[str, Array]) -> Outputs:
        """Outputs (N, n) by name among the measures of a step."""
        return {name: measures[f"{OUTPUT}{name}"] for name in self._outputs}

    def observe(self, outputs: Outputs) -> Array:
        """Observations (N, n) of outputs, clipped; an output without a value reads 0."""
        values = np.concatenate([one.of(outputs) for one in self._observed], axis=1)
        return np.asarray(np.clip(values, -self.high, self.high))

    def terminates(self, outputs: Outputs, words: Sequence[Collection[str]]) -> NDArray[np.bool_]:
        """Whether events, by their kinds and names, or limits end episodes (N,)."""
        ends = np.array([bool(self._terminations & set(each)) for each in words])
        for one, limit in self._bounds:
            ends |= np.abs(one.of(outputs)).max(axis=1) > limit
        return ends

    def metrics(self, totals: Mapping[str, Array], elapsed_s: float) -> dict[str, float]:
        """Values of the quantities of one episode, from their measures (n,) by name."""
        from optim.problem.quantity_measures import table_values

        combine: dict[str, Callable[[Array], Any]] = {
            "largest": np.max,
            "sum": np.sum,
            "norm": np.linalg.norm,
        }
        return {
            each.name: float(combine[each.total](table_values(each, totals, elapsed_s)))
            for each in self.quantities
        }

    def words(self, fired: Sequence[int]) -> list[str]:
        """Kinds and names of events, by their indices in the closed loop."""
        rules = [self.loop.events[place] for place in fired]
        return [word for rule in rules for word in dict.fromkeys((rule.kind, rule.name))]

    def not_begun(self) -> SpaceRobotError:
        """Error of a step without an episode."""
        return self.scene.error("the episode is over or has not begun: call reset()", "")
