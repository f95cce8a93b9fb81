"""A plan flown in the first phase of a scenario, and what comes behind it."""

import dataclasses

import numpy as np
import pytest

from optim.planning.output.following_scenario import following_scenario, handover_warnings
from optim.planning.output.plan_folder import FOLLOWED, write
from optim.planning.search.make_plan import make_plan
from spacerobot.scenario.phases import ways
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate

PID = {"kp": 30, "ki": 10, "kd": 10, "feedback": "inertial"}
GRIP = {
    "tip": "one/tip",
    "frame": "mate_1",
    "kind": "compliant",
    "stiffness": 50,
    "damping": 10,
    "begins": "open",
    "capture": {"distance": 0.02, "closing_speed": 0.01, "dwell": 0.1},
}
GRIPPING = (
    ("robots.one.tips.tip", {"pid": PID, "amnesia": {"ge": 5, "ta": 3}}),
    ("robots.one.controllers.still", {"kind": "joint_pd", "kp": 0, "kd": 1}),
    ("grasps.left", GRIP),
)
UNTIL = {"captured": ["left"]}
APPROACH = {"until": UNTIL, "timeout": 7, "on_timeout": "end"}
HOLD = {"until": {"time": 0.5}, "target": {"reference": {"kind": "hold"}}}


@pytest.fixture(scope="module")
def planned(reach):
    changes = [("plan.intervals", 8), ("plan.order", 4), ("plan.tolerance", 1e-3)]
    return make_plan(reach(*changes), backend="interpreted")


@pytest.fixture(scope="module")
def phased(planned, reach):
    """Function of phases that gives the plan as one of a scenario that has them."""
    return lambda phases, changes=GRIPPING: dataclasses.replace(
        planned, scene=reach(*changes, ("plan.tolerance", 1e-3), ("phases", phases))
    )


def test_the_object_is_captured_at_the_plans_end_and_the_scenario_goes_on(phased, tmp_path):
    write(phased({"approach": APPROACH, "hold": HOLD}), tmp_path / "out")
    flown = simulate(load_scene(tmp_path / "out" / FOLLOWED), backend="interpreted")
    assert flown.summary["outcome"] == "captured"
    told = [(event["kind"], event["who"], round(event["time_s"], 6)) for event in flown.summary["events"]]
    assert told == [
        ("phase", "approach_wait", 6.0),
        ("entered", "left", 6.0),
        ("captured", "left", 6.1),
        ("phase", "hold", 6.1),
        ("end", "hold", 6.6),
    ]
    error = np.abs(flown.data.tip_error.sel(time=6.1, method="nearest"))
    assert error.max() < 1e-3  # the tip went on with its mating frame, which came by 2 mm and 0.2 deg


@pytest.mark.parametrize(
    ("own", "first", "rest"),
    [
        ({}, "after 6 s -> approach_wait", "to the end of the simulation"),
        (
            APPROACH,
            "after 6 s -> approach_wait",
            "when left is captured -> hold; after 1 s at the latest -> end",
        ),
        ({"until": {"time": 8}}, "after 6 s -> approach_wait", "after 2 s -> hold"),
        ({"until": {"time": 5}, "timeout": 9, "on_timeout": "end"}, "after 6 s -> hold", None),
        (APPROACH | {"timeout": 5}, "when left is captured -> hold; after 6 s at the latest -> end", None),
    ],
    ids=["endless", "captured", "longer", "shorter", "late"],
)
def test_the_first_phase_is_parted_where_the_plan_ends(phased, own, first, rest):
    scenario = following_scenario(phased({"approach": own} | ({"hold": HOLD} if own else {})))
    assert ways("approach", scenario.phases) == first
    assert ("approach_wait" in scenario.phases) == (rest is not None)
    if rest is not None:
        assert ways("approach_wait", scenario.phases) == rest


def test_where_the_plan_has_ended_the_scenarios_own_controllers_act(phased):
    scenario = following_scenario(phased({"approach": APPROACH, "hold": HOLD}))
    flown, after = (scenario.during(name).robots["one"] for name in ("approach", "approach_wait"))
    assert (flown.tips["tip"].pid, flown.tips["tip"].amnesia) == (None, None)
    assert list(flown.controllers) == ["plan"]
    assert list(after.controllers) == ["still"]
    assert after.tips["tip"].pid.kp == 30
    lead = after.tips["tip"].reference
    assert (lead.kind, lead.frame, lead.standoff, lead.end_distance) == ("rendezvous", "mate_1", 0, 0)


def test_a_plan_made_before_is_not_followed_beside_the_new_one(phased):
    """Neither while the new plan is followed nor after its end; phases that changed it no longer do."""
    joints = ["joint_1", "joint_2", "joint_3"]
    rest = {"position": [[0.7, 0.7, -0.7]] * 2, "rate": [[0.0] * 3] * 2}
    before = {"kind": "joint_tracking", "knots": {"times": [0.0, 6.0], "joints": joints, **rest}}
    phases = {"approach": APPROACH, "hold": HOLD | {"robots": {"one": {"controllers": {"before": None}}}}}
    scenario = following_scenario(phased(phases, (*GRIPPING, ("robots.one.controllers.before", before))))
    for name in scenario.phases:
        assert "before" not in scenario.during(name).robots["one"].controllers


def test_a_handover_in_full_motion_is_said(phased, tmp_path):
    """In the terminal, which prints these, and on top of the file."""
    told = handover_warnings(phased({"approach": APPROACH, "hold": HOLD}))
    assert [words.partition(":")[0] for words in told] == ["goal 'mate' is not `settled`"]
    settled = phased({"approach": APPROACH, "hold": HOLD}, (*GRIPPING, ("plan.goals.mate.settled", True)))
    assert handover_warnings(settled) == []
    write(phased({"approach": APPROACH, "hold": HOLD}), tmp_path)
    assert (tmp_path / "followed.yaml").read_text().startswith("# goal 'mate' is not `settled`: contr")


def test_an_approach_of_the_scenarios_own_goes_on_from_the_standoff(phased):
    own = {
        "kind": "rendezvous",
        "frame": "mate_1",
        "standoff": 0.3,
        "closing_speed": 0.02,
        "approach_time": 5,
    }
    come = {**APPROACH, "robots": {"one": {"tips": {"tip": {"reference": own}}}}}
    far = phased({"approach": come, "hold": HOLD}, (*GRIPPING, ("plan.goals.mate.standoff", 0.1)))
    lead = following_scenario(far).during("approach_wait").robots["one"].tips["tip"].reference
    assert (lead.standoff, lead.end_distance, lead.closing_speed) == (0.1, 0, 0.02)
    near = phased({"approach": come, "hold": HOLD})
    lead = following_scenario(near).during("approach_wait").robots["one"].tips["tip"].reference
    assert (lead.standoff, lead.end_distance, lead.closing_speed) == (0, 0, None)


def test_open_grasps_without_phases_close_behind_the_plan(phased):
    assert list(following_scenario(phased({})).phases) == ["approach", "approach_wait"]
    assert not following_scenario(phased({}, ())).phases
