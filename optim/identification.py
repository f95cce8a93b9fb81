r"""Mass, centre of mass and inertia of a held object from the momentum of the motion after its capture.

No external force acts, or its impulse is known, so that the momentum of all bodies about the world's origin
is constant. That of the object is linear in its ten inertial parameters $\pi$. For every sample

$$ Y(\text{pose}, \text{twist})\,\pi - h_0 = -(\text{momentum of the robots and their wheels})
   + \text{external impulse} $$

with the unknown total $h_0$ ($6 \times 1$). No acceleration is needed (Murotsu and others, J. Guidance
17(3), 1994; Ma, Dang and Pham, IEEE TRO 24(5), 2008). The object's pose and twist are those of the tip that
holds it. $Y$ is measured with noise too, so that plain least squares is biased. The estimate is therefore
the maximum of the likelihood by the effective variance: each residual is weighted by the covariance $J(\pi)
S J(\pi)^\top$ that the sensors' noise $S$ causes, as the parameters vary. An estimate that is not
physically consistent is replaced by the nearest consistent one, sought in triangular factors of the
pseudo-inertia (Rucker and Wensing, IEEE RA-L 7(2), 2022). Factors without logarithms are used because the
nearest one lies on the boundary, where a logarithm is infinite.

The momentum of an object that moves in a plane depends only on mass, two coordinates of the centre of mass
and the moment of inertia about the plane's normal: four columns and three rows of $Y$ remain.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.optimize import least_squares

from optim.json_files import JsonResult
from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.tables import Content, Table
from spacerobot.dynamics.inertial_parameters import INTERIOR, is_realisable, move_inside
from spacerobot.result import Result
from spacerobot.scene import Scene
from spacerobot.scene.scene import SceneBody, SceneGrasp

STEP = 1e-7
"""Step of the central differences by which noise is propagated [rad, m and their rates]."""
NAMES = (
    ("mass", "kg"),
    *((f"com_{axis}", "m") for axis in "xyz"),
    *((f"inertia_{axes}", "kg m^2") for axes in ("xx", "yy", "zz", "xy", "xz", "yz")),
)
"""Identified quantities and their units: link axes, inertia about the centre of mass."""
SPATIAL = (tuple(range(10)), tuple(range(10)), tuple(range(6)))
PLANAR = ((0, 1, 2, 9), (0, 1, 2, 6), (0, 1, 5))
"""Places of what a motion depends on: among Pinocchio's parameters, in :data:`NAMES`, and in the momentum."""


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations of white noise, of one sample.

    Attributes:
        attitude, rate: Attitude and rate of a base, about each axis [rad, rad/s].
        position, velocity: Position and velocity of a base's origin, along each axis [m, m/s].
        joint, joint_rate: Position and rate of each joint [rad or m, rad/s or m/s].
    """

    attitude: float = 5e-5
    rate: float = 2e-5
    position: float = 1e-3
    velocity: float = 1e-4
    joint: float = 2.4e-5
    joint_rate: float = 1e-4

    def scaled(self, factor: float) -> SensorNoise:
        """Noise with all deviations multiplied by a factor."""
        return SensorNoise(*(factor * value for value in dataclasses.astuple(self)))


@dataclass(frozen=True)
class IdentificationResult(JsonResult):
    """Inertial parameters of a body. Every array is read-only.

    Attributes:
        body: Name of the body.
        link: Its root link, in whose axes the numbers are.
        values, deviations, truth: Estimates, their standard deviations and the simulation's values (10,), in
            the order of :data:`NAMES`. A planar motion depends on four of them only. The others are the
            simulation's values without deviation, except that moments and products of inertia are scaled
            with the identified moment.
        identified: Names of the identified parameters.
        samples: Number of samples that were used.
        is_projected: Whether the estimate was replaced by the nearest physically consistent one.
    """

    key: ClassVar[str] = "identification"

    body: str
    link: str
    values: Array
    deviations: Array
    truth: Array
    identified: tuple[str, ...]
    samples: int
    is_projected: bool

    @property
    def changes(self) -> Mapping[str, Any]:
        """Changes of a scenario that give the target the identified mass properties."""
        path = f"target.links.{self.link}"
        return {
            f"{path}.mass": float(self.values[0]),
            f"{path}.com": self.values[1:4].tolist(),
            f"{path}.inertia": self.values[4:].tolist(),
        }

    def rows(self) -> list[tuple[str, ...]]:
        """Name with unit, estimate, standard deviation, truth and error, as text."""
        table_rows = []
        for (name, unit), value, deviation, true in zip(
            NAMES, self.values, self.deviations, self.truth, strict=True
        ):
            if name not in self.identified:
                continue
            places = max(0, 1 - math.floor(math.log10(max(deviation, 1e-12))))
            numbers = (f"{number:.{places}f}" for number in (value, deviation, true, value - true))
            table_rows.append((f"{name} [{unit}]", *numbers))
        return table_rows

    @classmethod
    def of_fields(cls, fields: dict[str, Any]) -> IdentificationResult:
        """The result with the fields of a file."""
        arrays = {key: np.array(fields[key]) for key in ("values", "deviations", "truth")}
        return cls(**fields | arrays | {"identified": tuple(fields["identified"])})

    def __repr__(self) -> str:
        """Body, and its mass with the standard deviation, in one line."""
        return (
            f"<IdentificationResult {self.body}: {self.values[0]:.4g} kg, std. {self.deviations[0]:.2g} kg>"
        )

    def content(self) -> list[Content]:
        """Estimates with their standard deviations and errors."""
        headings = ("", "estimate", "std. deviation", "simulated", "error")
        tables: list[Content] = [Table(f"{self.body}, {self.samples} samples", headings, self.rows())]
        if self.is_projected:
            tables.append(
                "The estimate was no body's and was moved to the nearest that is: more motion is needed."
            )
        return tables


def identify(
    result: Result, *, since: float | None = None, noise: SensorNoise | None = None, seed: int = 0
) -> IdentificationResult:
    """Mass properties of the object that a simulation's robots hold rigidly.

    Args:
        result: Simulation with a target that floats, in space or in a plane, without joints, held by a weld.
        since: Time from which samples are used [s]; that of the weld's last capture if None.
        noise: Sensor noise, which is added to the robots' measurements and weights them; None adds none.
        seed: Seed of the noise.

    Returns:
        IdentificationResult: Estimates with standard deviations, and the simulation's values.

    Raises:
        SpaceRobotError: If no weld holds the target, it has joints, or the motion does not make its
            parameters identifiable.
    """
    scene = result.scene()
    (target, grasp), begin = _held(scene), since
    if begin is None:  # time of the last capture; zero where the grasp holds from the start
        events = [e for e in result.summary["events"] if e["who"] == grasp.name and e["kind"] == "captured"]
        if not events and grasp.config.begins != "closed":
            raise SpaceRobotError(f"identification: grasp {grasp.name!r} captured nothing in this simulation")
        begin = float(events[-1]["time_s"]) if events else 0.0
    chosen = result.array("time") >= begin - 1e-9
    if chosen.sum() < len(NAMES):
        raise SpaceRobotError(
            f"identification: found {chosen.sum()} samples since {begin:g} s, allowed: at least "
            f"{len(NAMES)}; simulate longer or take a shorter `simulation.output_step`"
        )
    measured = _Momentum(result, scene, target, grasp, chosen)
    states, covariance = measured.states, np.zeros(2 * scene.model.nv)
    if noise is not None:
        covariance = measured.variances(noise)
        normals = np.random.Generator(np.random.Philox(seed)).normal(size=(len(states), len(covariance)))
        states = [measured.moved(x, np.sqrt(covariance) * d) for x, d in zip(states, normals, strict=True)]
    estimate, spread = _regression(measured, states, covariance)
    columns, names, _ = measured.places
    count = len(columns)
    spread = spread[:count, :count]
    if np.linalg.eigvalsh(spread).min() <= 0:
        raise measured.too_slow()
    parameters, is_projected = consistent(estimate[:count], spread)
    # derivative (n, n) of the named quantities by Pinocchio's parameters (n,)
    steps = 1e-6 * np.diag(np.maximum(np.abs(parameters), 1e-3))
    ends = [(_named(parameters + step) - _named(parameters - step)) / (2 * step.max()) for step in steps]
    slope = np.array(ends).T
    truth = _named(scene.model.inertias[target.root_joint].toDynamicParameters())
    values, deviations = truth.copy(), np.zeros(len(NAMES))
    values[list(names)] = _named(parameters)
    deviations[list(names)] = np.sqrt(np.diag(slope @ spread @ slope.T))
    if measured.places is PLANAR:  # keeps the triangle inequalities of the moments of inertia
        values[4:] *= values[6] / truth[6] if truth[6] > 0 else 1.0
        values[6] = _named(parameters)[3]
    if deviations[0] > values[0] or deviations[4:7].max() > values[4:7].sum():
        raise measured.too_slow()
    link = scene.model.frames[target.root_frame].name.partition("/")[2]
    identified = tuple(NAMES[place][0] for place in names)
    arrays = values, deviations, truth
    return IdentificationResult(target.name, link, *arrays, identified, len(states), is_projected)


def _held(scene: Scene) -> tuple[SceneBody, SceneGrasp]:
    """The target and the first weld that holds it."""
    target = scene.target
    welds = [g for g in scene.grasps if g.config.fixes_position and g.config.fixes_orientation]
    if target is None or not target.root_joint or target.joints or not welds:
        raise SpaceRobotError(
            "identification: found no floating target without joints that a grasp of kind `weld` holds, "
            "which is what can be identified"
        )
    return target, welds[0]


class _Momentum:
    """Residual of the momentum balance, from the robots' sensor readings at the chosen samples."""

    def __init__(
        self,
        result: Result,
        scene: Scene,
        target: SceneBody,
        grasp: SceneGrasp,
        chosen: NDArray[np.bool_],
    ) -> None:
        self.scene, self.target, self.grasp = scene, target, grasp
        model, self.robots = scene.model, scene.model.copy()  # robots: with an object without mass
        self.robots.inertias[target.root_joint] = pin.Inertia.Zero()
        self.data = self.robots.createData()
        self.places = PLANAR if model.joints[target.root_joint].nv == 3 else SPATIAL
        # measured (q, v), one for each sample
        self.states = list(zip(result.array("q")[chosen], result.array("v")[chosen], strict=True))
        data = model.createData()
        pin.framesForwardKinematics(model, data, self.states[0][0])
        # pose of the object's root link in the tip
        self.grip = data.oMf[grasp.tip.frame].actInv(data.oMi[target.root_joint])
        total = np.hstack([result.array(f"momentum_{kind}")[chosen] for kind in ("linear", "angular")])
        impulses = [name for name in ("impulse_linear", "impulse_angular") if name in result.data]
        if impulses:
            total = total - np.hstack([result.array(name)[chosen] for name in impulses])
        # momentum of wheels less the impulse from outside, about the world's origin (6,), of each sample
        self.held_momentum = total - np.array([_momentum_of(model, data, q, v) for q, v in self.states])

    @property
    def measured_places(self) -> list[int]:
        """Indices in v that the robots' sensors measure: all but the object's."""
        joint = self.scene.model.joints[self.target.root_joint]
        return [i for i in range(self.scene.model.nv) if not 0 <= i - joint.idx_v < joint.nv]

    def variances(self, noise: SensorNoise) -> Array:
        """Variance of each component of a measured state (2 nv,); zero for the unmeasured object."""
        model = self.scene.model
        deviations = np.tile([noise.joint, noise.joint_rate], (model.nv, 1))
        for body in self.scene.robots:
            if body.root_joint:
                joint = model.joints[body.root_joint]
                rotation_count = 3 if joint.nv == 6 else 1
                base = [(noise.position, noise.velocity)] * (joint.nv - rotation_count)
                deviations[joint.idx_v : joint.idx_v + joint.nv] = (
                    base + [(noise.attitude, noise.rate)] * rotation_count
                )
        hidden = np.setdiff1d(np.arange(model.nv), self.measured_places)
        deviations[hidden] = 0.0
        return deviations.T.ravel() ** 2

    def moved(self, x: tuple[Array, Array], by: Array) -> tuple[Array, Array]:
        """State with a tangent vector (2 nv,) added."""
        nv = self.scene.model.nv
        return pin.integrate(self.robots, x[0], by[:nv]), x[1] + by[nv:]

    def balance(self, x: tuple[Array, Array], initial_momentum: Array) -> tuple[Array, Array]:
        """Regressor of the object's momentum (6, 10), and the momentum of everything else (6,).

        Those rows and columns of them that the motion depends on: (3, 4) and (3,) in a plane.
        """
        data, tip = self.data, self.grasp.tip.frame
        others = _momentum_of(self.robots, data, *x) + initial_momentum
        pin.updateFramePlacement(self.robots, data, tip)
        twist = self.grip.actInv(pin.getFrameVelocity(self.robots, data, tip, pin.ReferenceFrame.LOCAL))
        pose = data.oMf[tip] * self.grip
        regressor = pose.toDualActionMatrix() @ momentum_regressor(twist.linear, twist.angular)
        columns, _, rows = self.places
        return regressor[np.ix_(rows, columns)], others[list(rows)]

    def derivatives(self, x: tuple[Array, Array], momentum: Array) -> Array:
        """Derivative (2 nv, 6, 11) by the measured state, of the regressor and, last, the other momentum.

        (2 nv, 3, 5) in a plane.
        """
        nv, (columns, _, rows) = self.scene.model.nv, self.places
        slopes = np.zeros((2 * nv, len(rows), len(columns) + 1))
        for column in [*self.measured_places, *(i + nv for i in self.measured_places)]:
            step = np.zeros(2 * nv)
            step[column] = STEP
            up, down = (
                np.column_stack(self.balance(self.moved(x, sign * step), momentum)) for sign in (1, -1)
            )
            slopes[column] = (up - down) / (2 * STEP)
        return slopes

    @property
    def advice(self) -> str:
        """Excitation trajectory: motion of the object from which its parameters are observable."""
        return "to and fro in the plane" if self.places is PLANAR else "about several axes"

    def too_slow(self) -> SpaceRobotError:
        """Error where noise hides the parameters."""
        return SpaceRobotError(
            "identification: the motion is too slow for this noise to tell the parameters apart; turn the "
            f"held object faster and {self.advice}"
        )


def _momentum_of(model: Any, data: Any, q: Array, v: Array) -> Array:
    """Linear and angular momentum of all links about the world's origin (6,)."""
    centroidal = pin.computeCentroidalMomentum(model, data, q, v)
    # moved from the centre of mass to the origin by Pinocchio: `numpy.cross` takes ten times as long
    return np.asarray(pin.SE3(np.eye(3), data.com[0]).act(centroidal).vector)


def momentum_regressor(velocity: Array, spin: Array) -> Array:
    """Momentum of a rigid body about its frame's origin as a linear map of its inertial parameters.

    ``p = m v + w x m c`` and ``h = I_o w + m c x v``, in the body's axes.

    Args:
        velocity, spin: Linear velocity of the frame's origin [m/s] and angular velocity [rad/s], body axes
            (3,) each.

    Returns:
        numpy.ndarray: Matrix (6, 10); parameters in Pinocchio's order: m, m c, I_xx, I_xy, I_yy, I_xz, I_yz,
            I_zz about the origin.
    """
    x, y, z = spin
    regressor = np.zeros((6, 10))
    regressor[:3, 0], regressor[:3, 1:4], regressor[3:, 1:4] = velocity, pin.skew(spin), -pin.skew(velocity)
    regressor[3:, 4:] = [[x, y, 0, z, 0, 0], [0, x, y, 0, z, 0], [0, 0, 0, x, y, z]]
    return regressor


def _regression(
    measured: _Momentum, states: list[tuple[Array, Array]], variance: Array
) -> tuple[Array, Array]:
    """Parameters and total momentum (16,), and their covariance (16, 16); of 7 in a plane."""
    pairs = list(zip(states, measured.held_momentum, strict=True))
    parts = np.array([np.column_stack(measured.balance(x, momentum)) for x, momentum in pairs])
    count = len(measured.places[0])
    total = np.tile(-np.eye(parts.shape[1]), (len(parts), 1, 1))
    rows, right = np.concatenate([parts[:, :, :count], total], axis=2), -parts[:, :, count]
    matrix = np.vstack(list(rows))
    scale = np.linalg.norm(matrix, axis=0)
    first, _, rank, _ = np.linalg.lstsq(matrix / np.where(scale > 0, scale, 1), right.ravel(), rcond=1e-10)
    if rank < matrix.shape[1]:
        raise SpaceRobotError(
            f"identification: the motion determines {rank} of {matrix.shape[1]} unknowns; turn the held "
            f"object {measured.advice}, and use more of the motion (`since`)"
        )
    if not variance.any():
        off = right.ravel() - matrix @ (first / scale)
        return first / scale, float(off @ off) / (len(off) - len(first)) * np.linalg.inv(matrix.T @ matrix)
    slopes = np.array([measured.derivatives(x, momentum) for x, momentum in pairs])[:, variance > 0]
    slopes = np.sqrt(variance[variance > 0])[:, None, None] * slopes

    def residual(scaled: Array) -> Array:
        unknown = scaled / scale
        spread = slopes @ np.append(unknown[:count], 1.0)
        covariance = spread.transpose(0, 2, 1) @ spread
        off = (rows @ unknown - right)[..., None]
        return np.asarray(np.linalg.solve(np.linalg.cholesky(covariance), off).ravel())

    fit = least_squares(residual, first, method="lm", x_scale="jac")
    try:
        return fit.x / scale, np.linalg.inv(fit.jac.T @ fit.jac) / np.outer(scale, scale)
    except np.linalg.LinAlgError:
        raise measured.too_slow() from None


def consistent(parameters: Array, spread: Array) -> tuple[Array, bool]:
    """Nearest parameters, by their covariance, that a body can have, and whether they were moved.

    The nearest lie on the boundary; those returned lie inside it by more than rounding errors.

    Args:
        parameters: Mass, first moments and inertia about the origin in Pinocchio's order (10,); of a body
            that moves in a plane mass, first moments along x and y, and moment of inertia about z (4,).
        spread: Their covariance, (10, 10) or (4, 4).

    Returns:
        tuple: The parameters, and whether they were moved.
    """
    if is_realisable(parameters):
        return parameters, False
    root = np.linalg.inv(np.linalg.cholesky(spread))
    mass = max(abs(parameters[0]), 1e-6)
    floor = INTERIOR * mass  # a body without mass has no centre
    if parameters.size == len(PLANAR[0]):
        assemble = _planar
        about = max(float(abs(parameters[3]) + parameters[1:3] @ parameters[1:3] / mass), 1e-6)
        start = np.array([np.sqrt(mass), *(parameters[1:3] / np.sqrt(mass)), np.sqrt(about)])
    else:
        assemble = _spatial
        inertia = np.eye(3) * max(np.abs(parameters[4:]).max(), 1e-6)
        matrix = pin.PseudoInertia.FromInertia(pin.Inertia(mass, parameters[1:4] / mass, inertia)).toMatrix()
        start = np.linalg.cholesky(matrix[::-1, ::-1])[::-1, ::-1][np.triu_indices(4)]

    def residual(factor: Array) -> Array:
        return np.asarray(root @ (assemble(factor, floor) - parameters))

    # quadratic, so that central differences are exact
    accuracy = {"xtol": 1e-14, "ftol": 1e-14, "gtol": 1e-14, "max_nfev": 20_000}
    nearest = least_squares(residual, start, jac="3-point", method="lm", x_scale="jac", **accuracy)
    return move_inside(assemble(nearest.x, floor)), True


def _planar(factor: Array, floor: float) -> Array:
    """Parameters (4,) of a planar body from a, b_x, b_y, d: m = a^2 + floor, m c = a b, I = b^2 + d^2."""
    a, x, y, d = factor
    return np.array([a * a + floor, a * x, a * y, x * x + y * y + d * d])


def _spatial(factor: Array, floor: float) -> Array:
    """Parameters (10,) of the pseudo-inertia U U^T, of which the upper triangle U (10,) is the factor."""
    upper = np.zeros((4, 4))
    upper[np.triu_indices(4)] = factor
    matrix = upper @ upper.T
    matrix[3, 3] += floor
    return np.array(pin.PseudoInertia.FromMatrix(matrix).toDynamicParameters())


def _named(parameters: Array) -> Array:
    """Mass, centre of mass and inertia about it, as :data:`NAMES` has them, of Pinocchio's ten (10,).

    Of the four of a planar body, the four that :data:`PLANAR` names.
    """
    if parameters.size == len(PLANAR[0]):
        mass, x, y, moment = parameters
        return np.array([mass, x / mass, y / mass, moment - (x**2 + y**2) / mass])
    inertia = pin.Inertia.FromDynamicParameters(parameters)
    about = inertia.inertia
    products = [about[0, 1], about[0, 2], about[1, 2]]
    return np.array([inertia.mass, *inertia.lever, *np.diag(about), *products])
