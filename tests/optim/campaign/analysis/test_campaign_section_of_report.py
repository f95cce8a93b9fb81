"""The page about a campaign: its numbers, its figures, its worst samples, made from the folder alone."""

import html
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from optim.campaign import LocalExecutor, load_campaign, reopen, run_campaign, simulate_sample, summarise
from optim.campaign.analysis.sentences import stepping
from optim.campaign.sampling.parameter_space import sensor_offsets
from spacerobot.common.errors import DivergedError, ResultError
from spacerobot.scenario import UncertainParameter
from spacerobot.scene import load_scene
from viz.report.campaign_data import campaign_page, first_page

ONE = {"soft": {"robots.*.tips.tip.pid.kp": 50}}
"""A single set of gains, where how many there are does not matter: each costs the page a simulation."""


def quiet(_):
    pass


@pytest.fixture(scope="module")
def told(small_file, tmp_path_factory):
    folder = tmp_path_factory.mktemp("shown") / "store"
    file = Path(shutil.copy(small_file, small_file.with_name("a<b.yaml")))
    scene = load_scene(file, {"campaign.series": ["tip_error", "grasp_torque"], "gravity": [0.0, 0.0, 0.0]})
    found = run_campaign(scene, folder)
    return folder, found.evaluator, summarise(folder, found.evaluator)


@pytest.fixture(scope="module")
def page(told):
    """With figures of the campaign; those of single results are tested where reports of these are."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("viz.report.sections.to_bytes", lambda *_: b"<svg/>")
        return campaign_page(told[0], quiet)


def test_the_page_says_what_the_summary_says(told, page):
    _, _, summary = told
    share = 100 * summary["gains"]["soft"]["failure"]["grip_force"]["value"]
    assert f"<td>{share:.3g} (" in page
    assert "grip force [%]</th>" in page
    assert "100 of 100 samples" in page
    for gains in summary["gains"].values():
        command = gains["worst"][0]["command"]
        assert "--set 'gravity=[0.0, 0.0, 0.0]'" in command
        assert html.escape(command, quote=True) in page
    assert "a<b" not in page
    text = page[page.index('id="series"') : page.index('id="worst"')]
    assert text.count("data:image/svg+xml") == 2  # of the tip error, for each set of gains
    assert text.count("always the same") == 2  # a compliant grasp of a point has no torque


@pytest.mark.parametrize("which", [["soft"], None])
def test_a_worst_sample_that_cannot_begin_is_told_by_its_fault_and_the_page_goes_on(
    told, monkeypatch, which, undrawn
):
    folder, evaluator, summary = told

    def simulate(own, draw, gains):
        if which is None or gains in which:
            raise DivergedError(f"the rollout of {gains} diverged at the start, where v = 1e<300")
        return simulate_sample(own, draw, gains)

    monkeypatch.setattr("viz.report.campaign_data.simulate_sample", simulate)
    made = campaign_page(folder, quiet, evaluator)
    for gains in which or summary["gains"]:
        sample = summary["gains"][gains]["worst"][0]["sample"]
        words = f"gains {gains}, sample {sample}, cannot be simulated: the rollout of {gains} diverged"
        assert f"{words} at the start, where v = 1e&lt;300" in made
    assert "100 of 100 samples" in made
    assert ('id="animation"' in made) == (which is not None)


def test_what_a_folder_holds_is_shown_before_anything_is_compiled(told):
    folder, evaluator, _ = told
    again = reopen(folder)
    data = first_page(folder, again)
    spreads = data["panel"]["spreads"]
    assert [spread["name"] for spread in spreads] == list(evaluator.gains)
    peak = next(metric for metric in spreads[0]["metrics"] if metric["key"] == "tip_error_peak")
    assert len(peak["values"]) == 100
    assert spreads[0]["drawn"] == 0
    assert data["runs"][0]["nodes"]
    assert again.members[0].rollout.engines.toolchain is None


def test_draws_have_units_and_a_sensors_offset_is_told_to_be_a_step(told, page):
    _, evaluator, summary = told
    draw = summary["gains"]["soft"]["worst"][0]["draw"]
    worst = page[page.index('id="worst"') :]
    assert f"<td>{draw['mass']:.6g} kg</td>" in worst
    assert f"<td>{draw['grip']:.6g} times the scenario&#x27;s</td>" in worst
    assert summary["units"]["spin"] == "deg/s"
    assert stepping(summary) is None
    assert "A sensor" not in page
    parameter = {
        "offset": UncertainParameter(paths="robots.*.sensors.tip_position.offset", lower=0, upper=1e-3)
    }
    named = sensor_offsets(evaluator.campaign.model_copy(update={"parameters": parameter}))
    assert "from t = 0 on" in stepping({"sensor_offsets": named})


def test_the_worst_sample_of_each_set_is_simulated_and_animated(told, page):
    folder, evaluator, summary = told
    for name in ("soft", "stiff"):
        worst = summary["gains"][name]["worst"][0]
        result = simulate_sample(evaluator, list(worst["draw"].values()), name)
        kept = load_campaign(folder, series=["tip_error"]).sel(sample=worst["sample"], gains=name)
        error = result.data.tip_error.values.reshape(-1, 3)
        assert np.abs(error[:, :2]).max(axis=0) == pytest.approx(kept.tip_error_peak.values, rel=1e-9)
        assert error == pytest.approx(kept.tip_error.values, rel=1e-9, abs=1e-15)
        assert f"Gains {name}, sample {worst['sample']}" in page
    assert page.count("<iframe") == 1  # the player and the meshes are there once
    assert page.count("&quot;drawn&quot;:100") == 2  # all samples beside each worst one
    assert '<section id="paper">' not in page


def test_the_same_page_comes_from_the_run_and_from_its_folder(told, undrawn):
    folder, evaluator, _ = told
    assert _steady(campaign_page(folder, quiet, evaluator)) == _steady(campaign_page(folder, quiet))


def _steady(page):
    """What does not tell how long something took."""
    return page.split("<section")[1:6]


def test_report_finds_out_what_a_folder_holds(told, tmp_path, undrawn):
    from spacerobot.cli.app import app

    def report(*words):
        return CliRunner().invoke(app, ["report", *map(str, words)])

    done = report(told[0], "--out", tmp_path / "page.html")
    assert done.exit_code == 0, done.output
    assert '<section id="series">' in (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "name it alone" in str(report(told[0], told[0]).exception)
    assert "no result in this folder" in str(report(told[0], tmp_path).exception)
    assert f"holds a campaign, {told[0].name}" in str(report(told[0].parent).exception)
    fault = report(tmp_path / "nowhere").exception
    assert isinstance(fault, ResultError)
    assert fault.exit_code == 2


class Stopped(LocalExecutor):
    def work(self, evaluator, draws, chunks):
        for i, found in enumerate(super().work(evaluator, draws, chunks)):
            if i == 1:
                raise KeyboardInterrupt
            yield found


class Killed(LocalExecutor):
    """Ends as a kill does: what was added stays in chunks, and nothing is merged."""

    def work(self, evaluator, draws, chunks):
        yield from ((begin, table) for begin, table in super().work(evaluator, draws, chunks) if begin < 40)
        raise MemoryError


def test_a_half_done_campaign_tells_how_much_is_there(small, tmp_path, undrawn):
    run_campaign(small(), tmp_path / "stopped", gains=ONE, executor=Stopped(size=25))
    assert "Not finished: 25 of 100 samples" in campaign_page(tmp_path / "stopped", quiet)
    with pytest.raises(MemoryError):
        run_campaign(small(), tmp_path / "killed", gains=ONE, executor=Killed(size=20))
    assert not (tmp_path / "killed" / "campaign.nc").exists()
    assert "Not finished: 40 of 100 samples" in campaign_page(tmp_path / "killed", quiet)
    run_campaign(small(), tmp_path / "killed", gains=ONE)
    assert load_campaign(tmp_path / "killed").sizes["sample"] == 100


def test_a_campaign_without_a_sample_says_so(small, tmp_path):
    class Nothing(LocalExecutor):
        def work(self, evaluator, draws, chunks):
            raise KeyboardInterrupt
            yield

    run_campaign(small(), tmp_path / "store", executor=Nothing())
    with pytest.raises(ResultError, match="holds no sample yet"):
        campaign_page(tmp_path / "store", quiet)


def test_a_folder_without_a_campaign_is_refused(tmp_path):
    with pytest.raises(ResultError, match=r"campaign\.json"):
        campaign_page(tmp_path, quiet)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda head: head | {"format": 1}, "another version: layout 1"),
        (lambda head: head | {"fingerprint": "0"}, "another version of the library"),
        (lambda head: head | {"scenario": head["scenario"] | {"odd": 1}}, "unknown key 'odd'"),
        (lambda head: {key: head[key] for key in ("format", "scenario")}, "is no campaign's"),
    ],
)
def test_a_folder_of_another_version_is_refused(told, tmp_path, change, words):
    shutil.copytree(told[0], tmp_path / "store")
    head = json.loads((told[0] / "campaign.json").read_text())
    (tmp_path / "store" / "campaign.json").write_text(json.dumps(change(head)))
    with pytest.raises(ResultError, match=words) as fault:
        reopen(tmp_path / "store")
    assert "\n" not in str(fault.value)


def test_a_changed_urdf_is_refused_and_a_missing_one(small_file, tmp_path):
    for name in ("small.yaml", "arm.urdf"):
        shutil.copy(small_file.parent / name, tmp_path / name)
    scene = load_scene(tmp_path / "small.yaml", {"campaign.samples": 3})
    run_campaign(scene, tmp_path / "store")
    reopen(tmp_path / "store")
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(urdf.read_text() + "<!-- another arm -->\n")
    with pytest.raises(ResultError, match=r"the URDF of arm, .*arm\.urdf, has changed since"):
        reopen(tmp_path / "store")
    urdf.unlink()
    with pytest.raises(ResultError, match=r"robots\.arm\.urdf: .*no such URDF file"):
        reopen(tmp_path / "store")


def test_every_sample_diverged(small, tmp_path, undrawn, interpreted):
    wild = {"wild": {"robots.*.joint_pd": {"kp": 1e7, "kd": 0}}}
    scene = small(**{"campaign.samples": 9, "campaign.series": ["joint_torque"]})
    found = run_campaign(scene, tmp_path / "store", gains=wild)
    summary = summarise(tmp_path / "store", found.evaluator)
    assert summary["gains"]["wild"]["failure"]["diverged"]["count"] == 9
    assert summary["gains"]["wild"]["matters"]["tip_error_peak"]["note"] == "no rollout has a value"
    text = campaign_page(tmp_path / "store", quiet)
    assert "no rollout has a value" in text
    assert "diverged after" in text


def test_one_sample(small, tmp_path, undrawn):
    found = run_campaign(small(**{"campaign.samples": 1}), tmp_path / "store", gains=ONE)
    summary = summarise(tmp_path / "store", found.evaluator)
    row = summary["gains"]["soft"]["metrics"][0]
    assert {q["value"] for q in row["percentiles"]} == {row["largest"]}
    assert {q["high"] for q in row["percentiles"]} == {None}
    assert summary["gains"]["soft"]["matters"]["tip_error_peak"]["note"] == "it does not vary"
    assert "1 of 1 samples" in campaign_page(tmp_path / "store", quiet)
