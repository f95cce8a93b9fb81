"""Generalized forces of a scene's environments, without the rest of the closed loop, for plans."""

from __future__ import annotations

import casadi as ca

from spacerobot.closedloop.build import builder_of
from spacerobot.closedloop.loop_builder import LoopBuilder
from spacerobot.dynamics.algebra import cross
from spacerobot.elements.environments.environment import EnvironmentContext
from spacerobot.scene import Scene


def environment_forces(scene: Scene) -> ca.Function | None:
    """Generalized forces (nv x 1) [N, N m] of the environments as a function of q (nq x 1) and v (nv x 1).

    Args:
        scene: The scene.

    Returns:
        casadi.Function or None: The function; None where the scene has no environment.

    Raises:
        ScenarioError: If an environment acts differently at another time.
    """
    if not scene.scenario.environment:
        return None
    builder = builder_of(LoopBuilder, scene)
    plant, context = builder.plant, builder.context
    roots = {body.name: body.root_frame for body in scene.bodies}
    forces = ca.SX(scene.model.nv, 1)
    for name, element in scene.scenario.environment.items():
        section = context.at(f"environment.{name}")
        wrenches = element.build(EnvironmentContext(section, plant, roots)).outside
        effort = ca.SX(scene.model.nv, 1)
        for wrench in wrenches:
            # virtual power of the wrench: F.(v_o + w x (p - o)) + T.w at the joint's origin o
            origin, joint = plant.kinematics.origin[wrench.joint_id], wrench.joint_id
            velocity, spin = plant.kinematics.linear_velocity[joint], plant.kinematics.angular_velocity[joint]
            moment = wrench.torque + cross(wrench.point - origin, wrench.force)
            effort += ca.jtimes(velocity, plant.v, wrench.force, True)
            effort += ca.jtimes(spin, plant.v, moment, True)
        if ca.depends_on(effort, context.time):
            raise scene.error(
                "found forces that depend on time, allowed in plans: those of position and velocity alone; "
                "for an orbit give `axes: rotating`",
                f"environment.{name}",
            )
        forces += effort
    parameters, constants = context.parameters, context.constants
    expressions = ca.substitute(constants.expressions, parameters.symbols, ca.SX(parameters.values))
    forces = ca.substitute(forces, constants.symbols, ca.evalf(expressions))
    return ca.Function("environment", [plant.q, plant.v], [ca.densify(forces)], ["q", "v"], ["force"])
