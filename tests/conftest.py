"""What every test has: a cache of compiled code of this test run's own, and markers for what tests need.

Code is compiled in a hurry, but as for users where compilers or rollouts are tested.
"""

import gc
import os
import signal

import pytest

from spacerobot.rollout.virtual_machine import load_loops

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as a shell has it for what it runs in the background
    signal.signal(signal.SIGINT, signal.default_int_handler)

# else each process that a test starts compiles every module again, which takes it 0.3 s
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

os.environ.pop("COLUMNS", None)  # which pytest's workers set: tests of narrow terminals set their own

FIXTURES = {"browser": {"browser"}, "dask": {"dask", "cluster"}}
"""Fixtures whose tests have a marker."""

PLACES = {
    "compiler": (
        "tests/compiled/",
        "tests/fmu/",
        "tests/rollout/test_batch.py::test_lanes_equal_single_rollouts",
        "tests/rollout/test_batch.py::test_where_many_are_wanted",
        "tests/rollout/test_edges.py::test_a_scene_without_target_and_grasps",
        "tests/rollout/test_gradients.py::test_a_peak_at_the_end_is_the_final_value",
        "tests/rollout/test_gradients.py::test_adjoint_equals_central_differences",
        "tests/rollout/test_gradients.py::test_checkpoints_change_nothing",
        "tests/rollout/test_rollout_run.py::test_a_motion_of_its_own_is_stepped_onto",
        "tests/rollout/test_rollout_run.py::test_compiled_equals_interpreted",
    ),
    "dask": (
        "tests/optim/campaign/test_campaign_cluster.py",
        "tests/optim/campaign/rollouts/test_campaign_series.py::test_a_worker_of_dask",
        "tests/optim/robust/test_robust_tuning.py::test_dask",
        "tests/optim/workers/test_workers.py::test_a_lost_scheduler",
        "tests/optim/workers/test_workers.py::test_a_terminals_ctrl_c",
        "tests/optim/workers/test_workers.py::test_a_worker_of_another_version",
    ),
}
"""Other tests that have a marker, by how their names begin; a parameter ``compiled`` needs a compiler too."""


def needs(item):
    """Markers of a test."""
    found = {marker for marker, fixtures in FIXTURES.items() if fixtures & set(item.fixturenames)}
    found |= {marker for marker, places in PLACES.items() if item.nodeid.startswith(places)}
    if "compiled" in (item.callspec.params.values() if hasattr(item, "callspec") else ()):
        found.add("compiler")
    return found


def pytest_collection_modifyitems(items):
    """Mark what needs a compiler, a browser or Dask, so that ``-m 'not browser'`` leaves it out."""
    for item in items:
        for marker in needs(item):
            item.add_marker(marker)


def pytest_collection_finish():
    """Collect garbage of tests alone: each collection would look through all modules and tests again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)


@pytest.fixture
def undrawn(monkeypatch):
    """No figure of a report is drawn: what pages say is what is tested."""
    for home in ("report.sections", "report.campaign_section", "figures.comparison"):
        monkeypatch.setattr(f"viz.{home}.to_bytes", lambda *_: b"<svg/>")
    monkeypatch.setattr("viz.report.sections.draw_all", lambda *_, **__: ())


@pytest.fixture(scope="session")
def bounce():
    """The shipped scene with contact, simulated."""
    from spacerobot.scene import load_scene
    from spacerobot.simulation import simulate

    return simulate(load_scene("bounce"))


@pytest.fixture(autouse=True)
def _own_plugins():
    """Commands that later tests print do not load what a test has loaded as a plugin."""
    from spacerobot.elements.core import registry

    before = dict(registry._PLUGINS)
    yield
    registry._PLUGINS.clear()
    registry._PLUGINS.update(before)


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory, request):
    place = tmp_path_factory.getbasetemp()
    if hasattr(request.config, "workerinput"):  # each of xdist's processes has a folder inside the run's
        place = place.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPACEROBOT_CACHE_DIR", str(place / "compiled"))
        patch.setenv("SPACEROBOT_COMPILER_FLAGS", f"-O0 {FLAGS}")  # of what the whole session shares
        load_loops()  # while there is a compiler
        yield


AS_FOR_USERS = ("tests/compiled/", "tests/rollout/")
INTERPRETED = (
    "tests/cli/test_damaged_folders.py",
    "tests/examples/",
    "tests/optim/campaign/rollouts/test_campaign_trust.py",
    "tests/optim/campaign/test_campaign_cli.py",
    "tests/optim/comparison/test_comparison.py",
    "tests/optim/problem/",
    "tests/optim/robust/test_worst_margins.py",
)
"""Where rollouts are so few and so short that to compile them takes longer than they do."""

LARGE = (
    "tests/cli/",
    "tests/contacts/",
    "tests/docs/",
    "tests/drafting/",
    *(
        f"tests/elements/test_{name}.py"
        for name in (
            "attitude_filter",
            "inertia_filter",
            "joint_failure",
            "reaction_wheels",
            "sampling",
            "sensor_errors",
            "transmissions",
        )
    ),
    "tests/fmu/",
    "tests/pinocchio_engine/",
    "tests/result/",
    "tests/rollout/test_crossings.py",
    "tests/rollout/test_edges.py",
    "tests/rollout/test_event_gradients.py",
    "tests/rollout/test_events.py",
    "tests/rollout/test_gradients.py",
    "tests/rollout/test_step_choice.py",
    "tests/scene/",
    "tests/viz/",
)
"""Where few rollouts take less time than to optimise their code."""

COMPILER = os.environ.get("SPACEROBOT_COMPILER")
FLAGS = os.environ.get("SPACEROBOT_COMPILER_FLAGS", "")
"""Compiler and its arguments of this test run, such as ``-march=x86-64`` for two lanes."""


@pytest.fixture(scope="module", autouse=True)
def _in_a_hurry(request):
    with pytest.MonkeyPatch.context() as patch:
        if request.node.nodeid.startswith(INTERPRETED):
            patch.setenv("SPACEROBOT_COMPILER", "none")
        if request.node.nodeid.startswith(LARGE):
            pass  # as the whole session
        elif request.node.nodeid.startswith(AS_FOR_USERS):
            patch.setenv("SPACEROBOT_COMPILER_FLAGS", FLAGS)
        else:
            patch.setenv("SPACEROBOT_COMPILER_FLAGS", f"-O1 {FLAGS}")
        yield


@pytest.fixture
def interpreted(monkeypatch):
    """Nothing is compiled: for few short rollouts."""
    monkeypatch.setenv("SPACEROBOT_COMPILER", "none")


@pytest.fixture
def compiled(monkeypatch):
    """Rollouts are compiled where those of other tests are not: for batches in lanes."""
    if COMPILER is None:
        monkeypatch.delenv("SPACEROBOT_COMPILER", raising=False)
    else:
        monkeypatch.setenv("SPACEROBOT_COMPILER", COMPILER)
