"""Descriptions of robots and objects: search, reading, checks and writing of URDF and MJCF."""

from spacerobot.common.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
