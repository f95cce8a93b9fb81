"""Gradients through a contact: what touches earlier or harder is differentiated exactly."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.rollout import build_rollout
from spacerobot.rollout.measures import Measures, Signals, final, integral
from spacerobot.scene import build_scene, load_scene
from tests.contacts.test_collisions import tumbling

WRT = (
    *(f"contacts.bump.{key}" for key in ("stiffness", "dissipation", "friction")),
    *("pads.a.radius", "robots.one.base.velocity.0", "target.links.body.mass", "target.base.spin_deg.1"),
)


def built():
    changes = {"contacts.bump.longest_step": 2e-3, "contacts.bump.exponent": 1.5}
    loop = build_closed_loop(build_scene(tumbling(0, ("sphere", "capsule")).scenario, changes))
    signals = Signals.of(loop)
    measures = Measures(
        signals,
        {
            "pressed": integral(signals["contact_normal_force"] ** 2),
            "place": final(signals["body_position"]),
        },
        costs=lambda r, _: {"cost": r["pressed"] / 100 + ca.sumsqr(r["place"])},
    )
    return loop, build_rollout(loop, duration_s=1.0, step_s=5e-3, output_step_s=0.5, measures=measures)


def test_gradients_through_touch_and_part_are_those_of_finite_differences():
    loop, rollout = built()
    nominal = rollout.run()
    assert [loop.events[event.event].kind for event in nominal.events] == ["touched", "parted"] * 2
    found = rollout.value_and_gradient(wrt=WRT).gradients["cost"]
    forward = rollout.jacobian(wrt=WRT, outputs=["body_position"])
    for k, path in enumerate(WRT):
        value = loop.parameters()[loop.index(path)]

        def ends(change, path=path, value=value):
            runs = [rollout.run({path: value * (1 + sign * change)}) for sign in (1, -1)]
            costs, places = ([r.costs["cost"] for r in runs], [r.outputs["body_position"][-1] for r in runs])
            return [np.subtract(*pair) / (2 * value * change) for pair in (costs, places)]

        wide, narrow = ends(2e-4), ends(1e-4)
        cost, place = ((4 * a - b) / 3 for a, b in zip(narrow, wide, strict=True))
        assert abs(found[k] - cost) < 1e-6 * max(abs(cost), 1e-6), path
        scale = np.abs(place).max()
        np.testing.assert_allclose(
            forward.outputs["body_position"][-1, :, k] / scale, place / scale, atol=1e-6
        )


def test_friction_inside_too_coarse_steps_is_told_by_the_status():
    """The rollout is right to a hundredth, the derivatives of its steps are wrong by factors."""
    ball = {"target.base.position": [1.9, 0.05, 0], "target.base.velocity": [-0.5, 0, 0]}
    loop = build_closed_loop(load_scene("bounce", ball))
    signals = Signals.of(loop)
    turned = Measures(
        signals,
        {"turned": final(signals["body_rotation"])},
        costs=lambda r, _: {"turned": ca.sum1(r["turned"])},
    )
    grid = {"duration_s": 0.4, "step_s": 0.01, "output_step_s": 0.4}
    coarse = build_rollout(loop, **grid, measures=turned, backend="interpreted")
    fine = replace(coarse, grid=coarse.grid.halved.halved)
    wrt = ["contacts.bump.friction", "contacts.bump.slip_velocity", "robots.arm.tips.tip.pid.kp"]
    rough = {"contacts.bump.friction": 0.9}
    wrong, right = (rollout.value_and_gradient(rough, wrt=wrt) for rollout in (coarse, fine))
    assert wrong.costs["turned"] == pytest.approx(right.costs["turned"], rel=1e-2)
    assert abs(wrong.gradients["turned"][0]) > 6 * abs(right.gradients["turned"][0])
    assert wrong.status[0].startswith("inaccurate: step: half the step changes the derivative of 'turned' by")
    assert right.status == ("exact",)
    assert coarse.value_and_gradient(wrt=wrt).status == ("exact",)
    assert coarse.jacobian(rough, wrt=wrt).status.startswith("inaccurate: step")
    # only the derivatives that someone looks at count: the last one is not wrong
    for compared, begin in ((wrt[:1], "inaccurate: step"), (wrt[2:], "exact"), ([], "exact")):
        status = coarse.value_and_gradient(rough, wrt=wrt, compared=compared).status[0]
        assert status.startswith(begin), compared
    assert coarse.slope_batch(wrt[:2], [[0.3, 0.01], [0.9, 0.01]]).status[0] == "exact"
    assert coarse.value_and_gradient(rough, wrt=wrt, accuracy=False).status == ("unchecked",)
