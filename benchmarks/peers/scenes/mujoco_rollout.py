"""Throughput: the chaser of ``mujoco_capture_arm`` many times, by ``mujoco.rollout`` and in SIMD lanes.

Both sides have the same number of threads. MuJoCo takes mjorbit's step, ours the longest one whose error is
no greater. What is left out of the scene is stated there; the time that the orbit costs us is measured.
"""

from __future__ import annotations

import dataclasses
import statistics
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from benchmarks.peers.compare import TURNS, Outcome, PeerScene, distance, timed
from benchmarks.peers.scenes.mujoco_capture_arm import (
    AMPLITUDE,
    CHASER,
    CUBE,
    FREQUENCY,
    HEAD,
    actuators,
    capture_arm,
)
from spacerobot.closedloop import build_closed_loop
from spacerobot.common.arrays import Array
from spacerobot.exports.mjcf_bodies import coordinates
from spacerobot.rollout import Rollout, build_rollout, time_grid
from spacerobot.scene import Scene

COUNT, THREADS = 64, 2
REFERENCE_S = 6.25e-4
"""Step of the converged reference [s]."""
THEIR_STEP_S = 0.01
OUR_STEPS_S = (0.1, 0.05, 0.04, 0.02, 0.01, 0.005, 0.0025)
"""Steps of which the longest is taken whose error is at most MuJoCo's [s]."""
INTEGRATORS = ("Euler", "implicitfast", "RK4")
SHOULDER = "robots.chaser.joints.shoulder.angle_deg"
JOINTS = {"robots.chaser.joints": {joint: {"angle_deg": 0.0} for joint in ("shoulder", "elbow")}}
ORBIT = {"environment": {"leo": {"kind": "orbit", "altitude": 400e3}}}


@dataclasses.dataclass(frozen=True)
class IntegratorOutcome:
    """One of MuJoCo's integrators against ours at no greater error, where a step of ours has it.

    Attributes:
        integrator: MuJoCo's integrator.
        our_step_s: Our step [s].
        our_s, their_s: Processor times of all simulations [s].
        our_error, their_error: Errors of the final states.
    """

    integrator: str
    our_step_s: float
    our_s: float
    their_s: float
    our_error: float
    their_error: float

    @property
    def ratio(self) -> float:
        """Their time over ours."""
        return self.their_s / self.our_s


def rate(time_s: float, step_s: float, duration_s: float) -> str:
    """Steps per second and core, as text."""
    return f"{COUNT * duration_s / step_s / time_s / 1e6:.2g} million steps/s"


def angles_deg() -> Array:
    """Initial angles of the shoulder (N,), which differ between the simulations."""
    return np.linspace(-20.0, 20.0, COUNT)


def our_rollout(changes: dict[str, Any]) -> tuple[Scene, Rollout]:
    """Scene, and the rollout of its closed loop in lanes."""
    scene = capture_arm({**JOINTS, **changes})
    duration = scene.scenario.simulation.duration
    loop = build_closed_loop(scene, [SHOULDER])
    rollout = build_rollout(
        loop, duration_s=duration, step_s=THEIR_STEP_S, output_step_s=duration, many=True, backend="compiled"
    )
    return scene, rollout


def our_job(rollout: Rollout, step_s: float) -> Callable[[], Array]:
    """Job of all simulations, which returns their final states (N, nx)."""
    duration = rollout.grid.duration_s
    stepped = dataclasses.replace(rollout, grid=time_grid(duration, step_s, duration))

    def run() -> Array:
        batch = stepped.batch([SHOULDER], angles_deg()[:, None], states=True, threads=THREADS)
        assert batch.state is not None
        return np.array(batch.state[:, -1])

    return run


def their_job(scene: Scene, integrator: str, step_s: float) -> Callable[[], Array]:
    """Job of ``mujoco.rollout``, which returns the final positions and velocities (N, nq + nv)."""
    import mujoco
    import mujoco.rollout

    model = mujoco.MjModel.from_xml_string(f"{HEAD}{CHASER}{CUBE}</worldbody>{actuators()}</mujoco>")
    model.opt.timestep = step_s
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    count = round(scene.scenario.simulation.duration / step_s)
    # a command is held for a step: that of its middle is the most accurate
    middles = (np.arange(count) + 0.5) * step_s
    commands = np.array(AMPLITUDE) * np.sin(2 * np.pi * np.outer(middles, FREQUENCY))
    controls = np.tile(commands, (COUNT, 1, 1))
    data, kind = mujoco.MjData(model), mujoco.mjtState.mjSTATE_FULLPHYSICS
    data.qpos[:], data.qvel[:] = coordinates(scene, scene.q, scene.v)
    first = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, first, kind)
    starts = np.tile(first, (COUNT, 1))  # time, positions, velocities
    starts[:, 1 + model.joint("shoulder").qposadr[0]] = np.radians(angles_deg())
    states = np.empty((COUNT, count, len(first)))
    workers = [mujoco.MjData(model) for _ in range(THREADS)]

    def run() -> Array:
        mujoco.rollout.rollout(model, workers, starts, controls, nstep=count, state=states)
        return np.array(states[:, -1, 1 : 1 + model.nq + model.nv])

    return run


def compared(
    scene: Scene,
    rollout: Rollout,
    integrator: str,
    our_errors: Mapping[float, float],
    reference: Array,
) -> IntegratorOutcome:
    """Errors and times of one of MuJoCo's integrators, and ours, taking turns."""
    theirs = their_job(scene, integrator, THEIR_STEP_S)
    error = distance(theirs(), reference)
    step = max((step for step in OUR_STEPS_S if our_errors[step] <= error), default=OUR_STEPS_S[-1])
    ours = our_job(rollout, step)
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(TURNS):
        for job, spent in zip((ours, theirs), times, strict=True):
            spent.append(timed(job)[1])
    medians = [statistics.median(each) for each in times]
    return IntegratorOutcome(integrator, step, medians[0], medians[1], our_errors[step], error)


def measure() -> Outcome:
    """Each of MuJoCo's integrators at mjorbit's step, against ours at no greater error."""
    (scene, rollout), prepare_s = timed(lambda: our_rollout({}))
    nq, nv, duration = scene.model.nq, scene.model.nv, scene.scenario.simulation.duration

    def converted(states: Array) -> Array:
        """Final states in MuJoCo's coordinates (N, nq + nv)."""
        return np.array([np.concatenate(coordinates(scene, x[:nq], x[nq : nq + nv])) for x in states])

    reference = converted(our_job(rollout, REFERENCE_S)())
    agreement = distance(their_job(scene, "RK4", REFERENCE_S)(), reference)
    our_errors = {step: distance(converted(our_job(rollout, step)()), reference) for step in OUR_STEPS_S}
    outcomes = [compared(scene, rollout, integrator, our_errors, reference) for integrator in INTEGRATORS]
    best = min(outcomes, key=lambda one: one.ratio)
    same_step_s = statistics.median(timed(our_job(rollout, THEIR_STEP_S))[1] for _ in range(TURNS))
    _, in_orbit = our_rollout(ORBIT)
    in_orbit_s = statistics.median(timed(our_job(in_orbit, THEIR_STEP_S))[1] for _ in range(TURNS))
    same_step = f"at {THEIR_STEP_S * 1e3:g} ms {rate(same_step_s, THEIR_STEP_S, duration)}"
    same_step += f", error {our_errors[THEIR_STEP_S]:.0e}"
    same_step += f"; the same in orbit {rate(in_orbit_s, THEIR_STEP_S, duration)}"
    others = [
        f"{one.integrator} {rate(one.their_s, THEIR_STEP_S, duration)}, error {one.their_error:.0e}"
        for one in outcomes
        if one is not best
    ]
    numbers = {"outcomes": [dataclasses.asdict(one) for one in outcomes], "in_orbit_s": in_orbit_s}
    numbers |= {"agreement": agreement, "our_errors": {f"{k:g} s": v for k, v in our_errors.items()}}
    return Outcome(
        f"state {agreement:.0e}",
        f"{best.our_error:.0e} / {best.their_error:.0e}",
        best.our_s,
        best.their_s,
        f"tanaka6, {best.our_step_s * 1e3:g} ms, {rate(best.our_s, best.our_step_s, duration)} "
        f"({same_step}); compiled in {prepare_s:.1f} s",
        f"{best.integrator}, {THEIR_STEP_S * 1e3:g} ms, {rate(best.their_s, THEIR_STEP_S, duration)} "
        f"({'; '.join(others)})",
        numbers,
    )


TITLE = f"{COUNT} chasers with a two-link arm, position control, and a cube, 10 s, {THREADS} threads"
NOTE = (
    "`mujoco.rollout`; scene of mjorbit's `capture_arm`, without contact and orbit; MuJoCo at mjorbit's "
    "step, ours at the longest with no greater error; errors of final states; steps/s of each core"
)
SCENE = PeerScene("MuJoCo", "mujoco", TITLE, NOTE, measure)
