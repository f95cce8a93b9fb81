"""The small scene of the campaigns' tests."""

from tests.optim.campaign.conftest import small, small_file

__all__ = ["small", "small_file"]
