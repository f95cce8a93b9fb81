"""Figures: what they plot is the result's data, and every axis says its unit."""

import dataclasses
import re
import warnings

import matplotlib as mpl
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.text import Text

from spacerobot.common.errors import ResultError, SpaceRobotError
from spacerobot.result.result import Result
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from spacerobot.simulation.paper import FIGURE_7_MM, FIGURE_10_MM
from tests.oracles import one_arm
from tests.oracles.small_scenes import PLANAR, small_scene
from viz.figures import (
    approach,
    base_motion,
    convergence,
    data_profiles,
    docking,
    draw_all,
    figure_kinds,
    grip_forces,
    joints,
    ledger,
    momentum_budget,
    object_motion,
    orientation_errors,
    robustness,
    running_times,
    save_figures,
    sensitivities,
    tip_errors,
    tip_paths,
    wheels,
)
from viz.figures.labels import labels_of
from viz.figures.ledger import energy_astray
from viz.figures.style import below_last, drawn_for, lay_out, panel_grid, to_bytes
from viz.figures.tips import enlargement
from viz.figures.wheels import shares
from viz.page.signals import quantities

UNIT = re.compile(r"\[(m|mm|mm/s|s|deg|deg/s|N|N m|N s|N m s|J|%|rollouts)\]$")
PURE = {"relative to the largest"}
"""What has no unit."""


def _lines(figure, title):
    axes = next(axes for axes in figure.axes if title in (axes.get_title("left"), axes.get_title()))
    return {line.get_label(): line.get_xydata() for line in axes.get_lines()}


def _check_units(figure):
    for axes in figure.axes:
        if not axes.axison:
            continue
        for axis in (axes.xaxis, axes.yaxis):
            label = " ".join(axis.get_label_text().split())
            told = UNIT.search(label) or label in PURE
            assert told or not any(tick.get_visible() for tick in axis.get_ticklabels()), label


@pytest.mark.parametrize("name", ["diverged", "docked"])
def test_every_axis_has_a_unit_and_every_figure_draws(name, request):
    result = request.getfixturevalue(name)
    drawn = list(draw_all(result))
    assert [file for file, _, _ in drawn] == [kind.name for kind in figure_kinds() if kind.applies(result)]
    for _, _, figure in drawn:
        figure.draw_without_rendering()
        _check_units(figure)


def test_tip_errors_are_the_results_in_millimetres(paper):
    figure = tip_errors(paper)
    drawn = _lines(figure, "rpr2/tip, y")["simulated: paper"]
    np.testing.assert_allclose(drawn[:, 0], paper.data.time)
    np.testing.assert_allclose(drawn[:, 1], paper.data.tip_error.sel(tip="rpr2/tip", axis="y") * 1e3)
    assert {axes.get_ylim() for axes in figure.axes} == {figure.axes[0].get_ylim()}


def test_the_papers_bands_lie_behind_the_papers_scenario_alone(paper, spatial):
    axes = next(a for a in tip_errors(paper).axes if a.get_title("left") == "rpr1/tip, y")
    low, high = axes.patches[0].get_y(), axes.patches[0].get_y() + axes.patches[0].get_height()
    assert (low, high) == pytest.approx(FIGURE_7_MM[1])
    dashed = [line.get_ydata()[0] for line in axes.get_lines() if len(line.get_ydata()) == 2]
    assert set(FIGURE_10_MM[1]) <= set(dashed)
    assert not any(axes.patches for axes in tip_errors(spatial).axes)


def test_before_and_after_share_one_scale(paper, blind):
    figure = tip_errors(blind, paper)
    drawn = _lines(figure, "rpr1/tip, x")
    assert {"simulated: pid", "simulated: amnesia", "published, Fig. 10 (GA-tuned)"} <= set(drawn)
    blind_mm, amnesia_mm = (np.abs(drawn[f"simulated: {name}"][:, 1]).max() for name in ("pid", "amnesia"))
    assert blind_mm > 50 * amnesia_mm


def test_sizes_of_errors_show_the_smaller_ones_as_well(paper, blind):
    figure = tip_errors(blind, paper)
    panel = next(axes for axes in figure.axes if axes.get_title("left") == "rpr1/tip, size")
    sizes = [np.linalg.norm(r.data.tip_error.sel(tip="rpr1/tip").values, axis=-1) for r in (blind, paper)]
    for drawn, size in zip(panel.get_lines(), sizes, strict=True):
        np.testing.assert_allclose(drawn.get_ydata()[1:], size[1:] * 1e3)
    assert panel.get_yscale() == "log"
    assert len(tip_errors(paper).axes) == 4


@given(st.floats(1e-9, 1.0), st.floats(1e-3, 10.0))
@settings(deadline=None, max_examples=60, derandomize=True)
def test_enlarged_errors_are_seen_and_do_not_fill_the_picture(error, reach):
    times = enlargement(error, reach)
    assert times >= 1
    if error < 0.04 * reach:
        assert 0.04 * reach < times * error < 0.121 * reach
    else:
        assert times == 1


def test_enlarged_paths_are_the_references_with_larger_errors(paper):
    drawn = _lines(tip_paths(paper), "(b) rpr2/tip")
    error = paper.data.tip_error.sel(tip="rpr2/tip").values[:, :2]
    larger = drawn["reference"] - drawn["actual, error enlarged"]
    np.testing.assert_allclose(larger, 100 * error, atol=1e-12)


def test_paths_of_one_figure_have_one_scale_and_the_same_planes(spatial, paper):
    figure = tip_paths(spatial)
    figure.draw_without_rendering()
    labels = [(axes.get_xlabel(), axes.get_ylabel()) for axes in figure.axes]
    assert labels == [("x [m]", "z [m]")] * 2 + [("x [m]", "y [m]")] * 2
    for drawn in (figure, tip_paths(paper)):
        drawn.draw_without_rendering()
        scales = [np.ptp(axes.get_xlim()) / axes.bbox.width for axes in drawn.axes]
        scales += [np.ptp(axes.get_ylim()) / axes.bbox.height for axes in drawn.axes]
        np.testing.assert_allclose(scales, scales[0], rtol=0.02)


def test_orientation_errors_are_drawn_where_orientation_is_controlled(spatial, paper):
    figure = orientation_errors(spatial)
    assert len(figure.axes) == 6
    (drawn,) = [d for name, d in _lines(figure, "servicer/left_tip, about y").items() if name == "servicer"]
    expected = spatial.data.tip_orientation_error.sel(tip="servicer/left_tip", axis="y")
    np.testing.assert_allclose(drawn[:, 1], np.degrees(expected))
    assert "orientation_errors" in {name for name, _, _ in draw_all(spatial, names=["orientation_errors"])}
    assert not list(draw_all(paper, names=["orientation_errors"]))


@pytest.mark.parametrize(
    ("name", "width", "millimetres"),
    [("paper", "double", 183), ("spatial", "single", 89), ("docked", "single", 89)],
)
def test_figures_fit_a_journals_columns_with_texts_that_can_be_read(name, width, millimetres, request):
    result = request.getfixturevalue(name)
    with drawn_for(width):
        for file, _, figure in draw_all(result):
            lay_out(figure)
            figure.draw_without_rendering()
            _check_units(figure)
            assert figure.get_figwidth() * 25.4 == pytest.approx(millimetres)
            assert figure.get_figheight() * 25.4 < (120.01 if width == "single" else 250), file
            inside = figure.get_tightbbox().padded(-0.03)
            assert inside.x0 > -0.01, file
            assert inside.x1 < figure.get_figwidth() + 0.01, file
            texts = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]
            assert min(text.get_fontsize() for text in texts) >= 7, file
            if width == "single" and file not in ("docking", "storyboard"):
                sizes = [axes.get_position().size * figure.get_size_inches() for axes in figure.axes]
                assert np.min(sizes) > 0.45, file
    with pytest.raises(ResultError, match="no width 'triple'"), drawn_for("triple"):
        pass


def test_joints_of_one_robot_can_be_told_apart(spatial):
    drawn = joints(spatial).axes[0].get_lines()
    looks = {(line.get_color(), str(line._dash_pattern)) for line in drawn}
    assert len(looks) == len(drawn) == 14


def test_the_last_panel_of_each_column_has_the_time_also_above_a_blank_one():
    figure, axes = panel_grid(3, 2, sharex=True)
    for panel in axes.flat:
        panel.set_xlabel("time [s]")
    below_last(axes)
    figure.draw_without_rendering()
    labelled = [(panel.get_xlabel(), panel.xaxis.get_tick_params()["labelbottom"]) for panel in axes.flat[:3]]
    assert labelled == [("", False), ("time [s]", True), ("time [s]", True)]


def test_names_of_many_joints_fit_beside_their_curves(paper):
    data, count = paper.data, 50
    many = data.isel(joint=[0] * count).assign_coords(joint=[f"rpr1/joint_{k}" for k in range(count)])
    figure = joints(dataclasses.replace(paper, data=many))
    figure.draw_without_rendering()
    (legend,) = [axes.get_legend() for axes in figure.axes if axes.get_legend()]
    box = legend.get_window_extent()
    assert box.height < figure.bbox.height
    assert 0 <= box.y0 < box.y1 <= figure.bbox.height


def test_any_number_of_results_has_names_that_differ(paper):
    again = Result(paper.scenario, paper.data, paper.summary)
    assert len(set(labels_of([again] * 12))) == 12


def test_results_are_labelled_by_the_value_in_which_they_differ(paper):
    """The number alone says nothing of curves of one scenario with three masses."""
    several = []
    for mass in (20, 60, 180):
        scenario = load_scene("paper", {"target.links.body.mass": mass}).scenario
        several.append(Result(scenario, paper.data, paper.summary))
    assert labels_of(several) == ["body.mass = 20", "body.mass = 60", "body.mass = 180"]
    assert labels_of([*several, several[0]]) == [f"paper ({k})" for k in (1, 2, 3, 4)]  # two are equal


def test_paths_have_four_panels_for_two_results(paper, blind):
    figure = tip_paths(blind, paper)
    drawn = _lines(figure, "(d) rpr2/tip, amnesia")
    np.testing.assert_allclose(drawn["actual"], paper.data.tip_position.sel(tip="rpr2/tip").values[:, :2])
    np.testing.assert_allclose(drawn["reference"], paper.data.tip_reference.sel(tip="rpr2/tip").values[:, :2])


def test_object_and_bases_turn_and_move_as_the_result_says(paper):
    angle = paper.data.body_angle
    turned = _lines(object_motion(paper), "(a) rotation of rectangle")["about z"][:, 1]
    expected = angle.sel(body="target")
    np.testing.assert_allclose(turned, np.degrees(expected - expected[0]))
    moved = _lines(base_motion(paper), "base of rpr2, translation")["y"][:, 1]
    position = paper.data.body_position.sel(body="rpr2", axis="y")
    np.testing.assert_allclose(moved, (position - position[0]) * 1e3)


def test_joints_and_grips_are_the_results(paper):
    figure = joints(paper)
    angles = next(axes for axes in figure.axes if axes.get_title("left") == "rpr1, joint angles")
    drawn = np.array([line.get_ydata() for line in angles.get_lines()])
    np.testing.assert_allclose(drawn, np.degrees(paper.data.joint_position.values[:, :8]).T)
    torques = next(axes for axes in figure.axes if axes.get_title("left") == "rpr2, actuator torques")
    drawn = np.array([line.get_ydata() for line in torques.get_lines()])
    np.testing.assert_allclose(drawn, paper.data.joint_torque.values[:, 8:].T)
    force = _lines(grip_forces(paper), "grasp left, force")["x"][:, 1]
    np.testing.assert_allclose(force, paper.data.grasp_force.sel(grasp="left", axis="x"))


def test_an_approach_ends_in_its_envelope_with_the_velocity_of_the_capture(docked, paper):
    captured = next(event for event in docked.summary["events"] if event["kind"] == "captured")
    figure = approach(docked)
    ends = {
        text: _lines(figure, text)["grasp left"][-1]
        for text in ("lateral error", "closing speed", "lateral speed")
    }
    assert np.hypot(*ends["lateral error"]) == pytest.approx(50, abs=1e-4)
    speeds = [ends["closing speed"][1], ends["lateral speed"][1]]
    assert np.hypot(*speeds) == pytest.approx(1e3 * np.linalg.norm(captured["relative_velocity_m_s"]))
    to_go, lateral = _lines(figure, "lateral error")["grasp left"].T
    apart = np.linalg.norm(docked.data.grasp_gap.sel(grasp="left").values, axis=1)
    np.testing.assert_allclose(np.hypot(to_go, lateral)[:-1], 1e3 * apart[: len(to_go) - 1])
    closing = _lines(figure, "closing speed")["grasp left"][:, 1]
    rates = -np.diff(to_go)[:-1] / np.diff(docked.data.time.values[: len(to_go) - 1])
    np.testing.assert_allclose(rates, ((closing[1:] + closing[:-1]) / 2)[:-1], atol=1e-3)
    spin = _lines(figure, "relative spin")["grasp left"][-1, 1]
    assert spin == pytest.approx(np.degrees(np.linalg.norm(captured["relative_spin_rad_s"])))
    assert "misalignment" not in [axes.get_title("left") for axes in figure.axes]
    assert "approach" not in [name for name, _, _ in draw_all(paper)]


@pytest.mark.parametrize("draw", [tip_errors, grip_forces, base_motion])
def test_phases_are_named_and_captures_marked_once_in_a_figure(draw, docked, paper):
    figure = draw(docked)
    phases = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert phases == ["approach", "carry", "part"]
    captured = next(event for event in docked.summary["events"] if event["kind"] == "captured")
    for axes in figure.axes:
        marked = [line.get_xdata()[0] for line in axes.get_lines() if len(line.get_xdata()) == 2]
        assert captured["time_s"] in marked
    labels = [label for axes in figure.axes for label in axes.get_legend_handles_labels()[1]]
    assert labels.count("captured") == labels.count("released") == 1
    assert not [text for axes in draw(paper).axes for text in axes.texts]


def test_the_ledgers_drift_is_the_summarys(paper):
    drawn = _lines(ledger(paper), "momentum drift, open energy")
    kept = paper.summary["ledger"]
    for kind in ("linear", "angular"):
        drift = np.nanmax(drawn[kind][:, 1])
        assert drift == pytest.approx(kept["momentum"][kind]["relative_drift"])
    assert np.nanmax(drawn["energy"][:, 1]) == pytest.approx(kept["energy"]["relative_residual"])


def test_the_ledger_and_the_page_show_every_work_that_a_result_has(paper):
    """A work of a user's own kind, too: it is named, drawn and counted by what its variable says."""
    solar = paper.data.time * 0.25
    solar.attrs = {"units": "J", "long_name": "work put in: solar", "sign": 1}
    result = dataclasses.replace(paper, data=paper.data.assign(work_solar=solar))
    np.testing.assert_allclose(
        _lines(ledger(result), "energy since the start")["put in: solar"][:, 1], solar.values
    )
    np.testing.assert_allclose(energy_astray(result), energy_astray(paper) - solar.values)
    works = next(found for found in quantities(result) if found.title == "work since the start")
    assert "put in: solar" in [signal.name for signal in works.signals]


def test_the_ledgers_drift_is_the_summarys_where_a_robot_holds_nothing(tmp_path):
    """All momentum is rounding there, and is measured by what moves inside the robot."""
    result = simulate(load_scene(one_arm.write(tmp_path, target=None, grasps={})), backend="interpreted")
    for kind, unit in (("linear", "n_s"), ("angular", "n_m_s")):
        kept = result.summary["ledger"]["momentum"][kind]
        of_the_arm = np.linalg.norm(result.data[f"body_momentum_{kind}"].values, axis=-1).max()
        assert of_the_arm < 1e-3 * kept[f"largest_partial_{unit}"]
        drawn = _lines(ledger(result), "momentum drift, open energy")[kind][:, 1]
        assert np.nanmax(drawn) == pytest.approx(kept["relative_drift"])


POINT = """
<robot name="point">
  <link name="base"/>
  <link name="rod"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>
  </inertial></link>
  <joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 0 1"/></joint>
</robot>
"""


def test_a_robot_without_shapes_is_drawn_without_a_warning(tmp_path):
    (tmp_path / "point.urdf").write_text(POINT)
    robot = {"urdf": "point.urdf", "base": {"joint": "fixed"}, "joints": {"hinge": {"rate_deg": 10}}}
    simulation = {"duration": 0.2, "step": 0.1, "output_step": 0.1}
    document = {"name": "point", "robots": {"point": robot}, "simulation": simulation}
    (tmp_path / "point.yaml").write_text(yaml.safe_dump(document))
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        figure = docking(simulate(load_scene(tmp_path / "point.yaml"), backend="interpreted"))
        figure.draw_without_rendering()
    panel = figure.axes[0]
    assert np.ptp(panel.get_xlim()) == pytest.approx(1.0)


def test_the_strip_shows_the_bases_where_they_are(paper):
    """Centre of robot 1's gold base in the middle frame against the result's base position."""
    figure = docking(paper, frames=3)
    panel = next(axes for axes in figure.axes if axes.get_title("left") == "t = 5 s")
    drawn = max(panel.collections, key=lambda c: c.get_zorder())
    squares = [path.vertices[:4] for path in drawn.get_paths() if len(path.vertices) == 5]
    sides = [np.linalg.norm(square[1] - square[0]) for square in squares]
    centres = [s.mean(axis=0) for s, side in zip(squares, sides, strict=True) if side == pytest.approx(0.68)]
    wanted = paper.data.body_position.sel(body="rpr1").sel(time=5.0, method="nearest").values[:2]
    assert min(np.linalg.norm(centre - wanted) for centre in centres) < 1e-9


def test_files_are_written_the_same_each_time(paper, blind, tmp_path):
    for folder in ("a", "b"):
        save_figures(blind, tmp_path / folder, paper, formats=("svg", "png"), names=["ledger"])
    names = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert names == sorted(f"{n}.{f}" for n in ("ledger", "ledger_2") for f in ("svg", "png"))
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_wrong_names_are_told_with_near_ones(paper, tmp_path):
    with pytest.raises(SpaceRobotError, match="did you mean joints"):
        save_figures(paper, tmp_path, names=["joint"])
    with pytest.raises(ResultError, match="pdf, png, svg"):
        save_figures(paper, tmp_path, formats=["tiff"])


def test_drawing_leaves_the_callers_style_alone_and_shows_itself(paper):
    before = dict(mpl.rcParams)
    picture = ledger(paper)._repr_png_()
    assert picture.startswith(b"\x89PNG")
    assert dict(mpl.rcParams) == before


def test_convergence_draws_the_median_and_the_band_of_all_runs():
    runs = {"a": [[(10, 0.5), (100, 0.01)], [(20, 0.1)], [(30, 0.2)]], "b": [[(5, 1.0), (400, 0.0)]]}
    figure = convergence(runs, targets=[0.01], ends={"a": [200, 200, 200], "b": [400]})
    first, second = figure.axes[:2]
    assert (first.get_xlim(), first.get_ylim()) == (second.get_xlim(), second.get_ylim())
    assert [panel.get_title("left") for panel in (first, second)] == ["a (3 runs)", "b (1 run)"]
    costs, median = first.get_lines()[2].get_data()
    assert median[-1] == 0.1
    assert np.isnan(median[costs < 20]).all()
    (band,) = first.collections
    heights = band.get_paths()[0].vertices[:, 1]
    assert (heights.min(), sorted(set(heights))[-1] > 1) == (0.01, True)
    figure.draw_without_rendering()
    ticks = [tick.get_text() for tick in first.get_yticklabels() if tick.get_text()]
    assert len(set(ticks)) == len(ticks) >= 3
    assert {"1 %", "0.01 %"} & set(ticks)


def test_running_times_that_were_never_met_say_so():
    never = (np.inf, np.inf, np.inf)
    figure = running_times(
        {"a": [(10, 5, 20), never], "b": [(30, 10, np.inf), never]}, targets=["1 %", "0.1 %"]
    )
    left, right = figure.axes
    assert [line.get_xdata().tolist() for line in left.get_lines()][1::2] == [[10], [30]]
    assert [text.get_text() for text in right.texts] == ["never met", "never met"]


def test_data_profiles_draw_shares_and_intervals():
    one = {"share": [0.0, 0.5], "low": [0.0, 0.3], "high": [0.1, 0.8]}
    figure = data_profiles([1.0, 100.0], {"a": one})
    (line,) = figure.axes[0].get_lines()
    assert line.get_xydata().tolist() == [[1.0, 0.0], [100.0, 0.5]]
    assert len(figure.axes[0].collections) == 1
    _check_units(figure)


def test_sensitivities_put_the_strongest_first():
    figure = sensitivities(["weak", "strong"], {"design": [0.1, -2.0]}, quantity="error")
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["strong", "weak"]
    assert [bar.get_width() for bar in figure.axes[0].patches] == [-2.0, 0.1]


def test_robustness_counts_diverged_runs_as_worst():
    figure = robustness({"design": [1.0, np.nan, 2.0, 3.0]}, quantity="error", unit="mm", limit=2.5)
    drawn = figure.axes[0].get_lines()[0].get_xydata()
    assert drawn.tolist() == [[1.0, 0.25], [2.0, 0.5], [3.0, 0.75]]
    _check_units(figure)


def test_a_figure_is_laid_out_once_and_written_with_plain_fonts(paper, monkeypatch):
    from fontTools.subset import Options
    from fontTools.ttLib import TTFont
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    dropped, laid_out, opened = list(Options._drop_tables_default), [], []
    execute, save = ConstrainedLayoutEngine.execute, TTFont.save
    monkeypatch.setattr(ConstrainedLayoutEngine, "execute", lambda *a: laid_out.append(a) or execute(*a))
    monkeypatch.setattr(
        TTFont, "save", lambda font, *a, **k: opened.append(set(font.keys())) or save(font, *a, **k)
    )
    figure = tip_errors(paper)
    for form in ("pdf", "svg", "png"):
        to_bytes(figure, form)
    assert len(laid_out) == 1
    assert opened
    assert not set().union(*opened) & {"GPOS", "GSUB", "GDEF"}
    assert Options._drop_tables_default == dropped


def test_the_momentum_budget_adds_up():
    """Robots without wheels, wheels and object come to what came from outside."""
    held = {"turn": {"kind": "base_attitude", "kp": 40, "kd": 20}, "go": {"kind": "base_position", "kp": 20}}
    actuators = {
        "wheels": {"kind": "reaction_wheels", "axes": [[0, 0, 1]], "inertia": 0.05},
        "pull": {"kind": "base_wrench", "force": 3},
    }
    changes = {"robots.one.controllers": held, "robots.one.actuators": actuators, "simulation.duration": 0.4}
    result = simulate(small_scene(PLANAR, changes), backend="interpreted")
    for kind, axis in (("angular", "z"), ("linear", "x")):
        parts = dict(shares(result, kind, axis))
        outside = parts.pop("impulse from outside")
        assert ("wheels" in parts) == (kind == "angular")
        assert np.ptp(outside) > 1e-3
        np.testing.assert_allclose(sum(parts.values()), outside, atol=1e-12)
    (panel,) = (a for a in momentum_budget(result).axes if "angular" in a.get_title("left"))
    assert {"robots without wheels", "wheels", result.scenario.body_label("target"), "all together"} <= {
        line.get_label() for line in panel.get_lines()
    }
    assert len(wheels(result).axes) == 2
