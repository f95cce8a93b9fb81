"""The campaign's section of a report: its numbers, its figures, its worst sample."""

import html

import numpy as np
import pytest

from optim.campaign import load_campaign, run_campaign, simulate_sample, summarise
from spacerobot.errors import ResultError
from viz.campaign_section import campaign_report, campaign_section


@pytest.fixture(scope="module")
def told(small, tmp_path_factory):
    folder = tmp_path_factory.mktemp("shown") / "store"
    found = run_campaign(small(), folder)
    return folder, found.evaluator, summarise(folder, found.evaluator, "a<b.yaml")


def test_the_section_says_what_the_summary_says(told):
    folder, _, summary = told
    text = campaign_section(folder).body(None)
    share = 100 * summary["gains"]["soft"]["failure"]["grip_force"]["value"]
    assert f"{share:.3g} % (" in text
    assert "100 of 100 samples" in text
    assert text.count("data:image/svg+xml") == 4 + 2
    for gains in summary["gains"].values():
        assert html.escape(gains["worst"][0]["command"], quote=True) in text
    assert "a<b" not in text


def test_the_worst_sample_is_simulated_and_animated(told):
    folder, evaluator, summary = told
    worst = summary["gains"]["stiff"]["worst"][0]
    result = simulate_sample(evaluator, list(worst["draw"].values()), "stiff")
    kept = load_campaign(folder).sel(sample=worst["sample"], gains="stiff")
    error = result.data.tip_error.values.reshape(-1, 3)[:, :2]
    assert np.abs(error).max(axis=0) == pytest.approx(kept.tip_error_peak.values, rel=1e-9)
    page = campaign_report(folder, result)
    assert '<section id="campaign">' in page
    assert '<section id="animation">' in page


def test_a_folder_without_a_campaign_is_refused(tmp_path):
    with pytest.raises(ResultError, match="no campaign that can be shown"):
        campaign_section(tmp_path)
