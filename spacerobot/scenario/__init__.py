"""Scenarios: validated descriptions of robots, target, grasps, phases and jobs."""

from spacerobot.common.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
