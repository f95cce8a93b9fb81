"""Terms of the cost against Pinocchio and optima in closed form."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy.sparse import triu

from optim.planning.formulation.costs import headings
from optim.planning.formulation.formulate import formulate
from optim.planning.formulation.instant_view import InstantView
from optim.planning.search.make_plan import make_plan
from optim.planning.studies.cost_sensitivities import cost_sensitivities
from optim.planning.transcription.collocation_program import CollocationProgram
from optim.planning.transcription.instant_functions import build_instants
from optim.planning.transcription.lobatto import Lobatto
from spacerobot.quantities import planned
from spacerobot.scenario.plan_cost import PlanCost
from spacerobot.scene import load_scene
from tests.optim.planning.test_independent_checks import LINK, TWO_LINKS, scene, to
from tests.oracles.least_impulse import least_impulse, least_impulse_and_time

IN_SPACE = TWO_LINKS.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0.6 0.8"/>', 1)
BODY = f'<robot name="body">{LINK.format("body", 2, 0, 0.1)}</robot>'
COSTS = {"base_reaction": 1}
BASE = ("plan.limits.base_force", 3)
DRIVEN = {"base_force": 9, "base_torque": 9}
POSTURE = to(shoulder={"angle_deg": 40}, elbow={"angle_deg": -70})


@pytest.mark.parametrize("base", ["free_flyer", "planar", "fixed"])
def test_arms_put_on_their_base_what_pinocchio_says(tmp_path, base):
    """Its recursion gives the wrench that the first joint hands on, at any motion; gravity counts."""
    plan = {"duration": 2, "goals": POSTURE, "costs": COSTS, "limits": DRIVEN}
    floating, planar = base != "fixed", base == "planar"
    made = scene(tmp_path, TWO_LINKS if planar else IN_SPACE, base, plan)
    model = made.model
    model.gravity.linear = np.array([1.0, -2.0, 0.0 if planar else 3.0])
    stage = formulate(made).stage
    draw = np.random.default_rng(3)
    q = pin.integrate(model, np.array(made.q), draw.uniform(-1, 1, model.nv))
    v, a = draw.uniform(-1, 1, (2, model.nv))
    data = model.createData()
    efforts = pin.rnea(model, data, q, v, a)
    pin.forwardKinematics(model, data, q)
    arm = 2 if floating else 1
    on_base = data.oMi[arm].act(data.f[arm])
    origin = data.oMi[1].translation if floating else np.zeros(3)
    wanted = np.r_[on_base.linear, on_base.angular - np.cross(origin, on_base.linear)]
    z = np.r_[q, v, a, efforts[list(stage.driven.columns)]]
    wrench = ca.vertcat(*InstantView(stage, "").base_reactions()["one"])
    found = ca.Function("found", [stage.z], [ca.densify(wrench)])(z)
    rows, sign = ([0, 1, 5] if planar else range(6)), -1 if floating else 1
    np.testing.assert_allclose(found.full().ravel(), sign * wanted[list(rows)], atol=1e-10)


def body_alone(tmp_path, base, plan, **sections):
    """A body of its own weight on a floating base, whose tip comes to a place and rests there."""
    (tmp_path / "body.urdf").write_text(BODY)
    robot = {"urdf": "body.urdf", "base": {"joint": base}, "tips": {"tip": {"frame": "body"}}} | sections
    file = tmp_path / "body.yaml"
    goals = {"come": {"tip": "one/tip", "position": plan.pop("to")}, "rest": {"still": "one"}}
    file.write_text(yaml.safe_dump({"robots": {"one": robot}, "plan": {"goals": goals} | plan}))
    return load_scene(file)


def test_least_impulse_is_a_push_a_drift_and_a_push(tmp_path):
    """F t (T - t) = m d says how long each push lasts; linear programming finds the same."""
    plan = {"to": [1, 0, 0], "duration": 4, "costs": {"propellant": 1}, "limits": {"base_force": 3}}
    found = make_plan(body_alone(tmp_path, "planar", plan), backend="interpreted")
    push = (4 - np.sqrt(4**2 - 4 * 2 * 1 / 3)) / 2
    assert least_impulse(2, 1, 3, 4) == pytest.approx(2 * 3 * push, rel=1e-3)
    assert found.terms["propellant"] == pytest.approx(2 * 3 * push, rel=1e-3)
    known, costs = planned(), {name: PlanCost(kind=name, weight=1) for name in planned()}
    words = headings(costs | {"wrist": costs["torque"]})
    assert (known["propellant"].reduced(3.0, 2.0), words["propellant"]) == (3.0, "impulse on bases")
    assert (known["torque"].reduced(8.0, 2.0), words["wrist"]) == (2.0, "wrist: RMS joint torque")


THRUSTERS = {
    "kind": "thrusters",
    "thrust": 1.0,
    "nozzles": {
        f"{axis}{sign}": {"position": place, "direction": [-x / 0.2 for x in place]}
        for axis, k in (("x", 0), ("y", 1))
        for sign in (1, -1)
        for place in [[0.2 * sign * (i == k) for i in range(3)]]
    },
}
"""Four nozzles in a plane, in line with the centre of mass."""


@pytest.mark.parametrize(
    ("base", "to", "limit", "robot"),
    [
        ("planar", [0.4, -0.7, 0], 1.0, {"actuators": {"thrusters": THRUSTERS}}),
        ("free_flyer", [0.5, 0.3, -0.2], 0.8, {}),
    ],
)
def test_plans_spend_no_more_propellant_than_linear_programming(tmp_path, base, to, limit, robot):
    """Each axis along which a force acts is on its own, since nothing turns the body."""
    limits = {} if robot else {"base_force": limit}
    plan = {"to": to, "duration": 6, "costs": {"propellant": 1}, "limits": limits}
    found = make_plan(body_alone(tmp_path, base, plan, **robot), backend="interpreted")
    least = sum(least_impulse(2, abs(way), limit, 6) for way in to if way)
    assert 0.9999 * least < found.terms["propellant"] < 1.01 * least


def test_propellant_and_time_are_traded_as_by_linear_programming(tmp_path):
    costs, limits = {"propellant": 1, "time": 0.2}, {"base_force": 3}
    plan = {"to": [1, 0, 0], "duration": {"lower": 1, "upper": 12}, "costs": costs, "limits": limits}
    found = make_plan(body_alone(tmp_path, "planar", plan), backend="interpreted")
    least, duration = least_impulse_and_time(2, 1, 3, 0.2, 12)
    assert 0.9999 * least < found.cost < 1.01 * least
    assert found.phased_motion.duration_s == pytest.approx(duration, rel=0.02)
    mass, step = "robots.one.links.body.mass", 1e-3
    heavier, lighter = (least_impulse_and_time(2 + s * step, 1, 3, 0.2, 12)[0] for s in (1, -1))
    assert cost_sensitivities(found, [mass])[mass] == pytest.approx(
        (heavier - lighter) / (2 * step), rel=0.02
    )


def test_what_the_end_costs_has_its_derivatives(reach):
    """First and second ones of the program against differences, along one direction."""
    costs = {"impact_speed": 3, "propellant": 1, "base_reaction": 1}
    problem = formulate(reach(("plan.costs", costs), ("plan.goals.mate.speed_within", 0.1), BASE))
    program = CollocationProgram(problem, build_instants(problem, "interpreted"), Lobatto.of_order(4), 2)
    draw = np.random.default_rng(0)
    w, along = draw.uniform(0.1, 1, program.size), draw.uniform(-1, 1, program.size)
    multipliers = draw.uniform(-1, 1, program.rows)
    jacobian, hessian = program.jacobian_pattern.copy(), program.hessian_pattern.copy()

    def slope(w):
        """Gradient of the Lagrangian, with a factor of 0.7 on the cost."""
        jacobian.data = program.jacobian(w)
        return 0.7 * program.gradient(w) + jacobian.T @ multipliers

    def difference(function):
        """Along the direction."""
        return (function(w + 1e-6 * along) - function(w - 1e-6 * along)) / 2e-6

    assert program.gradient(w) @ along == pytest.approx(difference(program.objective), rel=1e-6)
    hessian.data = program.hessian(w, 0.7, multipliers)
    whole = hessian + triu(hessian, 1).T
    np.testing.assert_allclose(whole @ along, difference(slope), rtol=1e-5, atol=1e-5)
