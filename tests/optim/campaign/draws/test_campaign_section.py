"""The campaign section: what it takes, and how it refuses the rest."""

import pytest

from optim.campaign.sampling.parameter_space import campaign_of, check_range, gain_set, resolve_space
from spacerobot.common.errors import ScenarioError
from spacerobot.scenario.document import read_document
from spacerobot.scenario.load import to_yaml, validate
from spacerobot.scenario.paths import assign

MASS = {"paths": "target.links.body.mass", "lower": 10, "upper": 30}


def section(small_file, **changes):
    document = read_document(small_file)
    document["campaign"] = {"parameters": {"mass": MASS}} | changes
    return document


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"design": "sobl"}, "did you mean sobol"),
        ({"sampels": 3}, "did you mean samples"),
        ({"metrics": ["tip_eror_peak"]}, "did you mean tip_error_peak"),
        ({"parameters": {"m": MASS | {"kind": "unifrom"}}}, "did you mean uniform"),
        ({"parameters": {"m": MASS | {"kind": "normal"}}}, "takes mean, std"),
        ({"parameters": {"m": MASS | {"lower": 30}}}, "lower must be below upper"),
        ({"parameters": {"m": MASS | {"lower": None}}}, "lower is missing"),
        ({"parameters": {"m": MASS | {"mean": 1}}}, "mean is given"),
        ({"correlation": [[1, 0.5]]}, "1 rows of 1"),
        ({"correlation": [[2]]}, "mass with itself is 1"),
        ({"percentiles": [0]}, "between 0 and 100"),
        ({"samples": 0}, "found 0, allowed: at least 1"),
        ({"design": "saltelli", "samples": 3}, "power of two"),
        ({"design": "grid", "levels": 10_000, "parameters": {"a": MASS, "b": MASS, "c": MASS}}, "at most"),
    ],
)
def test_faults_are_told(small_file, changes, words):
    with pytest.raises(ScenarioError, match=words):
        validate(section(small_file, **changes))


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]], "not positive definite"),
        ([[1, 0.2, 0], [0.3, 1, 0], [0, 0, 1]], "b with a is one number"),
        ([[1, 1, 0], [1, 1, 0], [0, 0, 1]], "between -1 and 1"),
    ],
)
def test_a_matrix_that_is_no_correlation_is_refused(small_file, rows, words):
    three = dict.fromkeys("abc", MASS)
    with pytest.raises(ScenarioError, match=words):
        validate(section(small_file, parameters=three, correlation=rows))
    identity = [[float(i == j) for j in range(3)] for i in range(3)]
    with pytest.raises(ScenarioError, match="independent"):
        validate(section(small_file, parameters=three, correlation=identity, design="grid"))


def test_it_survives_a_round_trip(small_file, tmp_path):
    scenario = validate(section(small_file, correlation=[[1]], samples=7))
    (tmp_path / "again.yaml").write_text(to_yaml(scenario))
    assert validate(read_document(tmp_path / "again.yaml")) == scenario


@pytest.mark.parametrize(
    ("paths", "words"),
    [
        ("target.links.boddy.mass", "did you mean body"),
        ("robots.arm.urdf", "is no number"),
    ],
)
def test_a_path_that_leads_nowhere_is_told(small, paths, words):
    scene = small(campaign={"parameters": {"mass": MASS | {"paths": paths}}})
    with pytest.raises(ScenarioError, match=words):
        resolve_space(scene, campaign_of(scene))


def test_a_number_follows_one_parameter(small):
    twice = {"mass": MASS, "again": MASS | {"paths": "target.links.*.mass"}}
    scene = small(campaign={"parameters": twice})
    with pytest.raises(ScenarioError, match="set by mass already"):
        resolve_space(scene, campaign_of(scene))


def test_draws_become_numbers(small):
    two = {
        "scale": {"paths": "grasps.*.stiffness", "apply": "factor", "lower": 0.5, "upper": 2},
        "shift": {"paths": "robots.arm.joints.joint_1.angle_deg", "apply": "offset", "lower": -1, "upper": 1},
        "offset": {"paths": "robots.*.sensors.tip_position.offset", "lower": -1e-3, "upper": 1e-3},
    }
    scene = gain_set(small(campaign={"parameters": two}), {})
    space = resolve_space(scene, campaign_of(scene))
    assert space.paths == (
        "grasps.left.stiffness",
        "robots.arm.joints.joint_1.angle_deg",
        "robots.arm.sensors.tip_position.offset",
    )
    assert space.values([[0.5, 1.0, 3e-4], [2, -1, 0]]).tolist() == [[50, 41, 3e-4], [200, 39, 0]]


def test_draws_that_no_scenario_may_hold_are_refused(small):
    wide = {"paths": "target.links.body.mass", "kind": "normal", "mean": 1, "std": 1}
    scene = small(campaign={"parameters": {"mass": wide}})
    space = resolve_space(scene, campaign_of(scene))
    check_range(scene, space, [[1.0], [2.0]])
    told = r"target.links.body.mass: .* found -1.0, allowed: at least 0 \[kg\]; cut"
    with pytest.raises(ScenarioError, match=told):
        check_range(scene, space, [[1.0], [-1.0]])


def test_a_scenario_without_one_says_so(small):
    with pytest.raises(ScenarioError, match="no campaign section"):
        campaign_of(small(campaign=None))


def test_an_unknown_change_in_a_gain_set(small):
    with pytest.raises(ScenarioError, match="did you mean arm"):
        gain_set(small(), {"robots.arn.tips.tip.pid.kp": 1})


def test_assigning_keeps_the_section(small_file):
    document = assign(section(small_file), "campaign.samples", 9)
    assert validate(document).campaign.count == 9
