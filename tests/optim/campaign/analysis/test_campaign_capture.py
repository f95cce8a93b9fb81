"""How often a campaign's samples capture, and on what that depends."""

import pytest
from scipy import stats

from optim.campaign.analysis.summary import summarise
from optim.campaign.run import run_campaign
from optim.campaign.store.netcdf import load_campaign
from tests.oracles.free_bodies import FLAT, free_bodies
from viz.report.campaign_text import capturing, depends

CAMPAIGN = {
    "parameters": {
        "aside": {"paths": "target.base.position.1", "apply": "offset", "lower": -0.08, "upper": 0.08},
        "mass": {"paths": "target.links.body.mass", "lower": 6, "upper": 10},
    },
    "metrics": ["miss_distance", "capture_time"],
    "design": "latin_hypercube",
    "samples": 60,
    "step": 0.01,
}


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    folder = tmp_path_factory.mktemp("capture")
    capture = {"kind": "point", "capture": {"distance": 0.03}}
    scene = free_bodies(folder, FLAT, capture, campaign=CAMPAIGN)
    ran = run_campaign(scene, folder / "store")
    return summarise(folder / "store", ran.evaluator), load_campaign(folder / "store")


def test_the_probability_of_capture_has_a_binomial_interval(told):
    summary, data = told
    time = data.capture_time.sel(gains="scenario").values[:, 0]
    count = int((time < 3.0).sum())  # the simulation's duration where it is missed
    assert 0 < count < 60
    own = summary["gains"]["scenario"]
    exact = stats.binomtest(count, 60).proportion_ci(0.95, method="exact")
    assert own["captured"] == {"count": count, "value": count / 60, "low": exact.low, "high": exact.high}
    assert f"{count} of 60 samples capture: P(capture)" in capturing("scenario", own, summary)
    assert own["failure"]["any"]["count"] == 0  # a miss is no failure where no limit says so


def test_what_a_miss_depends_on_and_the_worst_sample(told):
    summary, data = told
    own = summary["gains"]["scenario"]
    assert own["matters"]["missed"]["strongest"][0]["parameter"] == "aside"
    assert depends("missed", own["matters"]["missed"]).startswith("The probability of a miss")
    worst = own["worst"][0]
    assert worst["missed"]
    assert worst["value"] == pytest.approx(float(data.miss_distance.max()))
