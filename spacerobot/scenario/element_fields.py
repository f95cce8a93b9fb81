"""Types of fields with elements: the base class for type checkers, the class of the kind at validation.

The module imports no element. A scenario loads only the kinds that it names.
"""

from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from spacerobot.elements.core.registry import Family

__all__ = [
    "Actuator",
    "ApproachCone",
    "CollisionShape",
    "Contact",
    "Environment",
    "Estimator",
    "FlexibleLink",
    "Goal",
    "Grasp",
    "JointPd",
    "KeepOut",
    "LineOfSight",
    "Pid",
    "PlanLimit",
    "Reference",
    "RobotController",
    "Sensor",
    "TipController",
]

if TYPE_CHECKING:
    from spacerobot.elements.actuators.actuator import Actuator
    from spacerobot.elements.contacts.contact import Contact
    from spacerobot.elements.controllers.controller import RobotController, TipController
    from spacerobot.elements.environments.environment import Environment
    from spacerobot.elements.estimators.estimator import Estimator
    from spacerobot.elements.flexible.flexible_link import FlexibleLink
    from spacerobot.elements.goals.goal import Goal
    from spacerobot.elements.grasps.grasp import Grasp
    from spacerobot.elements.limits.plan_limit import PlanLimit
    from spacerobot.elements.references.reference import Reference
    from spacerobot.elements.sensors.sensor import Sensor
    from spacerobot.elements.shapes.collision_shape import CollisionShape

    Pid: TypeAlias = TipController
    JointPd: TypeAlias = RobotController
    KeepOut: TypeAlias = PlanLimit
    ApproachCone: TypeAlias = PlanLimit
    LineOfSight: TypeAlias = PlanLimit
else:
    Actuator = Annotated[Any, Family("actuator")]
    Contact = Annotated[Any, Family("contact", default="hunt_crossley")]
    Pid = Annotated[Any, Family("tip_controller", only="pid")]
    TipController = Annotated[Any, Family("tip_controller")]
    JointPd = Annotated[Any, Family("robot_controller", only="joint_pd")]
    RobotController = Annotated[Any, Family("robot_controller")]
    Environment = Annotated[Any, Family("environment")]
    Estimator = Annotated[Any, Family("estimator")]
    FlexibleLink = Annotated[Any, Family("flexible_link")]
    Goal = Annotated[Any, Family("goal")]
    Grasp = Annotated[Any, Family("grasp")]
    PlanLimit = Annotated[Any, Family("plan_limit")]
    KeepOut = Annotated[Any, Family("plan_limit", only="keep_out")]
    ApproachCone = Annotated[Any, Family("plan_limit", only="approach_cone")]
    LineOfSight = Annotated[Any, Family("plan_limit", only="line_of_sight")]
    Reference = Annotated[Any, Family("reference")]
    Sensor = Annotated[Any, Family("sensor", default="linear")]
    CollisionShape = Annotated[Any, Family("shape")]
