"""A cache of their own for the tests of compiled code."""

from __future__ import annotations

import pytest


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory):
    patch = pytest.MonkeyPatch()
    patch.setenv("SPACEROBOT_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
    yield
    patch.undo()
