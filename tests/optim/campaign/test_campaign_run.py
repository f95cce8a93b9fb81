"""Campaigns run, resumed, killed and refused: every sample once, the same to the bit."""

import os
import signal
import time

import numpy as np
import pytest
import xarray as xr

from optim.campaign.rollouts.evaluator import all_draws, build_evaluator
from optim.campaign.run import ChunkQueue, LocalExecutor, run_campaign, sized
from optim.campaign.store.folder import CampaignStore
from optim.campaign.store.netcdf import load_campaign
from spacerobot.common.errors import ResultError, ScenarioError
from spacerobot.quantities import default_metrics
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from tests import forks


@pytest.fixture(scope="module")
def whole(small, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "store"
    return run_campaign(small(), folder, executor=LocalExecutor(size=100))


def test_a_store_holds_every_sample_once_with_its_draw(whole):
    data = load_campaign(whole.folder)
    assert (whole.done, whole.total, whole.interrupted) == (100, 100, False)
    assert data.sample.values.tolist() == list(range(100))
    assert data.gains.values.tolist() == ["soft", "stiff"]
    assert np.array_equal(data.draw.values, all_draws(whole.evaluator))
    assert data.tip_error_peak.dims == ("sample", "gains", "tip_error_peak_of")
    assert data.tip_error_peak_of.values.tolist() == ["arm/tip x", "arm/tip y"]
    assert data.grip_force_peak.units == "N"
    assert not (whole.folder / "chunks").exists()


@pytest.mark.parametrize(("size", "threads"), [(1, 1), (7, 3)])
def test_neither_chunks_nor_threads_change_a_bit(small, whole, tmp_path, size, threads):
    run_campaign(small(), tmp_path / "store", executor=LocalExecutor(size=size, threads=threads))
    xr.testing.assert_identical(load_campaign(tmp_path / "store"), load_campaign(whole.folder))


def test_numbers_are_those_of_a_plain_simulation(small, whole):
    data = load_campaign(whole.folder)
    space = whole.evaluator.members[0].space
    for sample, gains, kp in ((0, 0, 50), (41, 1, 300)):
        values = space.values(data.draw.values[sample])[0]
        changes = dict(zip(space.paths, values, strict=True)) | {"robots.arm.tips.tip.pid.kp": kp}
        summary = simulate(small(**{path.replace(".", "__"): v for path, v in changes.items()})).summary
        error = summary["tip_error"]["arm/tip"]
        peaks = [max(-error[axis]["min_m"], error[axis]["max_m"]) for axis in "xy"]
        row = data.isel(sample=sample, gains=gains)
        assert row.tip_error_peak.values == pytest.approx(peaks, rel=1e-9)
        assert row.tip_error_rms.values == pytest.approx([error["norm"]["rms_m"]], rel=0.02)
        turned = summary["target"]["max_rotation_deg"], summary["bases"]["arm"]["max_rotation_deg"]
        assert row.target_rotation_peak.values == pytest.approx(turned[0], rel=1e-9)
        assert row.base_rotation_peak.values == pytest.approx(turned[1], rel=1e-9)
        assert row.joint_torque_peak.values == pytest.approx(
            summary["greatest_torque"]["torque_n_m"], rel=1e-9
        )
        assert row.grip_force_peak.values == pytest.approx(summary["greatest_grip"]["force_n"], rel=1e-9)


def test_a_diverged_rollout_is_kept_as_such(small, tmp_path):
    wild = {"wild": {"robots.*.joint_pd": {"kp": 1e7, "kd": 0}}, "tame": {}}
    run_campaign(small(**{"campaign.samples": 9}), tmp_path / "store", gains=wild)
    data = load_campaign(tmp_path / "store")
    assert np.isfinite(data.diverged_at.sel(gains="wild")).all()
    assert np.isnan(data.tip_error_peak.sel(gains="wild")).all()
    assert np.isnan(data.diverged_at.sel(gains="tame")).all()
    assert np.isfinite(data.tip_error_peak.sel(gains="tame")).all()


class Interrupted(LocalExecutor):
    """Stops after two chunks, as Ctrl-C does."""

    def work(self, evaluator, draws, chunks):
        for i, found in enumerate(super().work(evaluator, draws, chunks)):
            if i == 2:
                raise KeyboardInterrupt
            yield found


def test_an_interruption_leaves_what_was_found_and_it_goes_on(small, whole, tmp_path):
    folder, told = tmp_path / "store", []
    found = run_campaign(small(), folder, executor=Interrupted(size=20))
    assert (found.done, found.interrupted) == (40, True)
    assert load_campaign(folder).sample.values.tolist() == list(range(40))
    found = run_campaign(small(), folder, executor=LocalExecutor(size=33), progress=told.append)
    assert (found.done, found.interrupted) == (100, False)
    assert [p.phase for p in told if not p.total] == ["building the closed loop", "rolling out", "merging"]
    kept = [p for p in told if p.total]
    assert [p.done for p in kept] == [73, 100]
    assert all(p.rate > 0 and p.total == 100 and p.phase == "rolling out" for p in kept)
    xr.testing.assert_identical(load_campaign(folder), load_campaign(whole.folder))


def test_what_is_complete_is_not_done_again(small, whole):
    told = []
    before = (whole.folder / "campaign.nc").read_bytes()
    run_campaign(small(), whole.folder, progress=told.append)
    assert not any(p.total for p in told)
    assert (whole.folder / "campaign.nc").read_bytes() == before


KILLED = """
import sys, time
from pathlib import Path
from optim.campaign.run import LocalExecutor, run_campaign
from spacerobot.scene import load_scene
run_campaign(load_scene(sys.argv[1]), Path(sys.argv[2]), executor=LocalExecutor(size=5),
             progress=lambda _: time.sleep(0.1))
"""


def test_kill_9_at_any_time(small, small_file, whole, tmp_path):
    folder = tmp_path / "store"
    for wait in (1, 6):  # until so many chunks are there
        child = forks.begin(KILLED, small_file, folder)
        began = time.monotonic()
        while child.poll() is None and time.monotonic() - began < 30:
            if len(list((folder / "chunks").glob("*.npz"))) >= wait:
                break
            time.sleep(0.001)
        os.kill(child.pid, signal.SIGKILL)
        assert child.wait().returncode == -signal.SIGKILL
    assert not (folder / "campaign.nc").exists()
    run_campaign(small(), folder)
    xr.testing.assert_identical(load_campaign(folder), load_campaign(whole.folder))


def test_a_spoilt_chunk_is_done_again(small, whole, tmp_path):
    folder = tmp_path / "store"
    run_campaign(small(), folder, executor=Interrupted(size=20))
    chunk = folder / "chunks" / "000000020-000000040.npz"
    content = bytearray(chunk.read_bytes())
    content[len(content) // 2] ^= 255
    chunk.write_bytes(content)
    run_campaign(small(), folder)
    xr.testing.assert_identical(load_campaign(folder), load_campaign(whole.folder))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"campaign.samples": 101}, "campaign.samples was 100, is 101"),
        ({"target.links.body.mass": 21}, "target.links.body.mass was 20.0, is 21.0"),
        ({"campaign.gains.soft": {"robots.*.tips.tip.pid.kp": 51}}, "was 50, is 51"),
    ],
)
def test_a_changed_campaign_is_not_resumed(small_file, whole, changes, words):
    with pytest.raises(ResultError, match=words):
        run_campaign(load_scene(small_file, changes), whole.folder)


def test_what_changes_no_number_may_change(small, whole):
    changed = small(**{"campaign.limits.grip_force": 5.0, "campaign.confidence": 0.9, "tuning": None})
    assert run_campaign(changed, whole.folder).done == 100


def test_a_store_in_use_and_a_folder_of_something_else_are_refused(small, whole, tmp_path):
    import fcntl

    with (whole.folder / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(ResultError, match="another process"):
            run_campaign(small(), whole.folder)
    (tmp_path / "letter.txt").write_text("dear")
    with pytest.raises(ResultError, match="no campaign"):
        run_campaign(small(), tmp_path)


def test_a_chunk_twice_is_refused(whole):
    store = CampaignStore(whole.folder, 100)
    table = whole.evaluator.evaluate(all_draws(whole.evaluator)[:3])
    with pytest.raises(ResultError, match="there already"):
        store.add(50, table)


def test_a_number_the_closed_loop_does_not_know(small):
    odd = {"mass": {"paths": "simulation.duration", "lower": 1, "upper": 2}}
    with pytest.raises(ScenarioError, match="does not depend on it"):
        build_evaluator(small(**{"campaign.parameters": odd, "campaign.gains": {}}))


def test_a_named_metric_that_the_scene_lacks_is_refused(small):
    def keeping(*names):
        changed = small(campaign__limits={"grip_force": None}, campaign__metrics=list(names))
        return build_evaluator(changed, compiled=False)

    one = ("tip_error_peak", "contact_force_peak")
    with pytest.raises(ScenarioError, match=r"contact_force_peak: this scene has no contact; remove it"):
        keeping(*one)
    with pytest.raises(ScenarioError, match=r"contact_force_peak: .*; impulse: .*; remove them"):
        keeping(*one, "impulse")
    # the default list, also spelled out as in a stored scenario, is what fits the scene
    assert "impulse" in default_metrics()
    assert keeping(*default_metrics()).columns


def test_chunks_cover_what_is_missing_once():
    chunks, taken = ChunkQueue([(0, 10), (15, 16), (20, 40)]), []
    for size in (4, 100, 3, 1, 100, 9, 9):
        taken.append(chunks.take(size))
    assert taken == [(0, 4), (4, 10), (15, 16), (20, 21), (21, 40), None, None]


def test_chunks_are_sized_to_seconds():
    assert sized(100, 1.0, 4.0) == 384
    assert sized(100, 100.0, 4.0) == 4
    assert sized(100, 1e9, 4.0) == 1
    assert sized(64, 1e-9, 4.0) == 512


def test_ctrl_c_while_the_last_chunk_is_written_loses_nothing(small, whole, tmp_path, monkeypatch):
    import signal

    from optim.campaign.store import folder as store

    write = store.write_bytes

    def interrupted(path, content):
        if path.stem.endswith("100"):
            signal.raise_signal(signal.SIGINT)
        write(path, content)

    monkeypatch.setattr(store, "write_bytes", interrupted)
    ran = run_campaign(small(), tmp_path / "store", executor=LocalExecutor(size=30))
    assert ran.interrupted
    assert ran.done == 100
    xr.testing.assert_identical(load_campaign(ran.folder), load_campaign(whole.folder))
