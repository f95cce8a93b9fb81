"""The page in a real browser: it moves, is silent, and asks nothing of anybody."""

import re

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ResultError
from spacerobot.description import shipped_urdf_folder
from spacerobot.result.result import Result
from spacerobot.rollout import build_rollout
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from tests.oracles import one_arm
from tests.oracles.free_bodies import FLAT, free_bodies
from viz.drawing.motion import pick_rows, scene_nodes
from viz.figures import draw_all, figure_kinds
from viz.page.animation import FRAMES_PER_S, MOST_FRAMES, animation
from viz.page.campaign_spread import CampaignSpread
from viz.page.meshcat_scene import packed
from viz.page.page import animation_page, json_text, meshcat_script, write_animation
from viz.page.page import page as to_html
from viz.recording.record import write_recording

BOX = (
    "(({x, y, width, height}) => [x, y, width, height])"
    "(document.getElementById('pane').getBoundingClientRect())"
)
HIDE = "for (const id of ['side', 'labels', 'scale']) document.getElementById(id).hidden = true"
SCRUB = "s.value = 7; s.dispatchEvent(new Event('input'))"
CURVES = "document.querySelector('#chart .panels').innerText"
NAMES_ALL = (
    "[...document.querySelectorAll('#labels .name')].map((e) => [e.textContent, parseFloat(e.style.left)])"
)
NAMES = NAMES_ALL.replace("]", "].filter((e) => !e.hidden)", 1)
EDGES = (
    "(({left, top, right, bottom}) => [left, top, right, bottom])"
    "(document.getElementById('ID').getBoundingClientRect())"
)
READY = "document.body?.dataset.ready === 'true'"


def _show(browser, path, text, fragment="", size=(1000, 700)):
    path.write_text(text, encoding="utf-8")
    browser.open(f"{path.as_uri()}{fragment}", *size)
    browser.wait_for(READY)
    return browser


def test_bodies_move_and_nothing_is_asked_of_the_network(browser, paper, tmp_path):
    page = _show(browser, tmp_path / "page.html", animation_page(paper), "#t=0", (800, 600))
    before = page.picture()
    page.evaluate("location.hash = '#t=5'")
    page.wait_for("document.body.dataset.time === '5.000'")
    after = page.picture()
    x, y, width, height = map(int, page.evaluate(BOX))
    # the part left of where robot 1's arm begins holds its base alone: the base drifts
    changed = np.abs(after - before).sum(axis=2) > 60
    pane = changed[y : y + height, x : x + width]
    assert pane.mean() > 0.02
    assert pane[height // 2 :, : 2 * width // 5].sum() > 500
    assert page.errors == []
    assert [url for url in page.requests if not url.startswith(("file:", "data:", "blob:"))] == []


def test_the_whole_motion_fills_the_view(browser, paper, tmp_path):
    for size in ((1400, 900), (700, 900)):
        page = _show(browser, tmp_path / "p.html", animation_page(paper), "#t=5", size)
        page.evaluate(HIDE)
        picture = page.picture()
        _, y, _, height = map(int, page.evaluate(BOX))
        pane = picture[y + 2 : y + height - 2]
        gold = (pane[:, :, 0] - pane[:, :, 2]) > 70
        columns, rows = np.nonzero(gold.any(axis=0))[0], np.nonzero(gold.any(axis=1))[0]
        # gold bases and orange links reach from the lower third to the upper one, and touch no edge
        assert rows[0] > 2
        assert rows[-1] < gold.shape[0] - 3
        assert columns[0] > 0.05 * gold.shape[1]
        assert np.ptp(rows) > 0.6 * gold.shape[0] or np.ptp(columns) > 0.4 * gold.shape[1]


def test_it_says_time_and_the_tip_errors_of_the_result(browser, paper, tmp_path, flat):
    page = _show(browser, tmp_path / "page.html", animation_page(paper), "#t=3")
    words = page.evaluate("document.getElementById('readout').innerText")
    assert "t = 3.00 s" in words
    row = paper.data.tip_error.sel(time=3.0, method="nearest")
    for tip in ("rpr1/tip", "rpr2/tip"):
        said = float(re.search(rf"{tip.replace(chr(47), chr(32))} error ([\d.]+) mm", words)[1])
        assert said == pytest.approx(np.linalg.norm(row.sel(tip=tip)) * 1e3, abs=6e-3)


def test_forces_turns_and_momenta_are_plotted_by_name_and_in_numbers(browser, paper, tmp_path, flat):
    page = _show(browser, tmp_path / "page.html", animation_page(paper), "#t=3")
    row = paper.data.sel(time=3.0, method="nearest")
    force = float(np.linalg.norm(row.grasp_force.sel(grasp="left")))
    start = paper.data.body_angle.sel(body="rpr1")[0]
    turned = float(np.degrees(row.body_angle.sel(body="rpr1") - start))
    wanted = "grip force;rotation since the start:rpr1;linear momentum"
    page.evaluate(f"location.hash = '#t=3&signals={wanted}'")
    page.wait_for("document.querySelectorAll('#chart canvas').length === 4")  # one is the time axis
    words = page.evaluate(CURVES)
    for name, value in (("left", force), ("rpr1", turned)):
        assert float(re.search(rf"{name} (-?[\d.]+) ", words)[1]) == pytest.approx(value, rel=6e-3)
    assert float(re.search(r"all together ([\d.e-]+) N s", words)[1]) < 1e-8
    assert page.errors == []


def test_names_stand_on_the_robots_and_errors_are_enlarged(browser, paper, tmp_path):
    page = _show(browser, tmp_path / "page.html", animation_page(paper), "#t=5", (1400, 850))
    page.picture()
    found = dict(page.evaluate(NAMES))
    assert set(found) == {"rpr1", "rpr2", "rectangle"}
    assert found["rpr1"] < found["rectangle"] < found["rpr2"]
    caption = page.evaluate("document.getElementById('magnifier').title")
    assert re.fullmatch(r"Tips around their references, \d+ times enlarged; rings every 1 mm", caption)
    whole = int(re.search(r"(\d+) times", caption)[1])
    page.evaluate("location.hash = '#t=5&look=near'")
    page.wait_for("document.getElementById('look').value === 'near'")
    caption = page.evaluate("document.getElementById('magnifier').title")
    assert int(re.search(r"(\d+) times", caption)[1]) < 0.3 * whole
    page.evaluate("document.querySelector('#layers input').click()")
    page.picture()
    assert page.evaluate(NAMES) == []
    assert page.errors == []


def test_everything_can_be_reached_on_a_phone(browser, blind, paper, tmp_path):
    page = _show(browser, tmp_path / "page.html", animation_page(blind, paper), "#t=5", (360, 740))
    page.evaluate("document.getElementById('more').click()")
    ids = ("play", "scrub", "speed", "signals", "paneling", "legend")
    for name in (*ids, "arrange", "look", "follow", "reset", "picture", "film", "video"):
        left, top, right, bottom = page.evaluate(EDGES.replace("ID", name))
        assert 0 <= left < right <= 360, name
        assert 0 <= top < bottom <= 740, name
    assert not page.evaluate("document.getElementById('legend').open")


def test_a_result_of_a_single_instant_and_a_body_without_shapes_are_shown(
    browser, paper, tmp_path, monkeypatch
):
    text = (shipped_urdf_folder() / "rectangle.urdf").read_text()
    (tmp_path / "bare.urdf").write_text(re.sub(r"(?s)<(visual|collision)\b.*?</\1>", "", text))
    scene = load_scene("paper", {"target.urdf": str(tmp_path / "bare.urdf"), "simulation.duration": 0.02})
    page = _show(browser, tmp_path / "bare.html", animation_page(simulate(scene, backend="interpreted")))
    assert "bare" in dict(page.evaluate(NAMES_ALL))
    assert page.errors == []
    instant = Result(paper.scenario, paper.data.isel(time=[0]), paper.summary)
    page = _show(browser, tmp_path / "instant.html", animation_page(instant))
    assert page.evaluate("document.getElementById('play').disabled")
    assert page.errors == []
    assert len(list(draw_all(instant))) == sum(kind.applies(instant) for kind in figure_kinds())
    monkeypatch.setattr("viz.recording.record.browser_program", lambda: None)
    write_recording(instant, tmp_path / "instant.gif", size_px=(160, 100))


def test_the_close_view_holds_the_object_and_more_than_a_tip_that_stands_still(paper):
    data = animation(paper)
    near, low, high = np.array(data["near"]), *np.array(data["box"])
    reference = paper.data.tip_reference.values.reshape(-1, 3)
    assert (near.min(axis=0)[:2] <= reference.min(axis=0)[:2]).all()
    assert (near.max(axis=0)[:2] >= reference.max(axis=0)[:2]).all()
    assert np.ptp(near[:, 0]) < 0.25 * (high - low)[0]
    changes = {"robots.*.tips.tip.reference": {"kind": "hold"}, "simulation.duration": 0.02}
    still = np.array(animation(simulate(load_scene("paper", changes), backend="interpreted"))["near"])
    assert np.ptp(still[:, 0]) > 0.1 * np.linalg.norm(high - low)


def test_it_plays_pauses_and_scrubs(browser, paper, tmp_path):
    page = _show(browser, tmp_path / "page.html", animation_page(paper), "#t=1&play=1&speed=2")
    page.wait_for("Number(document.body.dataset.time) > 1.1")
    page.evaluate("document.getElementById('play').click()")
    stopped = page.evaluate("document.body.dataset.time")
    page.picture()
    assert page.evaluate("document.body.dataset.time") == stopped
    page.evaluate(f"(() => {{ const s = document.getElementById('scrub'); {SCRUB}; }})()")
    assert page.evaluate("document.body.dataset.time") == "7.000"
    assert page.errors == []


def test_comparison_shows_both_beside_and_over(browser, paper, blind, tmp_path):
    page = _show(browser, tmp_path / "page.html", animation_page(blind, paper), "#t=5")
    words = page.evaluate("document.getElementById('readout').innerText")
    assert words.index("pid") < words.index("amnesia")
    assert len(re.findall("error", words)) == 4
    beside = page.picture()
    page.evaluate("location.hash = '#t=5&arrange=over'")
    page.wait_for("document.getElementById('arrange').value === 'over'")
    assert (np.abs(page.picture() - beside).sum(axis=2) > 60).mean() > 0.05
    assert page.errors == []


def test_spatial_scene_and_scripts_in_names_are_harmless(browser, spatial, tmp_path):
    text = "</script><script>document.title='owned'</script><img src=x onerror=\"document.title='owned'\">"
    page = _show(browser, tmp_path / "page.html", animation_page(spatial, title=text), "#t=0.2")
    assert page.evaluate("document.getElementById('title').textContent") == text
    assert page.evaluate("document.title") == text
    assert page.errors == []


def test_size_is_a_megabyte_and_a_half_for_ten_seconds(paper, tmp_path):
    write_animation(paper, tmp_path / "page.html")
    assert 0.9e6 < (tmp_path / "page.html").stat().st_size < 1.7e6


def test_pages_without_meshes_stay_below_4_megabytes(paper):
    """Of a rollout that is too long for every frame to be shown, of two arms with eight links each."""
    rows = np.arange(2 * MOST_FRAMES) % paper.data.sizes["time"]
    time = np.arange(len(rows)) / FRAMES_PER_S
    data = paper.data.isel(time=rows).assign_coords(time=time)
    text = animation_page(Result(paper.scenario, data, paper.summary))
    assert 2e6 < len(text) < 4e6


def test_poses_are_the_results(paper):
    """Frames of the page against Pinocchio's own kinematics of the same rows."""
    run = animation(paper)["runs"][0]
    time, poses = run["time"], run["poses"].astype(float)
    scene = paper.scene()
    data = scene.model.createData()
    for frame in (0, len(time) // 2, len(time) - 1):
        q = paper.data.q.sel(time=float(time[frame]), method="nearest").values
        pin.forwardKinematics(scene.model, data, q)
        for node, pose in zip(scene_nodes(scene), poses[frame], strict=True):
            np.testing.assert_allclose(
                pin.XYZQUATToSE3(pose).homogeneous, data.oMi[node.joint].homogeneous, atol=2e-6
            )


@given(st.lists(st.floats(1e-3, 1.0), min_size=1, max_size=60), st.floats(0.1, 100), st.integers(2, 40))
@settings(deadline=None, max_examples=60, derandomize=True)
def test_picked_rows_reach_from_first_to_last_and_are_no_more_than_wanted(steps, rate, most):
    time = np.concatenate([[0.0], np.cumsum(steps)])
    rows = pick_rows(time, rate_hz=rate, most=most)
    assert (rows[0], rows[-1]) == (0, len(time) - 1)
    assert (np.diff(rows) > 0).all()
    assert len(rows) <= min(most, len(time))


def test_a_diverged_result_is_shown_up_to_where_it_went(browser, diverged, tmp_path):
    page = _show(browser, tmp_path / "page.html", animation_page(diverged), "#t=99")
    assert "diverged after 0.42 s of 10 s" in page.evaluate("document.getElementById('notice').innerText")
    assert page.evaluate("document.body.dataset.time") == f"{diverged.data.time.values[-1]:.3f}"
    assert page.errors == []


def test_several_results_stand_side_by_side_and_are_shown_by_a_tick(browser, paper, blind, tmp_path):
    shown = animation(paper, blind, names=["with", "without"], title="two", autoplay=False, first=1)
    page = _show(browser, tmp_path / "page.html", to_html(shown), "#t=4.2&look=near", (1400, 800))
    rows = page.evaluate(
        "[...document.querySelectorAll('#results tr')].map((row) => row.innerText.split('\\t'))"
    )
    assert [cell.strip() for cell in rows[0][1:]] == ["with", "without"]
    peaks = [
        max(
            max(-tip[axis]["min_m"], tip[axis]["max_m"])
            for tip in r.summary["tip_error"].values()
            for axis in "xy"
        )
        for r in (paper, blind)
    ]
    shown = [f"{float(f'{1e3 * peak:.3g}'):g} mm" for peak in peaks]
    assert rows[1] == ["peak tip error (one axis)", *shown]
    assert any(row[0].endswith("tip.amnesia") and row[2] == "none" for row in rows)
    before = page.evaluate("readout.innerText")
    page.evaluate("document.querySelector('[aria-label=\"Show without\"]').click()")
    assert "without (dashed)" in page.evaluate(CURVES)
    page.evaluate("document.querySelector('[aria-label=\"Show with\"]').click()")
    assert page.evaluate("readout.innerText") != before
    page.wait_for("location.hash.includes('shown=1')")
    assert page.evaluate("[document.body.dataset.time, look.value]") == ["4.200", "near"]
    page.evaluate("document.querySelector('[aria-label=\"Show without\"]').click()")  # one stays
    assert page.evaluate("document.querySelector('[aria-label=\"Show without\"]').checked")
    page.evaluate("paneling.click()")
    assert page.evaluate("panel.hidden && paneling.getAttribute('aria-expanded') === 'false'")
    assert page.errors == []


def test_a_campaign_is_told_by_its_distribution_bands_and_cloud(browser, tmp_path):
    scene = load_scene(one_arm.write(tmp_path))
    shown = simulate(scene, backend="interpreted")
    options = {"step_s": 0.02, "output_step_s": 0.1, "backend": "interpreted"}
    cloud = CampaignSpread(scene, build_rollout(build_closed_loop(scene), duration_s=1.0, **options))
    cloud.roll(["robots.arm.tips.tip.pid.kp"], np.array([[100.0], [150.0], [200.0]]))
    metric = {"key": "tip_error_peak", "label": "largest tip error", "unit": "mm"}
    spread = {
        "name": "own",
        "metrics": [metric | {"values": packed([1.5, 2.5, np.nan])}],
        **cloud.data(),
    }
    data = animation(shown, autoplay=False)
    data["panel"]["spreads"] = [spread]
    page = _show(browser, tmp_path / "page.html", to_html(data), "#t=0.5", (1400, 800))
    words = page.evaluate("document.getElementById('spread').innerText")
    assert "largest tip error of 3 samples, 1 of them without a value" in words
    assert "paths of tips: 3 samples" in words
    for chosen in ("tip error", "joint torque"):  # whatever a person chooses has its bands
        page.evaluate(f"location.hash = '#t=0.5&signals={chosen}'")
        page.wait_for(f"{CURVES}.includes('{chosen} [')")
        assert "bands: 5, 25, 50, 75, 95 % quantiles of samples" in page.evaluate(CURVES)
    assert "campaign's samples" in page.evaluate("legend.textContent")
    assert page.errors == []


def test_bands_reach_as_far_as_rollouts_go(tmp_path):
    """An event ends both of these after the capture, long before the scenario's end."""
    phases = {
        "approach": {"until": {"captured": ["left"]}, "timeout": 2.5},
        "carry": {"until": {"time": 0.3}},
    }
    grasp = {"kind": "weld", "capture": {"distance": 0.05, "spin_deg": 60}}
    scene = free_bodies(tmp_path, FLAT, grasp, phases=phases)
    options = {"step_s": 0.02, "output_step_s": 0.1, "backend": "interpreted"}
    cloud = CampaignSpread(scene, build_rollout(build_closed_loop(scene), duration_s=3.0, **options))
    ended = cloud.roll(["target.base.velocity.0"], np.array([[-0.1], [-0.12]])).events.ended_at_s
    told = cloud.data()
    assert told["drawn"] == 2
    assert ended.max() < 2
    assert np.array_equal(np.isfinite(told["bands"][0, 0]), told["time"] <= ended.max())
    assert np.isfinite(told["paths"]).all()


def test_what_results_share_is_kept_once(paper, blind):
    both = len(animation_page(paper, blind))
    alone = [len(animation_page(result)) for result in (paper, blind)]
    assert both + len(meshcat_script()) < sum(alone)


def test_changed_descriptions_are_told(paper):
    summary = dict(paper.summary) | {"urdf_sha256": {"rpr1": "0" * 64}}
    notices = animation(Result(paper.scenario, paper.data, summary))["notices"]
    assert notices == ["rpr1: planar_arm.urdf has changed since the run; what is drawn may differ"]


def test_results_that_differ_too_much_are_refused(paper, spatial):
    with pytest.raises(ResultError, match="cannot be compared"):
        animation_page(paper, spatial)


def test_a_folder_that_cannot_be_written_is_one_clear_line(paper, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ResultError, match="cannot be written") as fault:
        write_animation(paper, tmp_path / "file" / "page.html")
    assert "\n" not in str(fault.value)


def test_json_cannot_end_its_script():
    assert "</" not in json_text({"a": "</script><!--"})
