"""Drafts of scenarios: from URDFs to a file that was simulated before it is written, ready to edit."""

from spacerobot.common.lazy_names import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
