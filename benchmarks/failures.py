"""Failed joints of the paper's robots and of the servicer: ``python -m benchmarks.failures [TABLE ...]``.

Prints the tables of docs/validation/failures.md, or those that are named:

paper
    16 joints that lock, swing freely or keep half their torque from 2 s on, the last two also with a brake of
    the failed joint 0.1 s later.
reach
    Each arm with one joint locked: distance of the tip from its required position, and smallest singular
    value of the other joints' Jacobian.
servicer
    14 joints that fail as those of the paper, about 5 s before their arm's grasp closes.
instant
    Probability that the paper's robots succeed, over the instant of the failure, with its slope.
crossings
    The same at one instant with all crossings of the limit by the lines of line sampling.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from scipy import stats
from scipy.optimize import elementwise, least_squares

import spacerobot as sr
from benchmarks.table_row import markdown_head
from optim.reliability.limit_state import RolloutLimitState, build_limit_state
from spacerobot.common.arrays import Array
from spacerobot.scene import Scene

FAILED_S, BRAKED_S = 2.0, 2.1
COLUMNS = {
    "locked": ("locked", False),
    "free": ("free", False),
    "free, braked": ("free", True),
    "half torque": ("weak", False),
    "half torque, braked": ("weak", True),
}
NEVER = 1e6  # time of failures that do not occur, s
ARMS = {"left": 5.0, "right": 22.0}
"""Instants of failures of the servicer's arms [s]; they capture at 10.05 and 28.26 s if nothing fails."""


def cell(robot: str | None, joint: str, mode: str, *, braked: bool) -> str:
    """Largest tip error [mm], base rotation [deg] and joint torque [N m]; or the time of divergence."""
    failure = {"kind": "joint_failure", "joint": joint, "mode": mode, "at": FAILED_S}
    brake = {"brake": {"kind": "joint_failure", "joint": joint, "mode": "locked", "at": BRAKED_S}}
    actuators = {"failure": failure} | (brake if braked else {})
    scene = sr.load_scene("paper", {f"robots.{robot}.actuators": actuators} if robot else {})
    result = sr.simulate(scene, backend="interpreted")
    status, data = result.summary["status"], result.data
    if status["state"] != "completed" or not status["trusted"]:
        return f"lost at {status['reached_s']:.1f} s" if status["state"] == "diverged" else "lost"
    tips = 1e3 * float(np.linalg.norm(data.tip_error.values, axis=-1).max())
    rotation = np.degrees(float(np.abs(data.body_rotation.values[..., 2]).max()))
    return f"{tips:.1f} / {rotation:.0f} / {float(np.abs(data.joint_torque.values).max()):.0f}"


def paper() -> None:
    """Print the table of the paper's joints."""
    print(*markdown_head(["joint", *COLUMNS]), sep="\n")
    print(f"| none | {cell(None, '', 'free', braked=False)} |" + " |" * (len(COLUMNS) - 1), flush=True)
    for robot in ("rpr1", "rpr2"):
        for number in range(1, 9):
            joint = f"joint_{number}"
            cells = [cell(robot, joint, mode, braked=braked) for mode, braked in COLUMNS.values()]
            print(f"| {robot}/{joint} | " + " | ".join(cells) + " |", flush=True)


@dataclass(frozen=True)
class LockedArm:
    """Arm with one joint locked, on a base with its nominal motion.

    Attributes:
        model, frame: The scene's model, and the tip's frame.
        joints: Ids of the arm's joints.
        rows: Indices of the required components of the tip's motion, of six, world axes.
    """

    model: Any
    frame: int
    joints: Sequence[int]
    rows: Sequence[int]

    def remaining(self, q: Array, failed: Array, locked: int, starts: int = 40) -> tuple[Array, float]:
        """Smallest error (n,) to the tip's pose at q, and the smallest singular value there.

        Args:
            q, failed: Configurations (nq,): nominal, and at the instant of the failure.
            locked: Index of the locked joint among the arm's; the others are solved for.
            starts: Maximum number of starts of the search: the nominal posture, then random ones.
        """
        model, data = self.model, self.model.createData()
        pin.framesForwardKinematics(model, data, q)
        goal = data.oMf[self.frame].copy()
        free_joints = [model.joints[joint] for i, joint in enumerate(self.joints) if i != locked]
        stuck, base = model.joints[self.joints[locked]], q.copy()
        base[stuck.idx_q : stuck.idx_q + stuck.nq] = failed[stuck.idx_q : stuck.idx_q + stuck.nq]

        def posture(angles: Array) -> Array:
            change = np.zeros(model.nv)
            change[[joint.idx_v for joint in free_joints]] = angles
            return np.asarray(pin.integrate(model, base, change))

        def missing(angles: Array) -> Array:
            pin.framesForwardKinematics(model, data, posture(angles))
            solution = data.oMf[self.frame]
            rotation = pin.log3(solution.rotation @ goal.rotation.T)
            return np.concatenate([solution.translation - goal.translation, rotation])[list(self.rows)]

        rng = np.random.default_rng(0)
        tries = [np.zeros(len(free_joints)), *rng.uniform(-2.5, 2.5, (starts - 1, len(free_joints)))]
        best = None
        for first in tries:
            solution = least_squares(missing, first, xtol=1e-14, ftol=1e-14, gtol=1e-14)
            best = solution if best is None or solution.cost < best.cost else best
            if best.cost < 1e-18:
                break
        assert best is not None
        pin.computeJointJacobians(model, data, posture(best.x))
        pin.updateFramePlacements(model, data)
        jacobian = pin.getFrameJacobian(model, data, self.frame, pin.LOCAL_WORLD_ALIGNED)
        jacobian = jacobian[np.ix_(list(self.rows), [joint.idx_v for joint in free_joints])]
        smallest = np.linalg.svd(jacobian, compute_uv=False)[-1]
        return best.fun, float(smallest)


def arm_of(scene: Scene, tip: str, prefix: str, rows: Sequence[int]) -> LockedArm:
    """Arm that carries a tip."""
    frame = next(one.frame for one in scene.tips if one.label == tip)
    joints = [i for i, name in enumerate(scene.model.names) if name.startswith(prefix)]
    return LockedArm(scene.model, frame, joints, rows)


def reach() -> None:
    """Print the tip errors on the circle or at the capture that each arm has with a joint locked."""
    scene = sr.load_scene("paper")
    data = sr.simulate(scene).data
    print(*markdown_head(["joint", "farthest from the circle, mm", "smallest singular value, m"]), sep="\n")
    for robot in ("rpr1", "rpr2"):
        arm = arm_of(scene, f"{robot}/tip", f"{robot}/joint_", (0, 1))
        for number in range(8):
            failed = data.q.sel(time=FAILED_S, method="nearest").values
            remainders = [
                arm.remaining(data.q.sel(time=t, method="nearest").values, failed, number)
                for t in np.arange(FAILED_S, 10.01, 0.5)
            ]
            off = 1e3 * max(float(np.linalg.norm(one[0])) for one in remainders)
            smallest = min(one[1] for one in remainders)
            print(f"| {robot}/joint_{number + 1} | {off:.3f} | {smallest:.2f} |", flush=True)
    scene = sr.load_scene("capture")
    result = sr.simulate(scene)
    closes = {e["who"]: e["time_s"] for e in result.summary["events"] if e["kind"] == "captured"}
    print()
    print(*markdown_head(["joint", "from the capture, mm", "mrad", "smallest singular value"]), sep="\n")
    for side, failed_s in ARMS.items():
        arm = arm_of(scene, f"servicer/{side}_tip", f"servicer/{side}_joint_", range(6))
        failed, q = (result.data.q.sel(time=t, method="nearest").values for t in (failed_s, closes[side]))
        for number in range(7):
            error, least = arm.remaining(q, failed, number)
            line, turn = (1e3 * float(np.linalg.norm(part)) for part in np.split(error, 2))
            print(f"| {side}_joint_{number + 1} | {line:.1f} | {turn:.1f} | {least:.4f} |", flush=True)


def servicer() -> None:
    """Print the table of the servicer's joints; all failures of an arm are one batch of one closed loop."""
    quantities = ["capture_time", "lateral_miss", "miss_distance", "base_rotation_peak", "joint_torque_peak"]
    print(*markdown_head(["joint", *COLUMNS]), sep="\n")
    for side, at in ARMS.items():
        place, actuators = "robots.servicer.actuators", dict[str, Any]()
        for number in range(1, 8):
            joint: dict[str, Any] = {"kind": "joint_failure", "joint": f"{side}_joint_{number}", "at": NEVER}
            actuators[f"weak_{number}"] = joint | {"mode": "weak"}
            actuators[f"lock_{number}"] = joint
        rows = [(0, NEVER, 1.0, NEVER)]  # joint, instant of the motor's failure and what is left, of the lock
        for number in range(1, 8):
            for mode, braked in COLUMNS.values():
                left = {"weak": 0.5, "free": 0.0, "locked": 1.0}[mode]
                lock = at if mode == "locked" else at + BRAKED_S - FAILED_S if braked else NEVER
                rows.append((number, NEVER if mode == "locked" else at, left, lock))
        values = {}
        for number in range(1, 8):
            values_of_row = [row if row[0] == number else rows[0] for row in rows]
            for key, i in (("weak_{}.at", 1), ("weak_{}.remaining", 2), ("lock_{}.at", 3)):
                values[f"{place}.{key.format(number)}"] = np.array([row[i] for row in values_of_row])
        scene = sr.load_scene("capture", {place: actuators})
        batch = sr.batch(scene, quantities, values).data
        cells = [capture_cell(batch.isel(sample=i), side) for i in range(len(rows))]
        print(f"| none, {side} arm | {cells[0]} |" + " |" * (len(COLUMNS) - 1))
        for number in range(1, 8):
            own_cells = cells[1 + 5 * (number - 1) : 1 + 5 * number]
            print(f"| {side}_joint_{number} | " + " | ".join(own_cells) + " |", flush=True)


def capture_cell(sample: Any, side: str) -> str:
    """Tip error at the capture [mm], base rotation [deg], joint torque [N m]; * if the other arm misses."""
    if np.isfinite(sample.diverged_at):
        return f"lost at {float(sample.diverged_at):.0f} s"
    rotation, torque = float(sample.base_rotation_peak[0]), float(sample.joint_torque_peak.max())
    rest = f"{rotation:.0f} / {torque:.0f}"
    if np.isnan(sample.capture_time.sel(capture_time_of=side)):
        return f"missed by {1e3 * float(sample.miss_distance.sel(miss_distance_of=side)):.0f} / {rest}"
    other = "" if bool(np.isfinite(sample.capture_time).all()) else " *"
    return f"{1e3 * float(sample.lateral_miss.sel(lateral_miss_of=side)):.1f} / {rest}{other}"


ROBOT, JOINT, MODE, LIMIT_M = "rpr1", "joint_3", "weak", 4e-3
INSTANTS = (4.7, 4.8, 4.9, 5.0, 5.1, 5.2, 5.3, 5.4)
LINES, BEYOND, STEP_S, PLAIN = 64, 6.0, 2e-3, 1024
GRAZED_S, PARTS, DIFFERENCES_S = 4.8, 240, (2.5e-3, 1e-2)


@dataclass(frozen=True)
class FailureInstant:
    """Limit state of a scene at a value of its last uncertain parameter, the instant of a failure."""

    state: RolloutLimitState
    at: float

    def draws(self, z: Array) -> tuple[Array, Array]:
        """Draws (N, k + 1) at scores (N, k) of the other parameters, and their slopes by the scores."""
        draws, slopes = self.state.draws(np.column_stack([z, np.zeros(len(z))]))
        draws[:, -1] = self.at
        return draws, slopes[:, :-1]

    def values(self, z: Array) -> Array:
        """Limit minus the quantity (N,)."""
        values = self.state.limit - self.state.quantities(self.draws(z)[0])
        return np.where(np.isnan(values), -self.state.limit * 1e3, values)

    def gradients(self, z: Array) -> tuple[Array, Array]:
        """Gradients by the scores (N, k), and by the instant (N,)."""
        draws, slopes = self.draws(z)
        by_draw = self.state.quantity_gradients(draws)[1]
        return -(by_draw[:, :-1] * slopes) @ self.state.cholesky[:-1, :-1], -by_draw[:, -1]

    def probability(
        self, z: Array, along: Array, *, slope: bool, parts: int = 1
    ) -> tuple[float, float, float]:
        """Probability of success by line sampling, its standard error and its slope by the instant [1/s].

        On each line ``z + r along`` the limit is met at some r_i(t): success is on their left where the
        limit state falls, s_i = 1, on their right where it rises, s_i = -1, so that it has the probability
        ``sum s_i Phi(r_i)``, plus 1 if the right end is a success. With ``g(z + r along, t) = 0`` the slope
        is ``sum s_i phi(r_i) r_i' = -sum s_i phi(r_i) (dg/dt) / (along . dg/dz)``: that of the estimate
        itself, exact where the gradients are (Lu, Song, Yue and Wang, Structural Safety 30, 2008, who have
        one r on each line).

        Args:
            z: Points (n, k) of the lines, across their direction.
            along: Unit vector (k,) along which the limit state falls.
            slope: Whether the slope is computed.
            parts: Number of parts of each line, each with at most one crossing of the limit.
        """

        def value(r: Array, index: Array) -> Array:
            return self.values(z[index.astype(int)] + np.multiply.outer(r, along))

        ends, lines = np.linspace(-BEYOND, BEYOND, parts + 1), np.arange(float(len(z)))
        inside = np.array([value(np.full(len(z), end), lines) > 0 for end in ends]).T
        line, part = np.nonzero(inside[:, :-1] != inside[:, 1:])
        sign = np.where(inside[line, part], 1.0, -1.0)
        success, slopes = inside[:, -1].astype(float), np.zeros(len(z))
        if line.size:
            sides, tolerances = (ends[part], ends[part + 1]), {"xatol": 1e-7, "fatol": 0}
            r = elementwise.find_root(value, sides, args=(line.astype(float),), tolerances=tolerances).x
            np.add.at(success, line, sign * stats.norm.cdf(r))
            if slope:
                by_score, by_time = self.gradients(z[line] + np.multiply.outer(r, along))
                np.add.at(slopes, line, -sign * stats.norm.pdf(r) * by_time / (by_score @ along))
        return float(success.mean()), float(success.std(ddof=1) / np.sqrt(len(z))), float(slopes.mean())


def instant_state(step_s: float | None = None) -> RolloutLimitState:
    """Limit state over the uncertain parameters of the paper's scenario, the instant of the failure last."""
    nominal = sr.load_scene("paper").scenario.campaign
    assert nominal is not None
    place = f"robots.{ROBOT}.actuators"
    parameters = nominal.model_dump(exclude_none=True)["parameters"]
    parameters["failure"] = {"paths": f"{place}.fail.at", "lower": 0.5, "upper": 9.5}
    assert nominal.correlation is not None
    rows = np.eye(len(parameters))
    rows[:-1, :-1] = nominal.correlation
    failure = {"kind": "joint_failure", "joint": JOINT, "mode": MODE, "at": 2.0}
    changes = {
        place: {"fail": failure},
        "campaign.parameters": parameters,
        "campaign.correlation": rows.tolist(),
        "campaign.step": step_s or nominal.step,
    }
    return build_limit_state(sr.load_scene("paper", changes), "tip_error_peak", LIMIT_M)


def lines_of(state: RolloutLimitState) -> tuple[Array, Array]:
    """Points (n, k) of lines, and their direction (k,), the steepest descent at the middle instant."""
    k = len(state.names) - 1
    z = np.random.default_rng(0).standard_normal((LINES, k))
    middle = FailureInstant(state, INSTANTS[len(INSTANTS) // 2])
    along = -middle.gradients(np.zeros((1, k)))[0][0]
    along /= np.linalg.norm(along)
    return z - np.outer(z @ along, along), along


def by_differences(
    state: RolloutLimitState, at: float, step_s: float, *lines: Array, parts: int = 1
) -> float:
    """Slope of P(success) by central differences on the same lines [1/s]."""
    up, down = (
        FailureInstant(state, at + sign * step_s).probability(*lines, slope=False, parts=parts)[0]
        for sign in (1, -1)
    )
    return (up - down) / (2 * step_s)


def instant() -> None:
    """Print the probability of success, its slope, and the slope by differences on the same lines."""
    state = instant_state()
    z, along = lines_of(state)
    plain = np.random.default_rng(1).standard_normal((PLAIN, z.shape[1]))
    print(
        *markdown_head(["instant, s", "P(success)", "plain", "slope, 1/s", "by differences, 1/s"]), sep="\n"
    )
    for at in INSTANTS:
        probability, error, slope = FailureInstant(state, at).probability(z, along, slope=True)
        crude = float(np.mean(FailureInstant(state, at).values(plain) > 0))
        row = (
            f"{at:g}",
            f"{probability:.3f} ± {error:.3f}",
            f"{crude:.3f}",
            f"{slope:.3f}",
            f"{by_differences(state, at, STEP_S, z, along):.3f}",
        )
        print("| " + " | ".join(row) + " |", flush=True)


def crossings() -> None:
    """Print the table with all crossings of each line, at an instant at which lines graze the limit."""
    lines, head = lines_of(instant_state()), ["step, ms", "P(success)", "slope, 1/s"]
    print(*markdown_head(head + [f"over {2e3 * step_s:g} ms" for step_s in DIFFERENCES_S]), sep="\n")
    for step_s in (1e-2, 2.5e-3):
        state = instant_state(step_s)
        probability, _, slope = FailureInstant(state, GRAZED_S).probability(*lines, slope=True, parts=PARTS)
        rates = [by_differences(state, GRAZED_S, each, *lines, parts=PARTS) for each in DIFFERENCES_S]
        row = [f"{1e3 * step_s:g}", f"{probability:.3f}", f"{slope:.2f}", *(f"{rate:.2f}" for rate in rates)]
        print("| " + " | ".join(row) + " |", flush=True)


TABLES = {
    "paper": paper,
    "reach": reach,
    "servicer": servicer,
    "instant": instant,
    "crossings": crossings,
}


def main(names: Sequence[str]) -> None:
    """Print the tables of these names, or all."""
    for name in names or TABLES:
        TABLES[name]()
        print()


if __name__ == "__main__":
    main(sys.argv[1:])
