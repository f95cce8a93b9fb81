"""Pages of the shared results, whose contents are worked out once."""

import pytest

from viz.page.animation import animation


@pytest.fixture(scope="package", autouse=True)
def _once():
    made = {}

    def remembered(*results, **options):
        key = (*map(id, results), *sorted(options.items()))
        if key not in made:
            made[key] = results, animation(*results, **options)  # with its results, whose ids are then theirs
        return made[key][1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("viz.page.page.animation", remembered)
        yield
