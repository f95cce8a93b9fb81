"""Drafts of scenarios from URDFs, simulated before they are written."""

from spacerobot.common.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
