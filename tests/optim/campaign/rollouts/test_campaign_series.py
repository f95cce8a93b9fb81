"""Signals kept over time: the right numbers, the same to the bit however they came, and bounded."""

import os
import signal
import subprocess
import sys
import time

import netCDF4
import numpy as np
import pytest
import xarray as xr

from optim.campaign import LocalExecutor, load_campaign, read_bands, reopen, run_campaign
from optim.campaign.rollouts.evaluator import all_draws, build_evaluator
from optim.campaign.rollouts.series import RecordedSignal, SignalRecording, check_size
from optim.campaign.run import ChunkQueue, most_samples
from optim.campaign.store.netcdf import block_rows, blocks
from spacerobot.common.errors import ResultError, ScenarioError
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate

KP = {"kp": {"paths": "robots.arm.tips.tip.pid.kp", "lower": 50, "upper": 90}}
KEPT = ["tip_error", "joint_torque", "momentum_angular", "energy_kinetic"]
SECTION = {"campaign.series": KEPT, "campaign.series_step": 0.05}


@pytest.fixture(scope="module")
def whole(small, tmp_path_factory):
    folder = tmp_path_factory.mktemp("series") / "store"
    return run_campaign(small(**SECTION), folder, executor=LocalExecutor(size=100))


def same(folder, other):
    return xr.testing.assert_identical(load_campaign(folder, series=KEPT), load_campaign(other, series=KEPT))


def test_series_are_named_and_carry_units(whole):
    data = load_campaign(whole.folder, series=KEPT)
    assert data.tip_error.dims == ("sample", "gains", "time", "tip_error_of")
    assert data.tip_error.shape == (100, 2, 21, 3)
    assert data.time.values == pytest.approx(np.linspace(0, 1, 21))
    assert data.tip_error_of.values.tolist() == ["arm/tip x", "arm/tip y", "arm/tip z"]
    assert data.joint_torque_of.values.tolist() == ["arm/joint_1", "arm/joint_2", "arm/joint_3"]
    assert data.energy_kinetic_of.values.tolist() == [""]
    units = {name: data[name].units for name in [*KEPT, "time"]}
    assert units == dict(zip([*KEPT, "time"], ["m", "N m", "N m s", "J", "s"], strict=True))
    assert data.tip_error.dtype == np.float64


def test_series_are_those_of_a_plain_simulation(small, whole):
    data = load_campaign(whole.folder, series=KEPT)
    member = whole.evaluator.member("stiff")
    changes = dict(zip(member.space.paths, member.space.values(data.draw.values[17])[0], strict=True))
    changes |= {"robots.arm.tips.tip.pid.kp": 300, "simulation.output_step": 0.05}
    result = simulate(small(**{path.replace(".", "__"): value for path, value in changes.items()}))
    row = data.sel(sample=17, gains="stiff")
    for name in KEPT:
        plain = result.data[name].values.reshape(21, -1)
        assert row[name].values == pytest.approx(plain, rel=1e-9, abs=1e-12)


def test_every_output_has_a_unit_and_names(small):
    scene = small(**{"campaign.gains": {}})
    loop = build_evaluator(scene, compiled=False).members[0].rollout.loop
    names = loop.outputs.name_out()
    evaluator = build_evaluator(small(**{"campaign.series": names, "campaign.gains": {}}), compiled=False)
    assert evaluator.recording.names == tuple(names)
    assert evaluator.recording.width == sum(loop.outputs.numel_out(name) for name in names)


def test_series_change_other_numbers_by_rounding_alone(small, whole, tmp_path):
    run_campaign(small(), tmp_path / "store")
    without, with_ = load_campaign(tmp_path / "store"), load_campaign(whole.folder)
    assert not {"time", *KEPT} & set(with_.variables)
    # places of steps are computed from those of samples, so that rounding differs and nothing else
    xr.testing.assert_allclose(without, with_, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("size", "threads"), [(1, 1), (7, 3)])
def test_neither_chunks_nor_threads_change_a_bit(small, whole, tmp_path, size, threads):
    run_campaign(small(**SECTION), tmp_path / "store", executor=LocalExecutor(size=size, threads=threads))
    same(tmp_path / "store", whole.folder)


def test_a_worker_of_dask_changes_no_bit(small, whole, forked_workers, tmp_path):
    from optim.campaign.cluster import DaskExecutor

    run_campaign(small(**SECTION), tmp_path / "store", executor=DaskExecutor("local:2", size=9))
    same(tmp_path / "store", whole.folder)


KILLED = """
import sys, time
from pathlib import Path
from optim.campaign.run import LocalExecutor, run_campaign
from spacerobot.scene import load_scene
scene = load_scene(sys.argv[1], {"campaign.series": sys.argv[3].split(","), "campaign.series_step": 0.05})
run_campaign(scene, Path(sys.argv[2]), executor=LocalExecutor(size=5), progress=lambda _: time.sleep(0.1))
"""


def test_kill_9_and_going_on_change_no_bit(small, small_file, whole, tmp_path):
    folder = tmp_path / "store"
    child = subprocess.Popen([sys.executable, "-c", KILLED, str(small_file), str(folder), ",".join(KEPT)])
    began = time.monotonic()
    while len(list((folder / "chunks").glob("*.npz"))) < 3 and time.monotonic() - began < 60:
        time.sleep(0.001)
    os.kill(child.pid, signal.SIGKILL)
    assert child.wait() == -signal.SIGKILL
    reopen(folder)  # merges what is there, as a report does
    assert 15 <= load_campaign(folder, series=KEPT).sizes["sample"] < 100
    run_campaign(small(**SECTION), folder)
    same(folder, whole.folder)


def test_blocks_of_the_file_change_no_bit(small, whole, tmp_path, monkeypatch):
    monkeypatch.setattr("optim.campaign.store.netcdf.BLOCK_BYTES", 40_000)
    monkeypatch.setattr("optim.campaign.store.netcdf.PIECE_BYTES", 2_000)
    run_campaign(small(**SECTION), tmp_path / "store", executor=LocalExecutor(size=13))
    same(tmp_path / "store", whole.folder)
    with netCDF4.Dataset(tmp_path / "store" / "campaign.nc") as file:
        rows, sets, times, width = file["tip_error"].chunking()
        assert (sets, width) == (1, 3)
        assert rows & (rows - 1) == 0
        assert rows * 2 * 21 * 8 * (3 + 3 + 3 + 1) <= 40_000
        assert times < 21


def test_blocks_are_whole_but_for_the_last(whole):
    draws = all_draws(whole.evaluator)
    tables = [(begin, whole.evaluator.evaluate(draws[begin:end])) for begin, end in ((0, 3), (3, 4), (9, 20))]
    found = list(blocks(iter(tables), 4))
    assert [len(table) for _, table in found] == [4, 4, 4, 3]
    assert np.concatenate([samples for samples, _ in found]).tolist() == [0, 1, 2, 3, *range(9, 20)]
    together = np.concatenate([table.series["tip_error"] for _, table in found])
    assert np.array_equal(together, np.concatenate([t.series["tip_error"] for _, t in tables]))


def test_chunks_keep_within_their_bytes(whole, monkeypatch):
    each = 2 * 21 * 8 * (3 + 3 + 3 + 1)
    assert whole.evaluator.bytes_per_sample == each
    monkeypatch.setattr("optim.campaign.run.CHUNK_BYTES", 10 * each + 1)
    assert most_samples(whole.evaluator) == 10
    chunks = ChunkQueue([(0, 25)], most_samples(whole.evaluator))
    assert [chunks.take(64), chunks.take(3), chunks.take(64), chunks.take(64)] == [
        (0, 10),
        (10, 13),
        (13, 23),
        (23, 25),
    ]


def test_blocks_fit_into_memory():
    recording = SignalRecording((RecordedSignal("a", tuple(map(str, range(100))), "1"),), np.zeros(9_001))
    assert block_rows(1, recording) == 4  # 7.2 MB each
    assert block_rows(1, SignalRecording((), np.empty(0))) == 1024


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"campaign.series": ["tip_eror"]}, r"campaign.series: no signal 'tip_eror'; did you mean tip_error"),
        ({"campaign.series": ["tip_error", "tip_error"]}, "tip_error is given twice"),
        ({"campaign.series_step": 0.1}, "series_step: there is no series"),
        ({"campaign.series": ["tip_error"], "campaign.series_step": 0}, "allowed: above 0"),
        (
            {
                "campaign.series": ["grasp_force"],
                "grasps": {},
                "target": None,
                "campaign.parameters": KP,
                "campaign.limits": {},
            },
            "campaign.series: grasp_force: this scene has nothing that it is of",
        ),
    ],
)
def test_faults_are_told(small_file, changes, words):
    with pytest.raises(ScenarioError, match=words) as fault:
        build_evaluator(load_scene(small_file, changes), {}, compiled=False)
    assert "\n" not in str(fault.value)


def test_a_store_that_would_not_end_is_refused(small):
    recording = SignalRecording((RecordedSignal("a", ("x", "y"), "1"),), np.zeros(1001))
    check_size(recording, 600_000, 2)
    with pytest.raises(ScenarioError, match=r"32 GB \(1000000 samples x 2 sets of gains x 1001 times x 2 "):
        check_size(recording, 1_000_000, 2)
    large = {"campaign.samples": 1_000_000, "campaign.series": ["tip_error"], "campaign.series_step": 0.001}
    with pytest.raises(ScenarioError, match="allowed: 20 GB; keep fewer signals or raise series_step"):
        build_evaluator(small(**large), compiled=False)


def test_bands_are_numpys_percentiles(whole, monkeypatch):
    monkeypatch.setattr("optim.campaign.analysis.bands.AT_ONCE_BYTES", 1)
    kept = load_campaign(whole.folder, series=["tip_error"]).tip_error.sel(gains="soft").values
    found = read_bands(whole.folder, "tip_error", "soft", 41)
    known = np.percentile(kept, [0, 5, 50, 95, 100], axis=0)
    bands = [found.least, found.low, found.median, found.high, found.greatest]
    assert np.array(bands) == pytest.approx(known, rel=1e-12, abs=1e-18)
    assert np.array_equal(found.sample_values, kept[41])
    assert (found.left == 100).all()
    with pytest.raises(ResultError, match="did you mean tip_error"):
        read_bands(whole.folder, "tip_eror", "soft", 41)
    with pytest.raises(ResultError, match="no series 'x'; allowed: energy_kinetic"):
        load_campaign(whole.folder, series=["x"])


def test_what_diverged_counts_until_then(small, tmp_path):
    scene = small(**SECTION, **{"campaign.samples": 8})
    wild = {"robots.*.joint_pd": {"kp": 3e4, "kd": 0}}
    run_campaign(scene, tmp_path / "store", gains={"wild": wild})
    data = load_campaign(tmp_path / "store", series=["tip_error"])
    ends = data.diverged_at.values[:, 0]
    assert np.isfinite(ends).any()
    after = data.time.values[None, :] > ends[:, None]
    assert np.array_equal(np.isnan(data.tip_error.values[:, 0, :, 0]), after)
    found = read_bands(tmp_path / "store", "tip_error", "wild", 0)
    assert np.array_equal(found.left, (~after).sum(axis=0))
    some = found.left > 0
    known = np.nanpercentile(data.tip_error.values[:, 0, some], [5, 95], axis=0)
    assert np.array([found.low[some], found.high[some]]) == pytest.approx(known, rel=1e-12, abs=1e-18)
    assert np.isnan(found.median[~some]).all()
