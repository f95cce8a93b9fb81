"""Damaged folders of campaigns: one line that names the file and what is missing."""

import contextlib
import json
import shutil

import netCDF4
import pytest
import xarray as xr

from optim.campaign.run import run_campaign
from optim.campaign.store.load_evaluator import reopen
from spacerobot.common.errors import ResultError
from viz.report.campaign_data import campaign_page


@pytest.fixture(scope="module")
def whole(small, tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign") / "c"
    run_campaign(small(campaign__samples=4, campaign__series=["tip_error"], campaign__step=0.05), folder)
    return folder


def test_every_variable_that_is_missing_is_named(whole, tmp_path, monkeypatch):
    evaluator = reopen(whole)  # built once: the folders differ in their data alone
    monkeypatch.setattr("optim.campaign.store.load_evaluator.build_evaluator", lambda *_, **__: evaluator)
    data = xr.load_dataset(whole / "campaign.nc")
    names = [str(name) for name in data.variables]
    assert len(names) > 15
    for name in names:
        folder = shutil.copytree(whole, tmp_path / name)
        data.drop_vars(name).to_netcdf(folder / "campaign.nc", engine="netcdf4", unlimited_dims=["sample"])
        with pytest.raises(ResultError, match=rf"campaign\.nc: damaged: no variable '{name}'; remove it"):
            reopen(folder)


def test_every_key_that_is_missing_or_a_file_cut_short_is_one_line(whole, tmp_path):
    folder = shutil.copytree(whole, tmp_path / "c")
    head = json.loads((folder / "campaign.json").read_text())
    for path in [(key,) for key in head] + [("notes", key) for key in head["notes"]]:
        found = json.loads(json.dumps(head))
        del (found if len(path) == 1 else found[path[0]])[path[-1]]
        (folder / "campaign.json").write_text(json.dumps(found))
        with contextlib.suppress(ResultError):  # some keys are there for people
            campaign_page(folder, lambda _: None)
    (folder / "campaign.json").write_text(json.dumps(head))
    content = (folder / "campaign.nc").read_bytes()
    for share in (0.1, 0.9):
        (folder / "campaign.nc").write_bytes(content[: int(share * len(content))])
        with pytest.raises(ResultError):
            reopen(folder)


def test_units_that_are_missing_are_named(whole, tmp_path):
    folder = shutil.copytree(whole, tmp_path / "c")
    with netCDF4.Dataset(folder / "campaign.nc", "a") as file:
        file["tip_error"].delncattr("units")
    with pytest.raises(ResultError, match=r"damaged: tip_error: no attribute 'units'"):
        reopen(folder)
