"""The jump of the velocity where rigid grasps close: the plastic impact of what they join."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin

from optim.planning.formulation.grasps import tip_slip
from optim.planning.formulation.stage import Stage
from spacerobot.arrays import Array


def state_after_impact(stage: Stage, state: Array, *, locked: bool = False) -> Array:
    """State (nq + nv,) behind the impact that joins what a phase's rigid grasps hold.

    Parameters
    ----------
    stage
        An instant of the phase.
    state
        Before it (nq + nv,).
    locked
        Whether it stops the joints too.
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
