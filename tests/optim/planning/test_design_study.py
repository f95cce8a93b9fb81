"""Design studies, held to a mass on a rail: the least cost is 12 m^2 d^2 / T^3 + w T."""

import json

import numpy as np
import pytest
import yaml

from optim.planning.output.study_folder import to_data, write
from optim.planning.studies import design_study
from optim.planning.studies.design_study import make_study
from spacerobot.common.errors import ScenarioError
from spacerobot.scene import load_scene
from tests.optim.planning.test_independent_checks import RAIL, to
from viz.figures.design_study import study as drawn
from viz.figures.style import write_drawings

D, W = 1.5, 0.5
BEST = (36 * D**2 / W) ** 0.25
"""Of T, where the mass is 1 kg."""
PLAN = {
    "duration": {"lower": 3, "upper": 3},
    "goals": to(slide={"offset": D}),
    "costs": {"torque": 1, "time": W},
    "limits": {"torque": 100},
    "intervals": 2,
    "design": {
        "mass": {"paths": "robots.one.links.cart.mass", "lower": 1, "upper": 4, "scale": "log"},
        "time": {"paths": "plan.duration.*er", "lower": 2, "upper": 6},
    },
}


def least(mass, time):
    return 12 * mass**2 * D**2 / time**3 + W * time


@pytest.fixture(scope="module")
def rail(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rail")
    (folder / "robot.urdf").write_text(RAIL.replace('effort="4"', 'effort="100"'))
    robot = {"urdf": "robot.urdf", "base": {"joint": "fixed"}}
    file = folder / "rail.yaml"
    file.write_text(yaml.safe_dump({"name": "rail", "robots": {"one": robot}, "plan": PLAN}))
    return file


@pytest.fixture(scope="module")
def study(rail):
    return make_study(load_scene(rail), 3, backend="interpreted")


def test_the_best_design_is_found(study):
    assert study.optimum.values == pytest.approx([1.0, BEST], rel=1e-4)
    assert study.optimum.cost == pytest.approx(least(1.0, BEST), rel=1e-8)
    assert study.plan.motion.duration_s == pytest.approx(BEST, rel=1e-4)
    assert study.plan.scene.scenario.robots["one"].links["cart"].mass == pytest.approx(1.0)


def test_costs_and_slopes_of_every_design_are_the_exact_ones(study):
    trials = [*study.trials, *study.sweeps["mass"], *study.sweeps["time"]]
    assert len(study.sweeps["mass"]) == 3
    for trial in trials:
        m, t = trial.values
        assert trial.cost == pytest.approx(least(m, t), rel=1e-8)
        exact = [24 * m * D**2 / t**3, W - 36 * m**2 * D**2 / t**4]
        np.testing.assert_allclose(trial.slopes, exact, rtol=1e-6, atol=1e-6)


def test_a_study_that_was_interrupted_goes_on_and_gives_the_same_numbers(rail, tmp_path, monkeypatch):
    scene = load_scene(rail, {"plan.design": {"time": PLAN["design"]["time"]}, "plan.tolerance": 1.0})
    monkeypatch.setattr(design_study, "DESIGNS", 3)
    whole, asked, found = make_study(scene, 2, backend="interpreted"), [], design_study.solve_request

    def interrupted(solver, request):
        asked.append(request)
        if len(asked) == 2:
            raise KeyboardInterrupt
        return found(solver, request)

    monkeypatch.setattr(design_study, "solve_request", interrupted)
    with pytest.raises(KeyboardInterrupt):
        make_study(scene, 2, backend="interpreted", folder=tmp_path)
    again = make_study(scene, 2, backend="interpreted", folder=tmp_path)
    trials = len(whole.trials) - 1 + len(whole.sweeps["time"])
    assert len(asked) == trials + 2  # the interrupted one twice, and the last one, which refines
    assert to_data(again)["trials"] == to_data(whole)["trials"]
    assert to_data(again)["sweeps"] == to_data(whole)["sweeps"]


def test_what_it_leaves_is_written_and_drawn(study, tmp_path):
    data = write(study, tmp_path)
    assert json.loads((tmp_path / "design.json").read_text()) == data
    assert data["variables"]["mass"]["unit"] == "kg"
    assert data["variables"]["mass"]["where"] == "at its lower bound"
    write_drawings([("design", drawn(data))], tmp_path / "figures")
    assert (tmp_path / "figures" / "design.png").stat().st_size > 5000
    assert (tmp_path / "followed.yaml").is_file()


@pytest.mark.parametrize(
    ("design", "words"),
    [
        ({}, "plan.design: no variables"),
        ({"mass": {"paths": "robots.one.links.card.mass", "lower": 1, "upper": 2}}, "did you mean cart"),
        ({"mass": {"paths": "robots.one.urdf", "lower": 1, "upper": 2}}, "is no number"),
    ],
)
def test_a_study_of_nothing_is_refused(rail, design, words):
    with pytest.raises(ScenarioError, match=words):
        make_study(load_scene(rail, {"plan.design": design}))
