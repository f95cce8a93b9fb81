"""Elements: references, grasps, actuators, environments, ...; a kind is one file, section and law."""

from spacerobot.common.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
