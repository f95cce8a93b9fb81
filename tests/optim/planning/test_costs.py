"""Terms of the cost against Pinocchio and optima in closed form."""

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from optim.planning.formulation.costs import base_reactions
from optim.planning.formulation.formulate import formulate
from tests.optim.planning.test_hand_checked import TWO_LINKS, scene, to

IN_SPACE = TWO_LINKS.replace('<axis xyz="0 0 1"/>', '<axis xyz="0 0.6 0.8"/>', 1)
COSTS = {"base_reaction": 1}
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
    found = ca.Function("found", [stage.z], [ca.densify(base_reactions(stage)["one"])])(z)
    rows, sign = ([0, 1, 5] if planar else range(6)), -1 if floating else 1
    np.testing.assert_allclose(np.ravel(found), sign * wanted[list(rows)], atol=1e-10)
