"""Sensors that hold what they measured: references follow what was seen last, by its closed form."""

import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.pinocchio_engine import simulate
from spacerobot.rollout import Measures, Signals, build_rollout, final
from tests.oracles.small_scenes import PLANAR, small_scene

PERIOD, OFFSET, SCALE, AHEAD = 0.15, 0.004, 1.02, 0.3
WAY = {
    "kind": "rendezvous",
    "frame": "mate_2",
    "approach_time": 0.4,
    "standoff": AHEAD,
    "end_distance": AHEAD,
}
SENSOR = {"kind": "sampled", "period": PERIOD, "offset": OFFSET, "scale": SCALE}
FREE = {
    "grasps": {},
    "target.base": {"joint": "planar", "position": [1.9, 0.45, 0], "velocity": [0.05, -0.03, 0]},
    "robots.two.base": {"joint": "planar", "position": [8, 0, 0]},
    "robots.one.tips.tip.reference": WAY,
}
PHASES = {"phases": {"come": {"until": {"time": 0.37}}, "stay": {}}}


def rolled(changes, **options):
    scene = small_scene(PLANAR, FREE | {"robots.one.sensors": {"target_position": SENSOR}} | changes)
    steps = {"duration_s": 1.0, "step_s": 0.01, "output_step_s": 0.05, "backend": "interpreted"}
    return scene, build_rollout(build_closed_loop(scene), **(steps | options))


@pytest.mark.parametrize("changes", [{}, PHASES], ids=["plain", "in phases"])
def test_the_reference_stays_where_the_target_was_seen_last(changes):
    scene, rollout = rolled(changes)
    run = rollout.run()
    measured = [f.time_s for f in run.events if rollout.loop.events[f.event].kind == "measured"]
    np.testing.assert_allclose(measured, PERIOD * np.arange(1, len(measured) + 1), atol=1e-9)
    assert len(measured) >= 4
    names = [body.name for body in scene.bodies]
    target = run.outputs["body_position"].reshape(len(run.time), -1, 3)[:, names.index("target")]
    tip = run.outputs["tip_position"].reshape(len(run.time), -1, 3)[:, 0]
    wanted = run.outputs["tip_reference"].reshape(len(run.time), -1, 3)[:, 0]
    lever = wanted[0] - tip[0]  # none: it begins where the tip is, by what is seen there
    np.testing.assert_allclose(lever, 0, atol=1e-12)
    part = run.time / PERIOD
    late = (run.time > 0.4) & (np.abs(part - part.round()) > 1e-6)  # at its standoff, and not as it measures
    last = np.array([np.argmin(np.abs(run.time - PERIOD * k)) for k in np.floor(part)])
    # the mating frame's place lies at a constant distance from the target's: only its change is known here
    shown = target[last] + (SCALE - 1) * (target[last] - tip[last])
    apart = (wanted - shown)[late]
    np.testing.assert_allclose(apart, apart[:1].repeat(len(apart), axis=0), atol=1e-9)
    assert np.ptp(wanted[late, 0]) > 0.02


def test_gradients_go_through_the_instants_of_measurement():
    paths = ("robots.one.sensors.target_position.period", "robots.one.sensors.target_position.scale")
    scene, _ = rolled({})
    loop = build_closed_loop(scene)
    signals = Signals.of(loop)
    measures = Measures(signals, {"end": final(signals["tip_position"][:2])}, lambda r, p: {"x": r["end"][0]})
    _, rollout = rolled({}, measures=measures, duration_s=0.48)
    adjoint, forward = rollout.value_and_gradient(wrt=paths), rollout.jacobian(wrt=paths)
    assert adjoint.status == ("exact",)
    np.testing.assert_allclose(forward.measures["end"][0], adjoint.gradients["x"], rtol=1e-9)
    base, h = rollout.values()[rollout.indices(paths)], 1e-5
    ends = rollout.batch(paths, np.concatenate([base + h * np.eye(2), base - h * np.eye(2)])).costs["x"]
    np.testing.assert_allclose(adjoint.gradients["x"], (ends[:2] - ends[2:]) / (2 * h), rtol=1e-5)


SEEN = {
    "target_position": SENSOR,
    "target_velocity": SENSOR | {"period": 0.11},
    "target_spin": {"kind": "sampled", "period": 0.2, "offset": 0.01},
}
SINCE = {
    "phases": {
        "wait": {
            "until": {"time": 0.37},
            "robots": {"one": {"tips": {"tip": {"reference": {"kind": "hold"}}}}},
        },
        "come": {"until": {"time": 0.15}},
        "stay": {"robots": {"one": {"sensors": {"target_position": {"scale": 0.9}}}}},
    }
}


def test_the_second_engine_measures_at_the_same_instants_and_follows_the_same():
    scene, rollout = rolled({"robots.one.sensors": SEEN} | SINCE, duration_s=0.5, output_step_s=0.25)
    ours, checked = rollout.run(), simulate(scene, duration_s=0.5, output_step_s=0.25, rtol=1e-9, atol=1e-11)
    names = [rollout.loop.events[fired.event] for fired in ours.events]
    told = [(rule.name, fired.time_s) for rule, fired in zip(names, ours.events, strict=True)]
    assert [event.name for event in checked.happened] == [name for name, _ in told]
    np.testing.assert_allclose([e.time_s for e in checked.happened], [t for _, t in told], atol=1e-9)
    assert len(told) > 8
    for name, value in ours.outputs.items():
        np.testing.assert_allclose(checked.outputs[name], value, atol=1e-6, rtol=1e-6, err_msg=name)
