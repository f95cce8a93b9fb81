"""What every test has: a cache of compiled code that is this test run's own, shared by its processes."""

import pytest


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory, request):
    place = tmp_path_factory.getbasetemp()
    if hasattr(request.config, "workerinput"):  # each of xdist's processes has a folder inside the run's
        place = place.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPACEROBOT_CACHE_DIR", str(place / "compiled"))
        yield
