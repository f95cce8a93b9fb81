"""Pictures of a result: browser animation, figures, report.

The names of ``__init__.pyi`` are loaded when they are first used.
Each figure is a function of :mod:`viz.figures`.
"""

from spacerobot.common.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
