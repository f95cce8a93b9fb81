"""Plans over several phases: an approach, a capture, and what follows, as one problem."""

import casadi as ca
import numpy as np
import pytest
import yaml
from scipy.optimize import minimize, minimize_scalar

from optim.planning.formulation.formulate import formulate_phases
from optim.planning.formulation.instant_view import InstantView
from optim.planning.output.plan_folder import FOLLOWED, dataset, write
from optim.planning.search.make_plan import make_plan
from optim.planning.studies.cost_sensitivities import cost_sensitivities
from optim.planning.studies.pareto_front import FrontRequest, make_front
from spacerobot.common.errors import ScenarioError
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate

RAIL = """<robot name="rail"><link name="rail"/>
<link name="cart"><inertial><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-9" upper="9" effort="100" velocity="100"/></joint></robot>"""
BALL = """<robot name="ball"><link name="ball"><inertial><mass value="3"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="handle"/>
<joint name="fixed" type="fixed"><parent link="ball"/><child link="handle"/><origin xyz="-0.2 0 0"/></joint>
</robot>"""
CART, OBJECT, FAR, SPEED, TO, HASTE = 2.0, 3.0, 1.0, 0.1, 0.5, 0.3
GRIP = {"kind": "weld", "begins": "open", "capture": {"distance": 0.01, "dwell": 0.1}}
CATCH = {
    "robots": {"cart": {"urdf": "rail.urdf", "base": {"joint": "fixed"}, "tips": {"cart": {}}}},
    "target": {
        "urdf": "ball.urdf",
        "base": {"joint": "planar", "position": [FAR, 0, 0], "velocity": [SPEED, 0, 0]},
    },
    "grasps": {"grip": {"tip": "cart/cart", "frame": "ball", **GRIP}},
    "phases": {"catch": {"until": {"captured": ["grip"]}}, "carry": {"until": {"time": 9}}},
    "plan": {
        "costs": {"torque": 1, "time": HASTE},
        "intervals": 2,
        "phases": {
            "catch": {
                "duration": {"lower": 0.5, "upper": 20, "guess": 2},
                "goals": {"meet": {"tip": "cart/cart", "frame": "ball"}},
            },
            "carry": {
                "duration": {"lower": 0.5, "upper": 20, "guess": 2},
                "goals": {"there": {"robot": "cart", "joints": {"slide": {"offset": TO}}}},
            },
        },
    },
    "simulation": {"duration": 9, "step": 0.05, "output_step": 0.1},
}
"""A cart on a rail catches a body that flies along it, and brings it to a place."""


@pytest.fixture(scope="module")
def catch(tmp_path_factory):
    """Function of changes that gives the scene."""
    folder = tmp_path_factory.mktemp("catch")
    (folder / "rail.urdf").write_text(RAIL)
    (folder / "ball.urdf").write_text(BALL)
    (folder / "catch.yaml").write_text(yaml.safe_dump(CATCH, sort_keys=False))
    return lambda *changes: load_scene(folder / "catch.yaml", list(changes))


def effort(mass, way, before, behind, time):
    """Least integral of the squared force on a mass that moves so far, between two speeds."""
    speeds = before**2 + before * behind + behind**2
    found = 12 * way**2 / time**3 - 12 * way * (before + behind) / time**2 + 4 * speeds / time
    return mass**2 * found + HASTE * time


def parts(times, closing=0.0, far=FAR):
    """Costs of the two phases, by hand; the cart comes faster than the body by ``closing``."""
    where, both = far + SPEED * times[0], CART + OBJECT
    joined = (CART * (SPEED + closing) + OBJECT * SPEED) / both
    first = effort(CART, where, 0, SPEED + closing, times[0])
    return first, effort(both, TO - where, joined, 0, times[1])


@pytest.mark.parametrize("closing", [0.0, 0.4])
def test_a_catch_and_what_follows_cost_least_together(catch, closing):
    """Both durations by the closed form; with a closing speed through the plastic impulse of the weld."""
    goal = "plan.phases.catch.goals.meet.closing_speed"
    found = make_plan(catch((goal, closing)), backend="interpreted")
    best = minimize(
        lambda t: sum(parts(t, closing)), (2.0, 2.0), method="Nelder-Mead", options={"xatol": 1e-9}
    )
    durations = [motion.duration_s for motion in found.phased_motion.motions]
    np.testing.assert_allclose(durations, best.x, rtol=1e-4)
    assert found.cost == pytest.approx(best.fun, rel=1e-6)
    first = minimize_scalar(lambda t: parts((t, 1.0), closing)[0], bounds=(0.5, 9), method="bounded").x
    second = minimize_scalar(lambda t: parts((first, t), closing)[1], bounds=(0.5, 9), method="bounded").x
    assert found.cost < sum(parts((first, second), closing)) - 1e-3  # one after the other
    assert found.verification.replay_error_m < 1e-5
    if closing:
        impulse = CART * OBJECT / (CART + OBJECT) * closing
        assert np.abs(found.phased_motion.impulses[0]).max() == pytest.approx(impulse, rel=1e-6)
    else:
        assert np.abs(found.phased_motion.impulses[0]).max() < 1e-6


def test_slopes_of_the_cost_of_two_phases_are_those_of_the_closed_form(catch):
    """By numbers of the start, of the first goal, and of the impulse between the phases."""
    goal = "plan.phases.catch.goals.meet.closing_speed"
    found = make_plan(catch((goal, 0.4)), backend="interpreted")
    first, second = (motion.duration_s for motion in found.phased_motion.motions)

    def cost(far, speed, mass, closing):
        """At the optimal durations, by which its derivatives vanish."""
        where, both = far + speed * first, CART + mass
        joined = (CART * (speed + closing) + mass * speed) / both
        return effort(CART, where, 0, speed + closing, first) + effort(both, TO - where, joined, 0, second)

    at, step = (FAR, SPEED, OBJECT, 0.4), 1e-5
    slopes = [(cost(*(at + e)) - cost(*(at - e))) / (2 * step) for e in step * np.eye(4)]
    paths = ["target.base.position.0", "target.base.velocity.0", "target.links.ball.mass", goal]
    np.testing.assert_allclose(list(cost_sensitivities(found, paths).values()), slopes, rtol=1e-4)


@pytest.mark.parametrize("impact", [0.0, 3.0])
def test_how_fast_a_rigid_grasp_closes_is_found_too(catch, impact):
    """Where the second phase weighs more, the cart's impulse takes a part of its effort over; less where the
    speed of the impact costs something too.
    """
    goal, weight = "plan.phases.catch.goals.meet.speed_within", 4.0
    changes = [(goal, 0.2), ("plan.phases.carry.costs", {"torque": weight})]
    changes.append(("plan.costs.impact_speed", impact))
    found = make_plan(catch(*changes), backend="interpreted")
    bounds = [(0.5, 20), (0.5, 20), (-0.2, 0.2)]

    def cost(x):
        first, second = parts(x[:2], x[2])
        return first + weight * (second - HASTE * x[1]) + HASTE * x[1] + impact * x[2] ** 2

    best = minimize(cost, (2.0, 2.0, 0.0), bounds=bounds)
    assert abs(best.x[2]) > 0.02
    assert found.terms.get("impact_speed", 0.0) == pytest.approx(impact * best.x[2] ** 2, rel=1e-3)
    assert found.cost == pytest.approx(best.fun, rel=1e-5)
    impulse = CART * OBJECT / (CART + OBJECT) * best.x[2]
    assert abs(found.phased_motion.impulses[0]).max() == pytest.approx(abs(impulse), rel=1e-3)
    assert found.verification.replay_error_m < 1e-5


def test_the_mating_frame_that_costs_least_is_chosen(catch):
    paths = ["plan.phases.catch.goals.meet.frame", "grasps.grip.frame"]
    choice = ("plan.choices", {"where": {"paths": paths, "among": ["ball", "handle", "handel"]}})
    with pytest.raises(ScenarioError, match="no link 'handel'"):
        make_plan(catch(choice), backend="interpreted")
    choice[1]["where"]["among"].pop()
    found = make_plan(catch(choice), backend="interpreted")
    costs = [minimize(lambda t, far=far: sum(parts(t, far=far)), (2.0, 2.0)).fun for far in (FAR, FAR - 0.2)]
    assert [one.chosen for one in found.candidates] == [{"where": "ball"}, {"where": "handle"}]
    np.testing.assert_allclose([one.cost for one in found.candidates], costs, rtol=1e-6)
    assert found.cost == found.candidates[1].cost
    assert found.scene.scenario.grasps["grip"].frame == "handle"
    with pytest.raises(ScenarioError, match="a front takes a plan of one phase"):
        make_front(catch(choice), FrontRequest(("time", "torque"), 2), backend="interpreted")


TWO = [
    ("grasps.left", {"tip": "one/tip", "frame": "mate_1", **GRIP}),
    ("phases", {"approach": {"until": {"captured": ["left"]}}, "stop": {"until": {"time": 9}}}),
    ("plan.duration", None),
    ("plan.goals", {}),
    ("plan.costs", {"torque": 0.01, "time": 0.1, "base_wrench": 1e-4}),
    ("simulation", {"duration": 1, "step": 0.02}),
    ("plan.intervals", 6),
    ("plan.tolerance", 1e-4),
    (
        "plan.phases",
        {
            "approach": {
                "duration": {"lower": 2, "upper": 20, "guess": 6},
                "goals": {"mate": {"tip": "one/tip", "frame": "mate_1"}},
            },
            "stop": {
                "duration": {"lower": 2, "upper": 20, "guess": 6},
                "goals": {"rest": {"still": "one"}},
                "limits": {"base_force": 20, "base_torque": 20, "grip_force": 2},
            },
        },
    ),
]
"""An arm grips what drifts past, and brings it to rest."""
SOFT = {"kind": "compliant", "stiffness": 50, "damping": 10, "rotational_stiffness": 5}


@pytest.mark.parametrize("grip", [{}, SOFT], ids=["weld", "compliant"])
def test_a_plan_of_two_phases_is_flown_through_the_capture(reach, tmp_path, grip):
    changes = [*TWO, ("grasps.left", {"tip": "one/tip", "frame": "mate_1", **GRIP, **grip})]
    found = make_plan(reach(*changes), backend="interpreted")
    write(found, tmp_path)
    flown = simulate(load_scene(tmp_path / FOLLOWED), backend="interpreted")
    first, second = (motion.duration_s for motion in found.phased_motion.motions)
    told = [(event["kind"], event["who"]) for event in flown.summary["events"]]
    assert told[:2] == [("captured", "left"), ("phase", "stop")]
    times = [event["time_s"] for event in flown.summary["events"]]
    np.testing.assert_allclose(times[:2], [first, first], atol=1e-6)
    assert flown.data.time.values[-1] == pytest.approx(first + second, abs=1e-6)
    plan, rows = dataset(found), 2 * (6 * 3 + 1)
    assert plan.sizes["time"] == rows
    assert list(plan.phase.values) == ["approach"] * (rows // 2) + ["stop"] * (rows // 2)
    assert np.abs(plan.base_wrench.sel(time=slice(0, first - 0.01))).max() == 0
    assert np.abs(plan.grip_wrench).max() > 0.01
    np.testing.assert_allclose(flown.data.q.values[-1], plan.q.values[-1], atol=1e-4)
    np.testing.assert_allclose(flown.data.v.values[-1], plan.v.values[-1], atol=1e-4)
    assert np.abs(flown.data.v.values[-1][:3]).max() < 1e-4


WAIT, LAST = {"duration": 1, "goals": {"rest": {"still": "one"}}}, {"until": {"time": 1}, "next": "stop"}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([("plan.phases.stopp", {})], "plan.phases.stopp.duration: missing"),
        ([("phases", {})], "plan.phases.approach: no phase 'approach'; the scenario has no `phases`"),
        ([("plan.goals", {"a": {"still": "one"}})], "plan.goals.a: of which phase?"),
        ([("plan.phases.approach.goals", {})], "must bring 'one/tip' to 'mate_1'"),
        ([("plan.phases.stop.goals", {})], "plan.phases.stop.goals: missing"),
        ([("plan.phases.stop.order", 4)], "plan.phases.stop.order: is the same in all phases"),
        ([("plan.phases.approach.goals.mate.frame", "mate_2")], "must bring 'one/tip' to 'mate_1'"),
        ([("plan.phases.approach.goals.mate.tip", "one/top")], "plan.phases.approach.goals.mate.tip: no tip"),
        ([("plan.phases.stop.limits", {})], "plan.phases.stop.goals.rest: one cannot come to rest"),
        ([("plan.phases.wait", WAIT), ("phases.wait", LAST)], None),
        ([("phases.wait", LAST), ("phases.approach.next", "wait")], "found where 'wait' is in turn"),
    ],
)
def test_what_phases_cannot_be_is_refused(reach, changes, message):
    if message is None:
        assert list(reach(*TWO, *changes).scenario.plan.by_phase) == ["approach", "stop", "wait"]
        return
    with pytest.raises(ScenarioError) as fault:
        make_plan(reach(*TWO, *changes), backend="interpreted")
    assert message in str(fault.value)
    assert fault.value.exit_code == 2


def test_a_grasp_takes_part_of_the_reaction_on_a_base(catch):
    """What the arm takes to move, less what the object does to its tip, about the base's origin."""
    stage = formulate_phases(catch())[1].problem.stage
    z = np.random.default_rng(1).uniform(-1, 1, stage.z.numel())
    force, torque = (
        ca.Function("f", [stage.z], [part])(z).full().ravel() for part in stage.wrench(stage.grips[0])
    )
    at = stage.scene.model.idx_vs[stage.scene.robots[0].joints[0]]
    wrench = ca.vertcat(*InstantView(stage, "").base_reactions()["cart"])
    found = ca.Function("f", [stage.z], [ca.densify(wrench)])(z).full().ravel()
    along = CART * z[stage.q.numel() + stage.v.numel() + at] - force[0]
    place = z[stage.scene.model.idx_qs[stage.scene.robots[0].joints[0]]]
    np.testing.assert_allclose(found, [along, -force[1], -torque[0] - place * force[1]], atol=1e-12)
