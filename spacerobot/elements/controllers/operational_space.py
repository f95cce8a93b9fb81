r"""Tip accelerations by joint torques, with a base that reacts and a measured wrench on the tip.

With the base eliminated, joint torques $\tau$ and a wrench $f$ on the tip accelerate it by

$$ \ddot x = \gamma + \Lambda^{*-1} u + W f, \qquad \tau = J^{*\top} u, \qquad
   \Lambda^{*-1} = J^* H^{*-1} J^{*\top}, \qquad W = \Lambda^{*-1} + J_b H_b^{-1} J_b^\top, $$

with the generalized Jacobian $J^* = J_m - J_b H_b^{-1} H_{bm}$ (Umetani and Yoshida 1989), the inertia
$H^* = H_m - H_{bm}^\top H_b^{-1} H_{bm}$ of the joints, and the acceleration $\gamma$ without torques and
wrench. The second part of $W$ is the motion of the base that a wrench from outside causes and joint torques
do not. A desired acceleration $a$ then takes

$$ u = \Lambda^* (a - \gamma - W f) $$

(Khatib 1987 for a fixed base). $x$ stacks all directions in which controllers of the robot's tips act, and
$f$ the wrenches on all its tips: torques for one tip, or for its translation, do not accelerate another one,
or its rotation. Torques and forces of base actuators are left out, as disturbances.
"""

from __future__ import annotations

from typing import Literal

import casadi as ca

from spacerobot.common.errors import ScenarioError
from spacerobot.dynamics.algebra import SymmetricFactors
from spacerobot.elements.controllers.free_base import FreeBase
from spacerobot.elements.core.context import TipContext
from spacerobot.elements.core.contribution import ControlChannel


def accelerating(
    tip: TipContext, motion: Literal["translation", "rotation"], acceleration: ca.SX, wrench: ca.SX
) -> ControlChannel:
    """Channel of the joint torques that give a tip an acceleration.

    Args:
        tip: The tip.
        motion: Motion to accelerate: translation or rotation.
        acceleration: Desired acceleration (3x1), world axes [m/s^2 or rad/s^2].
        wrench: Wrench on the tip about its origin (6x1), world axes [N, N m].

    Raises:
        ScenarioError: If the arm has fewer joints than its controlled motions need.
    """
    plant, columns = tip.plant, list(tip.columns)
    turns = motion == "rotation"
    axes = list(plant.rotation_axes if turns else plant.translation_axes)
    rows = [axis + 3 * turns for axis in axes]
    peers = tip.peers()
    jacobians = [other_tip.generalized_jacobian[:, columns] for other_tip in (tip, *peers)]
    coupled = [6 * k + row for k, other_tip in enumerate((tip, *peers)) for row in other_tip.controlled_rows]
    if len(columns) < len(coupled):
        raise ScenarioError(
            f"found {len(columns)} joints, allowed to accelerate {len(coupled)} directions of the robot's "
            f"tips: at least {len(coupled)}; use `impedance` without `inertia`",
            where=tip.context.path,
        )
    free = FreeBase.of(plant, tip.base_joint, columns)
    load = free.bias + plant.gathered(plant.damping * plant.v)[columns]
    by_joints, size = ca.vertcat(*jacobians), 6 * len(jacobians)
    response = SymmetricFactors(free.inertia).solve(ca.horzcat(by_joints.T, load))
    mobility = ca.mtimes(by_joints, response[:, :size])
    drift = ca.vertcat(*plant.drift(tip.frame)) - ca.mtimes(jacobians[0], response[:, size])
    by_wrenches = mobility[:6, :]
    if free.factors is not None:
        by_base = [
            plant.gathered(plant.jacobian(other_tip.frame).T).T[:, free.base] for other_tip in (tip, *peers)
        ]
        drift = drift + ca.mtimes(by_base[0], free.falling)
        by_wrenches += ca.mtimes(by_base[0], free.factors.solve(ca.vertcat(*by_base).T))
    wrenches = ca.vertcat(wrench, *(other_tip.measured_wrench() for other_tip in peers))
    demand = (acceleration - (drift + ca.mtimes(by_wrenches, wrenches))[3 * turns : 3 * turns + 3])[axes]
    unit = ca.SX.eye(len(coupled))[:, [coupled.index(row) for row in rows]]
    inertia = SymmetricFactors(mobility[coupled, coupled]).solve(unit)
    rates = ca.vertcat(*(other_tip.generalized_jacobian for other_tip in (tip, *peers)))
    actuation = ca.mtimes(rates[coupled, :].T, inertia)
    _, sense = tip.reduced_loads(axes, rotation=turns)
    return ControlChannel(tip.robot, actuation, plant.reduced(actuation), sense, demand, None)
