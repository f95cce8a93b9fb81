"""Closed loops kept between runs: the same to the bit, and never those of something else."""

from __future__ import annotations

import hashlib
import pickle
import stat
import subprocess
import sys
import zlib

import numpy as np
import pytest

from spacerobot.closedloop import loop_cache as kept
from spacerobot.closedloop.loop_cache import SUFFIX, cached_closed_loop
from spacerobot.common.errors import ScenarioError, SpaceRobotWarning
from spacerobot.elements.core import registry
from spacerobot.rollout import build_rollout
from spacerobot.scene import load_scene
from tests.oracles import one_arm


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("SPACEROBOT_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache" / "compiled"


@pytest.fixture
def file(tmp_path):
    return one_arm.write(tmp_path)


@pytest.fixture(autouse=True)
def shipped_kinds(monkeypatch):
    """Kinds that ship alone: an earlier test of this process may have registered others."""
    for family, home in registry._HOMES.items():
        own = {
            name: kind for name, kind in registry.kinds(family).items() if kind.__module__.startswith(home)
        }
        monkeypatch.setitem(registry._KINDS, family, own)


@pytest.fixture
def builds(monkeypatch):
    """What was built, one entry for each time."""
    done, build = [], kept.build_closed_loop
    monkeypatch.setattr(kept, "build_closed_loop", lambda *given: done.append(given) or build(*given))
    return done


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_the_second_time_nothing_is_built_and_nothing_differs(file, folder, builds):
    scene = load_scene(file)
    built, again = cached_closed_loop(scene), cached_closed_loop(load_scene(file))
    assert len(builds) == 1
    (path,) = folder.iterdir()
    assert path.suffix == SUFFIX
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    one, two = (build_rollout(loop, duration_s=0.1, step_s=0.01) for loop in (built, again))
    assert two.engines.single.loops.library.cached  # the generated source is the same
    assert np.array_equal(one.run().state, two.run().state)
    assert [getattr(built, f) for f in ("variables", "works", "max_gaps", "jumps", "outside")] == [
        getattr(again, f) for f in ("variables", "works", "max_gaps", "jumps", "outside")
    ]


def test_another_process_finds_it(file, folder, builds):
    program = (
        "from spacerobot.closedloop import loop_cache; from spacerobot.scene import load_scene;"
        f"loop_cache.cached_closed_loop(load_scene({str(file)!r}))"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
    cached_closed_loop(load_scene(file))
    assert not builds


def test_another_number_model_or_choice_is_another_entry(file, folder, builds, tmp_path):
    scene = load_scene(file)
    cached_closed_loop(scene)
    cached_closed_loop(load_scene(file, {"robots.arm.tips.tip.pid.kp": 1.0}))
    cached_closed_loop(scene, vary=["target.links.body.com.1"])
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(urdf.read_text(encoding="utf-8") + "<!-- -->", encoding="utf-8")
    cached_closed_loop(load_scene(file))
    scene.model.inertias[3].mass += 1.0  # by a user in Python
    cached_closed_loop(scene)
    assert len(builds) == len(names(folder)) == 5


def test_another_source_of_this_package_is_another_entry(file, folder, builds, monkeypatch):
    scene = load_scene(file)
    cached_closed_loop(scene)
    monkeypatch.setattr(kept, "_code", lambda: "another")
    cached_closed_loop(scene)
    assert len(builds) == 2


def test_kinds_of_a_users_own_are_always_built(file, folder, builds, monkeypatch):
    own = type("Own", (), {"__module__": "spacerobot_plugin_own", "fills": None})
    monkeypatch.setitem(registry._KINDS["reference"], "own", own)
    for _ in range(2):
        cached_closed_loop(load_scene(file))
    assert len(builds) == 2
    assert not folder.exists()


@pytest.mark.parametrize("damage", [b"", b"no closed loop", None])
def test_a_damaged_entry_is_built_again(file, folder, builds, damage):
    scene = load_scene(file)
    cached_closed_loop(scene)
    (path,) = folder.iterdir()
    path.write_bytes(path.read_bytes()[:-100] if damage is None else damage)
    cached_closed_loop(scene)
    assert len(builds) == 2
    cached_closed_loop(scene)
    assert len(builds) == 2


@pytest.mark.parametrize(
    "content", [b"", b"no closed loop", zlib.compress(b"no pickle"), zlib.compress(pickle.dumps([1]))]
)
def test_an_entry_that_is_no_loop_under_the_right_digest_is_built_again(file, folder, builds, content):
    scene = load_scene(file)
    cached_closed_loop(scene)
    (path,) = folder.iterdir()
    path.write_bytes(content)
    digest = hashlib.sha256(content).hexdigest()[:32]
    path.rename(path.with_name(f"{path.name.partition('-')[0]}-{digest}{SUFFIX}"))
    for _ in range(2):
        assert cached_closed_loop(scene).nx
        assert len(builds) == 2


def test_nothing_is_loaded_from_a_folder_that_others_may_write(file, folder, builds):
    scene = load_scene(file)
    cached_closed_loop(scene)
    folder.chmod(0o777)
    with pytest.warns(SpaceRobotWarning, match="can be written by others"):
        cached_closed_loop(scene)
    assert len(builds) == 2


def test_a_full_disk_ends_no_simulation(file, folder, builds, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(kept.cache, "store", full)
    assert cached_closed_loop(load_scene(file)).nx
    assert not names(folder)


def test_what_a_loop_does_not_depend_on_is_refused_each_time(file, folder):
    for _ in range(2):
        with pytest.raises(ScenarioError, match="nothing"):
            cached_closed_loop(load_scene(file), vary=["nothing"])
