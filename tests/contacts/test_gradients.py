"""Gradients through a contact: what touches earlier or harder is differentiated exactly."""

from __future__ import annotations

import casadi as ca
import numpy as np

from spacerobot.closedloop import build_closed_loop
from spacerobot.rollout import build_rollout
from spacerobot.rollout.measures import Measures, Signals, final, integral
from spacerobot.scene import build_scene
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
