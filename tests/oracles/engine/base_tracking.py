"""Following a planned motion of a floating base, by interpolation of each interval."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.interpolate import KroghInterpolator

from spacerobot.common.arrays import Array
from spacerobot.elements.controllers.base_plan import PLANAR, SPATIAL
from spacerobot.elements.controllers.base_tracking import BaseTracking
from spacerobot.elements.controllers.mpc import Mpc
from spacerobot.elements.references.plan_following import BaseMotion
from spacerobot.scene import Scene, SceneBody
from tests.oracles.engine.joint_control import JointTracker
from tests.oracles.engine.kinematics import Kinematics
from tests.oracles.engine.planned import Pieces, plan_time, window_ends
from tests.oracles.engine.robot_law import Asked, Asking, RobotLaw, robot_law


@dataclass(frozen=True)
class BaseTracker:
    """A robot whose base follows a plan that begins at a time."""

    scene: Scene
    body: SceneBody
    config: BaseTracking | Mpc
    plan: BaseMotion
    begins: float = 0.0
    state_names: ClassVar[tuple[str, ...]] = ()

    @property
    def ends(self) -> tuple[float, ...]:
        """Knots of the plan behind the first one, of each of its phases."""
        return window_ends(self.plan, bool(self.scene.scenario.phases))

    def initial(self, kinematics: Kinematics) -> Array:
        """No states."""
        del kinematics
        return np.empty(0)

    def ask(self, now: Asking, states: Array) -> Asked:
        """Wrench along the plan."""
        config, plan, model = self.config, self.plan, self.scene.model
        t, within = (time - self.begins for time in plan_time(plan, now))
        wanted = np.zeros((2, len(plan.axes)))
        if within < plan.times[-1]:
            wanted = self._pieces.at(within)(t).reshape(2, -1)
        names = PLANAR if model.nvs[self.body.root_joint] == 3 else SPATIAL
        columns = [model.idx_vs[self.body.root_joint] + names.index(axis) for axis in plan.axes]
        gains = [config.kd_angular if axis[0] == "t" else config.kd_linear for axis in plan.axes]
        force = np.zeros(model.nv)
        force[columns] = config.feed_forward * wanted[0] + gains * (wanted[1] - now.kinematics.v[columns])
        return Asked(force, states)

    @functools.cached_property
    def _pieces(self) -> Pieces[KroghInterpolator]:
        return Pieces(self.plan.times, self.plan.points, self._piece)

    def _piece(self, piece: slice) -> KroghInterpolator:
        """Wrenches and rates of an interval."""
        plan = self.plan
        rows = np.hstack([np.array(plan.wrench[piece]), np.array(plan.rate[piece])])
        return KroghInterpolator(np.array(plan.times[piece]), rows)


@robot_law.register
def _(controller: BaseTracking, scene: Scene, body: SceneBody, key: str) -> RobotLaw:
    del key
    return BaseTracker(scene, body, controller, controller.planned)


@dataclass(frozen=True)
class PlanTracker(JointTracker):
    """A robot whose joints and base follow a plan."""

    base: BaseTracker

    def ask(self, now: Asking, states: Array) -> Asked:
        """Torques and wrench along the plan."""
        return Asked(super().ask(now, states).torque + self.base.ask(now, states).torque, states)


@robot_law.register
def _(controller: Mpc, scene: Scene, body: SceneBody, key: str) -> RobotLaw:
    del key
    assert controller.base_knots is not None, "the base is driven in tests of this kind"
    base = BaseTracker(scene, body, controller, controller.base_knots, controller.begins)
    return PlanTracker(scene, body, controller, base)
