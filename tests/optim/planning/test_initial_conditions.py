"""Postures and placements to begin from, found with the motion."""

import numpy as np
import pytest
import yaml

from optim.planning.output.following_scenario import following_scenario
from optim.planning.search.make_plan import make_plan
from spacerobot.common.errors import ScenarioError
from spacerobot.scene import load_scene
from tests.optim.planning.test_independent_checks import RAIL, scene, to

BODY = {
    "robots": {
        "one": {
            "urdf": "rectangle.urdf",
            "base": {"joint": "planar"},
            "tips": {"tip": {"frame": "body"}},
        }
    },
    "plan": {
        "duration": 3,
        "goals": {"come": {"tip": "one/tip", "position": [1.5, 0.2, 0]}, "rest": {"still": "one"}},
        "start": {"one": {"position": [0.5, 0.5, 0]}},
        "costs": {"base_wrench": 1},
        "limits": {"base_force": 100, "base_torque": 100},
        "intervals": 2,
    },
}


def test_a_joint_begins_as_near_to_its_goal_as_it_may(tmp_path):
    """The integral of the squared force is 12 m^2 d^2 / T^3, and d is half a metre less."""
    plan = {
        "duration": 3,
        "goals": to(slide={"offset": 1.5}),
        "start": {"one": {"joints": {"slide": {"offset": 0.5}}}},
        "costs": {"torque": 1},
        "intervals": 2,
    }
    found = make_plan(scene(tmp_path, RAIL, "fixed", plan), backend="interpreted")
    assert found.motion.q[0] == pytest.approx(0.5, abs=1e-7)
    assert found.cost == pytest.approx(12 * 4 * 1.0**2 / 27, rel=1e-6)
    assert following_scenario(found).robots["one"].joints["slide"].offset == pytest.approx(0.5, abs=1e-7)


@pytest.fixture(scope="module")
def free_body(tmp_path_factory):
    file = tmp_path_factory.mktemp("free") / "free.yaml"
    file.write_text(yaml.safe_dump(BODY))
    return lambda *changes: load_scene(file, list(changes))


def test_a_base_is_placed_where_its_way_is_straight_and_shortest(free_body):
    found = make_plan(free_body(), backend="interpreted")
    mass = found.scene.model.inertias[1].mass
    np.testing.assert_allclose(found.motion.q[0, :2], [0.5, 0.2], atol=1e-6)
    assert found.cost == pytest.approx(12 * mass**2 / 27, rel=1e-6)
    np.testing.assert_allclose(
        following_scenario(found).robots["one"].base.position, [0.5, 0.2, 0], atol=1e-6
    )


def test_a_base_turned_as_it_likes_reaches_its_target_at_less_cost(reach):
    changes = [("plan.intervals", 6), ("plan.tolerance", 1e-3), ("plan.costs", {"torque": 1})]
    room = {"one": {"position": [0.1, 0.1, 0], "rotation_deg": 20, "joints": {"joint_*": {"angle_deg": 10}}}}
    given = make_plan(reach(*changes), backend="interpreted")
    free = make_plan(reach(*changes, ("plan.start", room)), backend="interpreted")
    assert free.cost < 0.9 * given.cost
    assert np.hypot(*free.motion.z[0, 2:4]) == pytest.approx(1, abs=1e-8)
    base = following_scenario(free).robots["one"].base
    assert abs(base.rotation_deg[2]) <= 20 + 1e-6
    assert np.abs(np.array(base.position) - [-0.5, 0, 0]).max() <= 0.1 + 1e-6


@pytest.mark.parametrize(
    ("room", "message"),
    [
        ({"two": {}}, "plan.start.two: no robot 'two'"),
        ({"one": {"joints": {"joint_9": {"angle_deg": 1}}}}, "no joint 'joint_9'"),
        ({"one": {"joints": {"joint_1": {"offset": 1}}}}, "joint_1 is revolute: give `angle_deg`"),
        ({"one": {"position": [0, 0, 1]}}, "a planar base stays in its plane"),
        ({"one": {"position": [1, 0, 0]}}, "costs.base_rotation counts from where bases begin"),
    ],
)
def test_bad_starts_are_refused_in_one_line(reach, room, message):
    with pytest.raises(ScenarioError) as fault:
        make_plan(reach(("plan.start", room)), backend="interpreted")
    assert message in str(fault.value)
