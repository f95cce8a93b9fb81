"""The second opinion: the same closed loop, written again over Pinocchio's own algorithms."""

from tests.oracles.engine.contacts import contact_of
from tests.oracles.engine.engine import Engine
from tests.oracles.engine.environments import environment_of
from tests.oracles.engine.grasps import grasp_of
from tests.oracles.engine.references import leading, path_of, turn_of
from tests.oracles.engine.robot_law import robot_law
from tests.oracles.engine.sensing import reading_of
from tests.oracles.engine.tip_control import tip_law

__all__ = [
    "Engine",
    "contact_of",
    "environment_of",
    "grasp_of",
    "leading",
    "path_of",
    "reading_of",
    "robot_law",
    "tip_law",
    "turn_of",
]
