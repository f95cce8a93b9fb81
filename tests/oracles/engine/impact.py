"""Plastic impacts: impulses that stop the relative motion of all rigid grasps that hold, at one instant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spacerobot.common.arrays import Array
from tests.oracles.engine.engine import Engine
from tests.oracles.engine.grasps import Constraint, grasp_of
from tests.oracles.engine.kinematics import Kinematics


@dataclass(frozen=True)
class Impact:
    """A plastic impact.

    Attributes:
        velocity: Afterwards (nv,).
        impulses: On the target at the tip's point, force and couple (6,), by the grasp's name [N s, N m s].
        loss: Kinetic energy of the change of velocity [J], which is what it takes.
    """

    velocity: Array
    impulses: dict[str, Array]
    loss: float


def strike(engine: Engine, kinematics: Kinematics, t: float) -> Impact:
    """Impact on all rigid grasps that hold in the present mode: ``M dv + G^T w = 0``, ``G v+ = 0``."""
    held = []
    for grasp in engine.now.scene.grasps:
        if grasp.config.is_rigid and engine.is_closed(grasp.name):
            relative = engine.relative(kinematics, grasp, t)
            found = grasp_of(grasp.config, engine.scene, grasp, relative)
            if isinstance(found, Constraint):
                held.append(found)
    spread, nv = engine.scene.spread, engine.model.nv
    ties = (np.eye(nv) - spread)[np.diag(spread) == 0]
    rows = np.vstack([*(one.jacobian for one in held), ties])
    inertia = kinematics.inertia
    slips = [one.relative.velocity[one.rows] for one in held]
    matrix = np.block([[inertia, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
    right = np.concatenate([np.zeros(nv), *(-slip for slip in slips), np.zeros(len(ties))])
    change, reaction = np.split(np.linalg.solve(matrix, right), [nv])
    impulses, used = {}, 0
    for one in held:
        whole = np.zeros(6)
        whole[one.rows] = reaction[used : used + len(one.rows)]
        impulses[one.grasp.name], used = whole, used + len(one.rows)
    return Impact(kinematics.v + change, impulses, float(change @ inertia @ change) / 2)
