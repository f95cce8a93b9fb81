"""Start of model predictive control: grasps that hold and joints that are locked when its phase begins."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from optim.planning.mpc.measured_state import HELD, Readings, moved
from optim.planning.verification.replay import joint_angle
from spacerobot.closedloop import ClosedLoop
from spacerobot.common.arrays import Array
from spacerobot.dynamics.inertial_parameters import PLANAR, is_realisable
from spacerobot.scenario.bodies import Robot
from spacerobot.scenario.load import to_document
from spacerobot.scene import Scene, build_scene
from spacerobot.scene.grasp_closing import begun, is_rigid
from spacerobot.scene.scene import SceneGrasp

Places = NDArray[np.int64]


@dataclass(frozen=True)
class Handover:
    """Scene for which plans are made, and its place in the simulated scene.

    Attributes:
        simulated_scene: The simulated scene.
        scene: The planned scene, without phases, with held grasps closed and locked joints fixed.
        begin_s: Simulation time at which plans begin [s].
        q, v: Indices of the planned configuration and velocity in the simulated ones.
        locked: Positions of locked joints [rad or m], by ``robot/joint``.
    """

    simulated_scene: Scene
    scene: Scene
    begin_s: float
    q: Places
    v: Places
    locked: Mapping[str, float]

    @classmethod
    def at_start(cls, scene: Scene) -> Handover:
        """Handover at the start of the simulation."""
        return cls(scene, scene, 0.0, np.arange(scene.model.nq), np.arange(scene.model.nv), {})

    @classmethod
    def at(cls, scene: Scene, loop: ClosedLoop, start: Array) -> Handover:
        """Handover at a later instant.

        Args:
            scene, loop: The simulated scene, and its closed loop.
            start: Time, state and switches at that instant (1 + nx + ns,).

        Raises:
            ScenarioError: If a closed grasp is not rigid, or the scene cannot be built with the locked
                joints.
        """
        model, switched = scene.model, dict(zip(loop.switch_names, start[1 + loop.nx :] > 0.5, strict=True))
        state = start[1 : 1 + model.nq + model.nv]
        changes: list[tuple[str, Any]] = [("phases", {})]
        for grasp in scene.grasps:
            closed = switched.get(f"{grasp.path}.closed", grasp.config.begins == "closed")
            if closed and not is_rigid(grasp):
                raise scene.error(
                    f"found {grasp.config.kind!r}, whose springs are strained where plans begin; "
                    "allowed there: rigid grasps",
                    grasp.path,
                )
            changes.append((f"{grasp.path}.begins", "closed" if closed else "open"))
        locked, document = {}, to_document(scene.scenario)
        for body in scene.robots:
            assert isinstance(body.config, Robot)
            actuators = {
                key: document["robots"][body.name]["actuators"][key]
                for key, one in body.config.actuators.items()
                if not one.fails_joints and not one.detects_failures  # of joints that are no longer there
            }
            changes.append((f"{body.path}.actuators", actuators))
            for joint in body.driven_joints:
                name = body.joint_name(model, joint)
                label = f"{body.name}/{name}"
                if not switched.get(f"{label}.held") or switched.get(f"{label}.runs"):
                    continue
                locked[label] = angle = joint_angle(model.joints[joint], state)
                kind = next(one.kind for one in body.description.joints if one.name == name)
                position = {"offset": angle} if kind == "prismatic" else {"angle_deg": np.degrees(angle)}
                changes.append((f"{body.path}.joints.{name}", {"locked": True} | position))
        built = build_scene(scene.scenario, changes, source=scene.source)
        places: tuple[list[int], list[int]] = ([], [])
        for joint in range(1, built.model.njoints):
            old = model.joints[model.getJointId(built.model.names[joint])]
            places[0].extend(range(old.idx_q, old.idx_q + old.nq))
            places[1].extend(range(old.idx_v, old.idx_v + old.nv))
        q, v = (np.array(part, dtype=np.int64) for part in places)
        q0, v0 = state[q], state[model.nq + v]
        for array in (q0, v0):
            array.setflags(write=False)
        return cls(scene, dataclasses.replace(built, q=q0, v=v0), float(start[0]), q, v, locked)

    @property
    def held(self) -> tuple[SceneGrasp, ...]:
        """Grasps that hold the target rigidly at the handover, in the simulated scene."""
        names = {grasp.name for grasp in begun(self.scene.grasps) if is_rigid(grasp)}
        return tuple(g for g in self.simulated_scene.grasps if g.name in names and g.config.fixes_orientation)

    def planned(self, state: Array) -> Array:
        """State of the planned scene (n, nq + nv) from that of the simulated one (n, ...)."""
        nq = self.simulated_scene.model.nq
        return np.hstack([state[:, self.q], state[:, nq + self.v]])

    def inertia(self, readings: Readings, state: Array) -> Array | None:
        """Estimate of the target's inertial parameters in its root joint's axes (10,).

        None if no filter estimates them, the tip holds no object, or the estimate is physically impossible;
        the next plan then uses the previous estimate.

        Args:
            readings: Sensor readings; estimates are in axes of the tip.
            state: Estimated configuration and velocity (nq + nv,).
        """
        for grasp in self.held:
            label = grasp.tip.label
            if (f"{HELD}mass", label) not in readings or self.simulated_scene.target is None:
                continue
            mass, moment, moments, products = (
                readings[f"{HELD}{key}", label] for key in ("mass", "first_moment", "moments", "products")
            )
            (xx, yy, zz), (xy, xz, yz) = moments, products
            parameters = np.array([*mass, *moment, xx, xy, yy, xz, yz, zz])
            if not is_realisable(parameters[list(PLANAR)] if self.simulated_scene.planar else parameters):
                continue
            model = self.simulated_scene.model
            data = moved(model, state[: model.nq], state[model.nq :])
            grip = data.oMf[grasp.tip.frame].actInv(data.oMi[self.simulated_scene.target.root_joint])
            there = grip.actInv(pin.Inertia.FromDynamicParameters(parameters))
            return np.array(there.toDynamicParameters())
        return None
