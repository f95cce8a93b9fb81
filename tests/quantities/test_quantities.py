"""Quantities: registered once, and known to every section and every call that names them."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import spacerobot as sr
from optim import evaluation
from optim.campaign.rollouts.metrics import build_campaign_metrics
from optim.evaluation import BatchResult, GradientResult, batch, gradient
from spacerobot.closedloop import build_closed_loop, loop_cache
from spacerobot.common.errors import ResultError, ScenarioError, SpaceRobotError
from spacerobot.quantities import (
    Context,
    PlanBound,
    Quantity,
    find_quantity,
    limited,
    metrics,
    quantities,
    register_quantity,
    weighted,
)
from spacerobot.quantities import quantity as registry
from spacerobot.rollout import build_rollout
from spacerobot.scenario import Constraints, Objective
from spacerobot.scenario.campaign import Limits
from spacerobot.scene import build_scene
from tests.oracles.small_scenes import PLANAR, small_scene

MASS = "target.links.body.mass"
DAMPING = "grasps.left.damping"
SHORT = {"simulation.duration": 0.2, "simulation.step": 0.01}


@pytest.fixture
def tip_height():
    """A quantity of a plugin: the largest height of a tip."""

    def heights(context):
        return {tip: position[1] for tip, position in context.signal("tip_position").items()}

    made = Quantity(
        name="tip_height",
        label="tip height",
        description="largest y of a tip",
        unit="m",
        reducer="peak",
        expression=heights,
        limit="tip_height",
        weight="tip_height",
    )
    yield register_quantity(made)
    registry._REGISTERED.pop("tip_height")


def test_names_keys_and_symbols_are_unique_and_every_quantity_is_described():
    known = list(quantities().values())
    for key in ("name", "limit", "weight", "cost", "symbol"):
        given = [getattr(each, key) for each in known if getattr(each, key)]
        assert len(given) == len(set(given)), key
    for each in known:
        assert min(len(text) for text in (each.label, each.description, each.unit, each.absent)) > 0


def test_the_values_are_those_of_the_outputs():
    scene = small_scene(PLANAR, {"simulation.duration": 0.4})
    loop = build_closed_loop(scene)
    kept = build_campaign_metrics(loop, scene, list(metrics()))
    rollout = build_rollout(
        loop, duration_s=0.4, step_s=0.001, output_step_s=0.001, measures=kept.measures, backend="interpreted"
    )
    run = rollout.run()
    row = kept.table({name: np.atleast_2d(value) for name, value in run.measures.items()})[0]
    found = dict(zip([column.name for column in kept.columns], row, strict=True))
    error = run.outputs["tip_error"].reshape(-1, len(scene.tips), 3)
    for k, tip in enumerate(scene.tips):
        peak = np.abs(error[:, k, 0]).max()
        assert found[f"tip_error_peak {tip.label} x"] == pytest.approx(peak, rel=1e-12)
        squares = (error[:, k] ** 2).sum(axis=1)
        rms = np.sqrt(np.trapezoid(squares, run.time) / 0.4)
        assert found[f"tip_error_rms {tip.label}"] == pytest.approx(rms, rel=1e-3)
    for name, output in (("grip_force_peak", "grasp_force"), ("grip_torque_peak", "grasp_torque")):
        sizes = np.linalg.norm(run.outputs[output].reshape(-1, len(scene.grasps), 3), axis=2)
        for k, grasp in enumerate(scene.grasps):
            assert found[f"{name} {grasp.name}"] == pytest.approx(sizes[:, k].max(), rel=1e-9, abs=2e-6)
    owners = find_quantity("joint_torque_peak").components(Context(scene, loop, kept.measures.signals))
    torque = np.abs(run.outputs["joint_torque"]).max(axis=0)
    for name in dict.fromkeys(owners.labels):
        own = torque[[label == name for label in owners.labels]].max()
        assert found[f"joint_torque_peak {name}"] == pytest.approx(own, rel=1e-12)


def test_a_plugins_quantity_is_a_limit_a_constraint_a_weight_and_a_metric(tip_height):
    assert Limits(tip_height=2.0).given == {"tip_height": 2.0}
    assert Constraints(max_tip_height=2.0).given == {"tip_height": 2.0}
    assert Objective(tip_height=3.0).given == {"tip_height": 3.0}
    assert Objective.model_json_schema()["properties"]["tip_height"]["unit"] == "objective/m"
    scene = small_scene(PLANAR, SHORT)
    campaign = {
        "parameters": {"mass": {"paths": MASS, "lower": 10, "upper": 20}},
        "metrics": ["tip_height"],
        "limits": {"tip_height": 1.0},
    }
    assert build_scene(scene.scenario, {"campaign": campaign}).scenario.campaign.metrics == ("tip_height",)
    found = batch(scene, "tip_height", {MASS: [20.0, 25.0]}, backend="interpreted")
    assert found.data.tip_height.shape == (2, len(scene.tips))
    assert "tip_height" not in weighted() or weighted()["tip_height"] is tip_height


@pytest.mark.parametrize(
    ("section", "values", "words"),
    [
        (Limits, {"joint_torq": 1.0}, "joint_torque"),
        (Constraints, {"joint_torque": 1.0}, "max_joint_torque"),
        (Objective, {"propelant": 1.0}, "propellant"),
        (Limits, {"joint_torque": 0.0}, "greater than 0"),
        (Limits, {"joint_torque": True}, "truth value"),
        (Objective, {"propellant": -1.0}, "greater than or equal to 0"),
        (Objective, {"propellant": float("inf")}, "finite"),
    ],
)
def test_a_wrong_key_or_number_is_refused_with_the_near_name(section, values, words):
    with pytest.raises(ValueError, match=words):
        section(**values)


def test_a_name_is_taken_once():
    taken = find_quantity("impulse")
    other = Quantity(
        name="impulse", label="i", description="i", unit="N s", reducer="final", expression=lambda _: None
    )
    with pytest.raises(SpaceRobotError, match="impulse"):
        register_quantity(other)
    assert register_quantity(taken) is taken
    with pytest.raises(SpaceRobotError, match="joint_torque_peak"):
        find_quantity("joint_torque")
    assert all(key for key in limited())


@pytest.mark.parametrize(
    ("keys", "section"),
    [
        ({"limit": "joint_torque"}, "campaign.limits"),
        ({"weight": "propellant"}, "tuning.objective"),
        ({"cost": "torque"}, "plan.costs"),
        ({"bounds": (PlanBound("base_force", "N", "another"),)}, "plan.limits"),
    ],
)
def test_a_key_is_that_of_one_quantity(keys, section):
    other = Quantity(
        name="other", label="o", description="o", unit="N", reducer="peak", expression="joint_torque", **keys
    )
    with pytest.raises(SpaceRobotError, match=f"in `{section}` is that of"):
        register_quantity(other)
    assert "other" not in quantities()


def test_gradients_of_quantities_agree_with_differences(tmp_path):
    scene = small_scene(PLANAR, SHORT)
    names = ["tip_error_rms", "joint_torque_peak"]
    found = gradient(scene, names, [MASS], backend="interpreted")
    assert found.status == "exact"
    mass = float(found.data.parameter_value[0])
    ends = batch(scene, names, {MASS: [mass * 1.0001, mass * 0.9999]}, backend="interpreted").data
    rms = np.linalg.norm(ends.tip_error_rms.values, axis=1)
    torque = ends.joint_torque_peak.values.max(axis=1)
    for name, values in (("tip_error_rms", rms), ("joint_torque_peak", torque)):
        slope = (values[0] - values[1]) / (2e-4 * mass)
        assert float(found.data.gradient.sel(quantity=name)[0]) == pytest.approx(slope, rel=1e-5)
    found.save(tmp_path / "gradient.nc")
    with pytest.raises(ResultError, match=r"gradient.json: found the suffix '.json', allowed: .nc"):
        found.save(tmp_path / "gradient.json")
    again = sr.load(tmp_path / "gradient.nc")
    assert isinstance(again, GradientResult)
    assert again.data.equals(found.data)
    assert again.status == found.status
    assert MASS in again._repr_html_().replace("<wbr>", "")
    with pytest.raises(ResultError, match="diverged_at"):
        BatchResult.load(tmp_path / "gradient.nc")


def test_a_gradient_at_other_values_is_that_of_the_changed_scene_and_builds_nothing(monkeypatch):
    scene, built, build = small_scene(PLANAR, SHORT), [], evaluation.build_quantity_rollout
    monkeypatch.setattr(
        evaluation, "build_quantity_rollout", lambda *given, **more: built.append(1) or build(*given, **more)
    )
    monkeypatch.setattr(loop_cache, "only_shipped", lambda: True)  # another test may have registered kinds
    evaluation._build_once.cache_clear()
    names = ["tip_error_rms", "joint_torque_peak"]
    nominal = gradient(scene, names, [MASS], at={}, backend="interpreted")
    there = gradient(scene, names, [MASS], at={MASS: 31.0}, backend="interpreted")
    again = gradient(small_scene(PLANAR, SHORT), names, [MASS], at={MASS: 31.0}, backend="interpreted")
    assert len(built) == 1
    assert again.data.identical(there.data)
    assert there.data.parameter_value.item() == 31.0
    assert (there.values.shape, there.gradients.shape) == ((2,), (2, 1))
    assert not np.allclose(there.values, nominal.values)
    changed = gradient(small_scene(PLANAR, SHORT | {MASS: 31.0}), names, [MASS], backend="interpreted")
    assert len(built) == 2
    np.testing.assert_allclose(there.values, changed.values, rtol=1e-9)
    np.testing.assert_allclose(there.gradients, changed.gradients, rtol=1e-7)
    with pytest.raises(SpaceRobotError, match=r"target\.mass: the closed loop does not depend"):
        gradient(scene, names, [MASS], at={"target.mass": 31.0}, backend="interpreted")


def test_batches_are_drawn_against_the_parameter():
    scene, masses = small_scene(PLANAR, SHORT), [20.0, 30.0, 40.0]
    one = batch(scene, "joint_torque_peak", {MASS: masses}, backend="interpreted").data
    assert one.joint_torque_peak.dims == (MASS, "joint_torque_peak_of")
    assert one.joint_torque_peak.sel({MASS: 30.0}).dims == ("joint_torque_peak_of",)
    axes = one.joint_torque_peak.plot(hue="joint_torque_peak_of", ax=Figure().subplots())[0].axes
    assert len(axes.lines) == 2
    axes = one.joint_torque_peak.sel(joint_torque_peak_of="one").plot(ax=Figure().subplots())[0].axes
    np.testing.assert_array_equal(axes.lines[-1].get_xdata(), masses)
    assert axes.get_xlabel() == f"{MASS} [kg]"
    values = {MASS: masses, DAMPING: [1.0, 2.0, 1.0]}
    two = batch(scene, "joint_torque_peak", values, backend="interpreted").data
    assert two.joint_torque_peak.dims[0] == "sample"
    np.testing.assert_array_equal(two[MASS].values, masses)
    assert two[DAMPING].attrs["units"] == "N s/m"


def test_batches_are_saved_and_bad_values_refused(tmp_path):
    scene = small_scene(PLANAR, SHORT)
    found = batch(scene, "joint_torque_peak", {MASS: [20.0, 30.0, 40.0]}, backend="interpreted")
    found.save(tmp_path / "deep" / "batch.nc")
    again = sr.load(tmp_path / "deep" / "batch.nc")
    assert isinstance(again, BatchResult)
    assert again.data.equals(found.data)
    assert "3 simulations" in repr(found)
    with pytest.raises(ScenarioError, match="all of the same length"):
        batch(scene, "joint_torque_peak", {MASS: [1.0, 2.0], "simulation.duration": [1.0]})
    with pytest.raises(ScenarioError, match="thrusters"):
        gradient(scene, "propellant", [MASS])
