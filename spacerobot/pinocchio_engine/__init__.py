"""The second opinion: the same closed loop, written again over Pinocchio's own algorithms."""

from spacerobot.pinocchio_engine import base_control as _base_control  # noqa: F401 (a writing of its own)
from spacerobot.pinocchio_engine import base_tracking as _base_tracking  # noqa: F401 (likewise)
from spacerobot.pinocchio_engine import planned as _planned  # noqa: F401 (a writing of its own)
from spacerobot.pinocchio_engine import rendezvous as _rendezvous  # noqa: F401 (a writing of its own)
from spacerobot.pinocchio_engine import resolved_rate as _resolved_rate  # noqa: F401 (a writing of its own)
from spacerobot.pinocchio_engine import thrusters as _thrusters  # noqa: F401 (a writing of its own)
from spacerobot.pinocchio_engine.contacts import contact_of
from spacerobot.pinocchio_engine.engine import Engine
from spacerobot.pinocchio_engine.environments import environment_of
from spacerobot.pinocchio_engine.events import KINDS as EVENTS
from spacerobot.pinocchio_engine.grasps import grasp_of
from spacerobot.pinocchio_engine.references import leading, path_of, turn_of
from spacerobot.pinocchio_engine.robot_law import robot_law
from spacerobot.pinocchio_engine.sensing import reading_of
from spacerobot.pinocchio_engine.simulate import Checked, simulate
from spacerobot.pinocchio_engine.tip_control import tip_law

__all__ = [
    "EVENTS",
    "Checked",
    "Engine",
    "contact_of",
    "environment_of",
    "grasp_of",
    "leading",
    "path_of",
    "reading_of",
    "robot_law",
    "simulate",
    "tip_law",
    "turn_of",
]
