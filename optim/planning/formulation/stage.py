"""One instant of a motion as expressions: unknowns, equations of motion, constraints, costs.

An instant is z = (q, v, a, u, w, s): Pinocchio's configuration and velocity of the whole scene,
accelerations, generalized forces of the drives, wrenches of closed rigid grasps, and the parts of forces
whose magnitudes are a cost. Accelerations are unknowns, so that inverse dynamics enters the constraints; its
derivatives are much shorter than those of forward dynamics:

    M(q) a + h(q, v) + R v = B u + E(q, v) + A(q)' w,    d/dt (A v) = 0,

with the generalized forces E of environments. Rows in which B is zero belong to a base without actuation and
to the free target.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np
import pinocchio as pin

from optim.planning.formulation.grasps import closed_grasps, spring_wrench, tip_slip, wrench_axes
from spacerobot.closedloop import environment_forces
from spacerobot.common.arrays import Array
from spacerobot.dynamics import (
    Inertias,
    Kinematics,
    configuration_derivative,
    forward_kinematics,
    frame_placement,
    frame_velocity,
    inverse_dynamics,
)
from spacerobot.dynamics.inertial_parameters import SIZE
from spacerobot.dynamics.joints import sparse
from spacerobot.elements.estimators.estimator import HELD_INERTIA
from spacerobot.elements.goals.plan_instant import BoundedRow
from spacerobot.scene import Scene
from spacerobot.scene.grasp_closing import is_rigid
from spacerobot.scene.scene import SceneGrasp


@dataclass(frozen=True, eq=False)
class DrivenCoordinates:
    """Driven coordinates of a scene: velocity components on which generalized forces of drives act.

    Attributes:
        names: Labels of joints (robot/joint) and of axes of driven bases, one for each entry of u.
        columns: Index in v of each driven coordinate.
        limits: Maximum magnitude of each force [N m or N]; infinite where there is none.
        joints: Ids in the model of the driven joints, which precede the axes of bases.
    """

    names: tuple[str, ...]
    columns: tuple[int, ...]
    limits: Array
    joints: tuple[int, ...]

    @property
    def drives_bases(self) -> bool:
        """Whether a base is driven."""
        return len(self.names) > len(self.joints)

    def of_base(self, robot: str) -> list[str]:
        """Driven axes of a robot's base, in its own frame: ``fx``, ..., ``tz``."""
        named = (name.rpartition(".") for name in self.names[len(self.joints) :])
        return [axis for base, _, axis in named if base == f"{robot}/base"]

    def strength(self, robot: str, part: str) -> float:
        """Bound of the force, ``f``, or torque, ``t``, on a robot's base [N, N m]; zero without actuation."""
        components = [f"{robot}/base.{axis}" for axis in self.of_base(robot) if axis.startswith(part)]
        return float(np.linalg.norm([self.limits[self.names.index(name)] for name in components]))


def spring_forces(scene: Scene, q: ca.SX) -> ca.SX:
    """Generalized forces (nv x 1) that bend the springs of flexible links to a configuration.

    Args:
        scene: The scene.
        q: Configuration (nq x 1).
    """
    forces, stiffness = ca.SX(scene.model.nv, 1), scene.stiffness
    for joint in scene.model.joints[1:]:
        if stiffness[joint.idx_v]:
            forces[joint.idx_v] = stiffness[joint.idx_v] * q[joint.idx_q]
    return forces


@dataclass(frozen=True, eq=False)
class Stage:
    """A scene at one instant.

    Attributes:
        scene, driven: The scene, and its driven coordinates.
        grips: Closed rigid grasps.
        springs: Closed grasps made of springs and dampers.
        q, v, a, u, w: Symbols (nq, nv, nv, nu, nw).
        kinematics: Kinematics at (q, v).
        s: Symbols of positive and negative parts of forces whose magnitudes are a cost (ns).
        inertia: Symbols of the target's inertial parameters (10) in Pinocchio's order, if model predictive
            control replans with an estimate of them; none otherwise.
    """

    scene: Scene
    driven: DrivenCoordinates
    grips: tuple[SceneGrasp, ...]
    springs: tuple[SceneGrasp, ...]
    q: ca.SX
    v: ca.SX
    a: ca.SX
    u: ca.SX
    w: ca.SX
    kinematics: Kinematics
    s: ca.SX = field(default_factory=lambda: ca.SX(0, 1))
    inertia: ca.SX = field(default_factory=lambda: ca.SX(0, 1))

    @classmethod
    def of(cls, scene: Scene, driven: DrivenCoordinates, closed: Sequence[SceneGrasp] | None = None) -> Stage:
        """Symbols of a scene.

        Args:
            scene, driven: The scene, and its driven coordinates.
            closed: Grasps that hold; those closed at the start if None.
        """
        model, closed = scene.model, closed_grasps(scene) if closed is None else closed
        grips, springs = (tuple(g for g in closed if is_rigid(g) is rigid) for rigid in (True, False))
        q, v, a = (ca.SX.sym(n, size) for n, size in (("q", model.nq), ("v", model.nv), ("a", model.nv)))
        u = ca.SX.sym("u", len(driven.columns))
        w = ca.SX.sym("w", sum(len(wrench_axes(scene, grip)) for grip in grips))
        # whether a controller replans in flight and a filter estimates the mass properties of the held object
        robots = scene.scenario.robots.values()
        has_replanning = any(
            one.replanning is not None for robot in robots for one in robot.controllers.values()
        )
        has_inertia_filter = any(
            HELD_INERTIA in one.makes for robot in robots for one in robot.estimators.values()
        )
        inertia = ca.SX.sym("inertia", SIZE if has_replanning and has_inertia_filter else 0)
        kinematics = forward_kinematics(model, q, v)
        return cls(scene, driven, grips, springs, q, v, a, u, w, kinematics, inertia=inertia)

    @property
    def z(self) -> ca.SX:
        """Vector of the instant's unknowns (nz x 1)."""
        return ca.vertcat(self.q, self.v, self.a, self.u, self.w, self.s)

    @property
    def drive_places(self) -> list[int]:
        """Indices in z of the drives and of the parts of forces."""
        first = self.q.numel() + self.v.numel() + self.a.numel()
        parts = self.z.numel() - self.s.numel()
        return [*range(first, first + self.u.numel()), *range(parts, self.z.numel())]

    @functools.cached_property
    def rate(self) -> ca.SX:
        """Rate q' of the configuration (nq x 1)."""
        return configuration_derivative(self.scene.model, self.q, self.v)

    @functools.cached_property
    def rate_function(self) -> ca.Function:
        """Function of an instant z that returns q'."""
        return ca.Function("rate", [self.z], [ca.densify(self.rate)])

    @functools.cached_property
    def environment(self) -> ca.Function | None:
        """Generalized forces of environments (nv x 1) as a function of q and v; None where there is none.

        Raises:
            ScenarioError: If they depend on time.
        """
        return environment_forces(self.scene)

    def environment_effort(self, q: Array, v: Array) -> Array:
        """Generalized forces of environments (nv,) [N, N m] at a configuration and velocity."""
        if self.environment is None:
            return np.zeros(self.scene.model.nv)
        return np.array(self.environment(q, v).full()).ravel()

    @functools.cached_property
    def balance(self) -> ca.SX:
        """Residual of the equations of motion (nv x 1) [N, N m]."""
        model = self.scene.model
        inertias, target = Inertias.from_model(model), self.scene.target
        if self.inertia.numel() and target is not None:
            inertias = inertias.replaced(target.root_joint, self.inertia)
        force = inverse_dynamics(model, self.kinematics, inertias, self.a)
        force = force + sparse(np.asarray(model.damping)) * self.v + spring_forces(self.scene, self.q)
        for k, column in enumerate(self.driven.columns):
            force[column] -= self.u[k]
        if self.environment is not None:
            force = force - self.environment(self.q, self.v)
        for spring in self.springs:
            apart = tip_slip(self.scene, self.kinematics, [spring])
            force = force - ca.jtimes(apart, self.v, ca.vertcat(*self.wrench(spring)), True)
        return force - ca.jtimes(tip_slip(self.scene, self.kinematics, self.grips), self.v, self.w, True)

    @property
    def parting(self) -> ca.SX:
        """Relative acceleration of tip and target at rigid grasps (nw x 1) [m/s^2, rad/s^2].

        A constraint of the plan sets it to zero.
        """
        state, rate = ca.vertcat(self.q, self.v), ca.vertcat(self.rate, self.a)
        return ca.jtimes(tip_slip(self.scene, self.kinematics, self.grips), state, rate)

    def wrench(self, grip: SceneGrasp) -> tuple[ca.SX, ca.SX]:
        """Force [N] and torque [N m] of a grasp on its tip, world axes (3x1 each)."""
        if grip in self.springs:
            return spring_wrench(self.scene, self.kinematics, grip)
        first = sum(len(wrench_axes(self.scene, other)) for other in self.grips[: self.grips.index(grip)])
        linear, size = len(self.scene.translation_axes), len(wrench_axes(self.scene, grip))
        return self.w[first : first + linear], self.w[first + linear : first + size]

    def placement(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Rotation matrix (3x3) and origin (3x1) [m] of a frame in the world."""
        return frame_placement(self.scene.model, self.kinematics, frame)

    def velocity(self, frame: int) -> tuple[ca.SX, ca.SX]:
        """Linear and angular velocity of a frame's origin (3x1 each) [m/s, rad/s]."""
        return frame_velocity(self.scene.model, self.kinematics, frame)


def state_after_impact(stage: Stage, state: Array, *, locked: bool = False) -> Array:
    """State (nq + nv,) after the plastic impact at which a phase's rigid grasps close.

    Args:
        stage: An instant of the phase.
        state: State before the impact (nq + nv,).
        locked: Whether the joints stop too.
    """
    model = stage.scene.model
    q, v = np.split(state, [model.nq])
    rows = tip_slip(stage.scene, stage.kinematics, stage.grips)
    if locked:
        rows = ca.vertcat(rows, stage.v[list(stage.driven.columns[: len(stage.driven.joints)])])
    if not rows.numel():
        return state
    slopes = np.array(ca.Function("slopes", [stage.q], [ca.jacobian(rows, stage.v)])(q).full())
    upper = np.triu(pin.crba(model, model.createData(), q))
    inertia = upper + np.triu(upper, 1).T
    matrix = np.block([[inertia, slopes.T], [slopes, np.zeros((len(slopes), len(slopes)))]])
    right = np.concatenate([np.zeros(model.nv), -slopes @ v])
    jump = np.linalg.lstsq(matrix, right, rcond=None)[0][: model.nv]
    return np.concatenate([q, v + jump])


@dataclass(frozen=True, eq=False)
class PlanningProblem:
    """A planning problem over a scene, before its transcription on a mesh.

    Attributes:
        stage: Symbols and expressions of one instant.
        path: Constraints at all instants, in addition to the limits of z.
        goal: Constraints at the last instant.
        terms: Integrands of the cost (1x1 each), by name.
        ends: Terminal costs (1x1 each), by name.
        weights: Weights of the integrands, of the terminal costs, and of ``time``, the duration.
        lower, upper: Limits of z (nz,).
        duration: Minimum, maximum and first guess of the duration [s].
        fixed: Initial q and v (nq + nv,), or their first guess if the start is free.
        tolerance: Maximum replay error of a tip [m].
        begin: Lower and upper bounds of q and v at the start, if that is free (nq + nv,) each.
        magnitudes: Forces (n x 1) [N] whose magnitudes are integrands, by name.
        open_loop: Whether the tolerance applies to the replay without feedback too.
        linear_drives: Whether drives are linear in time in each interval, so that their limits hold
            throughout if they hold at both ends.
        inertia: Values of the stage's ``inertia`` (10,); empty if it has none.
    """

    stage: Stage
    path: tuple[BoundedRow, ...]
    goal: tuple[BoundedRow, ...]
    terms: Mapping[str, ca.SX]
    ends: Mapping[str, ca.SX]
    weights: Mapping[str, float]
    lower: Array
    upper: Array
    duration: tuple[float, float, float]
    fixed: Array
    tolerance: float
    begin: tuple[Array, Array] | None = None
    magnitudes: Mapping[str, ca.SX] = field(default_factory=dict)
    open_loop: bool = True
    linear_drives: bool = False
    inertia: Array = field(default_factory=lambda: np.empty(0))

    def arguments(self, z: Array) -> Array:
        """Arguments of the functions of instants: instants (n, nz) as columns, above the inertia."""
        if not self.inertia.size:
            return z.T
        return np.vstack([z.T, np.tile(self.inertia[:, None], len(z))])

    @property
    def start(self) -> tuple[Array, Array]:
        """Lower and upper bounds of q and v at the start (nq + nv,) each."""
        return (self.fixed, self.fixed) if self.begin is None else self.begin

    @property
    def cost(self) -> ca.SX:
        """Weighted integrand of the cost (1x1) [1/s]."""
        return sum((self.weights[name] * term for name, term in self.terms.items()), ca.SX(0))

    @property
    def time_weight(self) -> float:
        """Weight of the duration [1/s]."""
        return self.weights["time"]
