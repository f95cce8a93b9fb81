"""The closed loop: references, sensors, controllers and grasps around the plant."""

from spacerobot.closedloop.build import build_closed_loop
from spacerobot.closedloop.closed_loop import ClosedLoop

__all__ = ["ClosedLoop", "build_closed_loop"]
