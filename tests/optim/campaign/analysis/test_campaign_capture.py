"""How often a campaign's samples capture, and on what that depends."""

import numpy as np
import pytest
from scipy import stats

import spacerobot as sr
from optim.campaign.analysis.sentences import capturing, depends
from optim.campaign.analysis.summary import summarise
from optim.campaign.analysis.tables import campaign_content
from optim.campaign.run import run_campaign
from optim.campaign.store.netcdf import load_campaign
from spacerobot.cli.output import show
from tests.oracles.free_bodies import FLAT, free_bodies
from viz.figures.campaign import SampleSpread, distributions
from viz.report.campaign_section import CampaignReport, campaign_report
from viz.report.sections import escape

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
    count = int(np.isfinite(time).sum())
    assert 0 < count < 60
    assert np.nanmax(time) < 3.0  # the simulation's duration is not the time of a capture that was missed
    np.testing.assert_array_equal(data.captured.sel(gains="scenario").values[:, 0], np.isfinite(time))
    own = summary["gains"]["scenario"]
    exact = stats.binomtest(count, 60).proportion_ci(0.95, method="exact")
    assert own["captured"] == {"count": count, "value": count / 60, "low": exact.low, "high": exact.high}
    assert f"{count} of 60 samples capture: P(capture)" in capturing("scenario", own, summary)
    assert own["failure"]["any"]["count"] == own["failure"]["missed"]["count"] == 60 - count


def test_what_a_miss_depends_on_and_the_worst_sample(told):
    summary, data = told
    own = summary["gains"]["scenario"]
    assert own["matters"]["missed"]["strongest"][0]["parameter"] == "aside"
    assert depends("missed", own["matters"]["missed"]).startswith("The probability of a miss")
    worst = own["worst"][0]
    assert worst["missed"]
    assert worst["value"] == pytest.approx(float(data.miss_distance.max()))


def test_percentiles_and_curves_do_not_take_the_duration_for_the_time_of_a_missed_capture(told):
    summary, data = told
    time = np.sort(data.capture_time.sel(gains="scenario").values[:, 0])  # NaN last
    rows = {row["metric"]: row for row in summary["gains"]["scenario"]["metrics"]}
    assert rows["capture_time"]["largest"] is None
    for own in rows["capture_time"]["percentiles"]:
        at = own["percent"] / 100 * 59
        expected = time[int(at)] + (at % 1) * (time[min(int(at) + 1, 59)] - time[int(at)])
        assert own["value"] == (pytest.approx(expected) if np.isfinite(expected) else None)
    curve = distributions([SampleSpread({"scenario": time}, "capture time", "s")]).axes[0].lines[0]
    assert curve.get_ydata()[-1] == pytest.approx(np.isfinite(time).sum() / 60)
    assert curve.get_xdata()[-1] == np.nanmax(time)


TIMEOUT = {
    "approach": {"until": {"captured": ["left"]}, "timeout": 1.0, "on_timeout": "retreat"},
    "stop": {},
    "retreat": {"captures": []},
}


@pytest.mark.parametrize("required", [True, False])
def test_a_campaign_in_which_nothing_is_captured_fails_unless_captures_are_optional(
    tmp_path, capsys, required
):
    capture = {"kind": "point", "capture": {"distance": 1e-4}}
    section = CAMPAIGN | {"samples": 16, "metrics": ["capture_time", "touchdown_speed"]}
    section |= {} if required else {"require_captures": False}
    scene = free_bodies(tmp_path, FLAT, capture, campaign=section, phases=TIMEOUT)
    ran = run_campaign(scene, tmp_path / "store")
    summary, data = summarise(tmp_path / "store", ran.evaluator), load_campaign(tmp_path / "store")
    failed = 16 if required else 0
    assert np.isnan(data.capture_time.values).all()
    assert np.isnan(data.touchdown_speed.values).all()
    own = summary["gains"]["scenario"]
    assert own["failure"]["any"]["count"] == failed
    assert own["captured"]["count"] == 0
    verdict = f"With the scenario's own gains, {failed} of 16 samples fail"
    show(campaign_content(summary))
    printed = capsys.readouterr().out
    assert printed.startswith(verdict)
    assert ("16 by a capture that was missed" in printed) == required
    html = campaign_report(CampaignReport(summary, data, {}, {}))
    section_text = html[html.index("<h2") :]
    assert section_text[section_text.index("<p ") :].startswith(f"<p class='outcome'>{escape(verdict)}")


def test_a_late_capture_passes_its_limit_and_a_missed_one_is_missed(told, tmp_path):
    data = told[1]
    time = data.capture_time.sel(gains="scenario").values[:, 0]
    limit = float(np.nanmedian(time))
    capture = {"kind": "point", "capture": {"distance": 0.03}}
    for required in (True, False):
        changes = {"limits": {"capture_time": limit}, "require_captures": required}
        folder = tmp_path / str(required)
        folder.mkdir()
        scene = free_bodies(folder, FLAT, capture, campaign=CAMPAIGN | changes)
        ran = run_campaign(scene, folder / "store")
        failure = summarise(folder / "store", ran.evaluator)["gains"]["scenario"]["failure"]
        late, missed = int((time > limit).sum()), int(np.isnan(time).sum())
        assert failure["any"]["count"] == late + missed
        assert failure["capture_time"]["count"] == (late if required else late + missed)


def test_a_batch_has_no_time_of_a_missed_capture(tmp_path):
    scene = free_bodies(tmp_path, FLAT, {"kind": "point", "capture": {"distance": 0.03}})
    found = sr.batch(scene, ["capture_time", "touchdown_speed"], {"target.base.position.1": [0.02, 0.4]})
    for name in ("capture_time", "touchdown_speed"):
        assert list(np.isnan(found.data[name].values[:, 0])) == [False, True]
