"""Tuning: variables, objectives, evolutionary methods, NLP, and an honest comparison between them.

The names of ``__init__.pyi`` are loaded when they are first used. Campaigns are in :mod:`optim.campaign`.
"""

from spacerobot.common.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
