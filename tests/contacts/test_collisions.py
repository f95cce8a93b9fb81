"""Collisions against closed forms: restitution, exchange of velocities, sliding to rest, balances."""

from __future__ import annotations

import functools

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import lambertw

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.elements.contacts.hunt_crossley import speed_ratio
from spacerobot.pinocchio_engine import simulate
from spacerobot.rollout import build_rollout
from spacerobot.scene import build_scene
from tests.oracles.balls import body, meeting, scene
from tests.oracles.hybrid import roll


def restitution_of(x):
    """Coefficient of restitution of two free bodies, of the dissipation times their speed of approach.

    ``-(1 - e x) exp(e x - 1) = -(1 + x) exp(-(1 + x))``, solved by Lambert's W.
    """
    above = 1 + x
    return float((1 + lambertw(-above * np.exp(-above)).real) / x)


def rolled(found, duration, step, output_step=None):
    steps = {"duration_s": duration, "step_s": step, "output_step_s": output_step or duration}
    return build_rollout(build_closed_loop(found), **steps, backend="interpreted").run()


def velocities(found, trajectory):
    """Velocities (2, 3) of the two bodies' origins at the end, by their momenta."""
    momenta = trajectory.outputs["body_momentum_linear"][-1].reshape(-1, 3)
    masses = [sum(link.mass for link in b.config.links.values()) for b in found.bodies]
    return momenta / np.array(masses)[:, None]


def restitution_by_quadrature(x):
    """Speeds of approach and parting pass the same indentation: integrals of v / (1 + a v) dv."""
    work = quad(lambda v: v / (1 + v), 0, x)[0]
    return brentq(lambda e: quad(lambda v: v / (1 - v), 0, e * x)[0] - work, 1e-9, min(1, 0.999 / x))


@pytest.mark.parametrize("e", [0.01, 0.05, 0.3, 0.5, 0.8, 0.95, 0.999])
def test_the_dissipation_of_a_restitution_is_that_of_its_closed_form(e):
    symbol = ca.SX.sym("e")
    x = float(ca.Function("x", [symbol], [speed_ratio(symbol)])(e))
    assert restitution_of(x) == pytest.approx(e, abs=1e-9)
    if 0.1 < e < 0.99:
        assert restitution_by_quadrature(x) == pytest.approx(e, abs=1e-9)


@pytest.mark.parametrize(("exponent", "stiffness"), [(1.0, 4e3), (1.5, 5e4), (2.0, 5e5)])
@pytest.mark.parametrize("speed", [0.1, 0.4, 1.0])
def test_balls_part_with_the_restitution_that_follows_from_their_speed(exponent, stiffness, speed):
    law = {"stiffness": stiffness, "exponent": exponent, "restitution": 0.6, "restitution_speed": 0.4}
    found = meeting(law | {"longest_step": 5e-4}, speed)
    first, second = velocities(found, rolled(found, 0.005 / speed + 0.15, 0.01))
    ratio = 0.974871710813265 / 0.4  # closed form at 0.6
    wanted = restitution_of(ratio * speed)
    assert (second - first)[0] / speed == pytest.approx(wanted, abs=2e-6)
    assert np.abs(first[1:]).max() == np.abs(second[1:]).max() == 0


def test_touch_and_part_are_events_at_their_times():
    found = meeting({"stiffness": 2e4, "restitution": 0.6, "restitution_speed": 0.4, "longest_step": 1e-3})
    loop = build_closed_loop(found)
    run = roll(loop, 0.12)
    assert run.names == ["bump.touched", "bump.parted"]
    assert run.events[0].time == pytest.approx(0.005 / 0.4, abs=1e-9)
    for event in run.events:
        assert abs(run.outputs(event.time, event.after, event.c_after)["contact_gap"][0]) < 1e-10
    assert loop.fine == ((0, 1e-3, 8),)
    first, second = run.outputs()["body_momentum_linear"].reshape(2, 3)[:, 0] / (2.0, 3.0)
    assert second - first == pytest.approx(0.6 * 0.4, abs=1e-7)


def test_what_is_drawn_apart_is_not_pulled():
    law = {"stiffness": 2e4, "exponent": 1.0, "dissipation": 4.0, "may_overlap": True}
    plain = meeting(law, speed=-0.5)  # faster than 1 / a
    run = roll(build_closed_loop(build_scene(plain.scenario, {"target.base.position": [0.19, 0, 0]})), 0.1)
    assert run.names == ["bump.touched", "bump.loosened", "bump.parted"]
    assert run.events[-1].time == pytest.approx(0.01 / 0.5, abs=1e-9)
    assert run.outputs()["body_momentum_linear"][0] == pytest.approx(2.0 * -0.5, abs=1e-12)
    # what the spring held is booked as taken
    assert run.outputs()["work_contact"][0] == pytest.approx(2e4 * 0.01**2 / 2, rel=1e-8)


def test_equal_masses_exchange_their_velocities():
    found = meeting({"stiffness": 2e4}, masses=(2.0, 2.0))
    first, second = velocities(found, rolled(found, 0.2, 5e-4))
    np.testing.assert_allclose(first, 0, atol=1e-7)
    np.testing.assert_allclose(second, [0.4, 0, 0], atol=1e-7)


def test_without_friction_equal_balls_that_meet_aslant_part_at_a_right_angle():
    found = meeting(
        {"stiffness": 2e4}, masses=(2.0, 2.0), target=body("other", 2.0, {"position": [0.18, 0.12, 0]})
    )
    first, second = velocities(found, rolled(found, 0.3, 5e-4))
    assert first @ second == pytest.approx(0, abs=1e-8)
    assert np.linalg.norm(second) > 0.1


MU, SPEED, SLIP = 0.3, 0.5, 0.01


def sliding():
    """A block of 4 kg on two round feet slides over a half-space; its feet touch at its centre's height."""
    depth = 4.0 * 9.81 / 2 / 1e5  # where both feet carry the weight
    feet = {
        f"foot_{i}": {
            "link": "target/body",
            "kind": "sphere",
            "radius": 0.05,
            "position": [x, 0.05 - depth, 0],
        }
        for i, x in enumerate((-0.2, 0.2))
    }
    floor = {"link": "ground/body", "kind": "plane", "rotation_deg": [-90, 0, 0]}
    law = {"stiffness": 1e5, "exponent": 1.0, "dissipation": 5.0, "friction": MU, "slip_velocity": SLIP}
    return scene(
        {
            "gravity": [0, -9.81, 0],
            "robots": {"ground": body("ground", 1.0, {"joint": "fixed"})},
            "target": body("block", 4.0, {"joint": "planar", "velocity": [SPEED, 0, 0]}),
            "pads": feet | {"floor": floor},
            "contacts": {name: {"between": ["floor", name], "may_overlap": True} | law for name in feet},
        }
    )


def test_a_block_slides_to_rest_at_mu_n():
    found = sliding()
    assert found.planar
    trajectory = rolled(found, 0.4, 5e-4, 0.05)
    momentum = trajectory.outputs["body_momentum_linear"][:, 3] / 4.0
    way = trajectory.outputs["body_position"][:, 3]
    force = trajectory.outputs["contact_force"].reshape(-1, 2, 3).sum(axis=1)
    np.testing.assert_allclose(force[:, 1], 4 * 9.81, rtol=1e-6)
    normal = trajectory.outputs["contact_normal_force"].sum(axis=1)
    np.testing.assert_allclose(normal, 4 * 9.81, rtol=1e-6)
    np.testing.assert_allclose(force[:, 0], -MU * 4 * 9.81 * momentum / np.hypot(momentum, SLIP), atol=1e-5)
    assert force[0, 0] == pytest.approx(-MU * 4 * 9.81, rel=1e-3)
    # regularised: dv/dt = -mu g v / sqrt(v^2 + s^2), so the way is the integral of sqrt(v^2 + s^2) / mu g
    for v, x in zip(momentum, way, strict=True):
        wanted = quad(lambda u: np.hypot(u, SLIP), v, SPEED)[0] / (MU * 9.81)
        assert x - way[0] == pytest.approx(wanted, abs=1e-6)
    assert momentum[-1] < 1e-4
    assert way[-1] - way[0] == pytest.approx(SPEED**2 / (2 * MU * 9.81), rel=5e-3)


SHAPES = {
    "sphere": {"radius": 0.2},
    "capsule": {"radius": 0.1, "length": 0.3},
    "box": {"size": [0.3, 0.25, 0.35]},
    "cylinder": {"radius": 0.15, "length": 0.3},
}


def tumbling(seed, given=None):
    """Two bodies with pads of random shapes, or given ones, that tumble into each other."""
    rng = np.random.default_rng(seed)
    kinds = [str(rng.choice(["sphere", "capsule"])), str(rng.choice(["sphere", "capsule", "box"]))]
    if kinds[0] == "sphere" and seed % 2:
        kinds[1] = "cylinder"
    kinds = given or kinds
    links = ("one/body", "target/body")
    pads = {
        name: {
            "link": link,
            "kind": kind,
            "position": list(0.03 * rng.normal(size=3)),
            "rotation_deg": list(90 * rng.normal(size=3)),
        }
        | SHAPES[kind]
        for name, link, kind in zip("ab", links, kinds, strict=True)
    }
    law = {"stiffness": 2e4, "exponent": 2.0, "dissipation": 1.0, "friction": 0.4, "slip_velocity": 0.05}
    spin = [list(30 * rng.normal(size=3)) for _ in range(2)]
    return scene(
        {
            "robots": {"one": body("one", 2.0, {"velocity": [0.6, 0.05, 0], "spin_deg": spin[0]})},
            "target": body("other", 3.0, {"position": [0.55, 0.03, 0.05], "spin_deg": spin[1]}),
            "pads": pads,
            "contacts": {"bump": {"between": ["a", "b"]} | law},
        }
    )


TUMBLING = [*((i, None, 1.2, 1e-3) for i in (0, 1, 2, 4)), (0, ("cylinder", "cylinder"), 0.7, 4e-4)]
"""Seed, shapes, duration [s] and step [s]: they touch and part; in the last the way out becomes another."""


@pytest.mark.parametrize(("seed", "kinds", "duration", "step"), TUMBLING)
def test_momentum_and_energy_are_kept_through_a_collision_of_tumbling_bodies(seed, kinds, duration, step):
    found = tumbling(seed, kinds)
    trajectory = rolled(found, duration, step, 0.05)
    loop, outputs = build_closed_loop(found), trajectory.outputs
    happened = [loop.events[event.event].kind for event in trajectory.events]
    assert happened[:2] == ["touched", "parted"]
    assert ("flipped" in happened) == bool(kinds)
    assert outputs["contact_gap"][0] > 0
    assert outputs["contact_gap"].min() < 0
    assert not loop.outside
    for kind in ("linear", "angular"):
        total, parts = outputs[f"momentum_{kind}"], outputs[f"body_momentum_{kind}"]
        assert np.abs(total - total[0]).max() < 1e-12 * np.abs(parts).max()
    stored = outputs["energy_kinetic"] + outputs["energy_spring"] + outputs["energy_potential"]
    booked = sum(sign * outputs[f"work_{name}"] for name, sign in loop.works.items())
    assert outputs["work_contact"][-1] > 0
    assert np.abs(stored - stored[0] - booked).max() < 1e-6 * stored.max()


def seen(found, duration, output_step):
    """Trajectory of the second engine, within some 1e-7."""
    return simulate(found, duration_s=duration, output_step_s=output_step, rtol=1e-7, atol=1e-9)


def test_the_second_engine_sees_the_same_collision():
    found = tumbling(0)
    ours, checked = rolled(found, 0.6, 1e-3, 0.2), seen(found, 0.6, 0.2)
    assert [event.kind for event in checked.happened] == ["touched", "parted"]
    assert np.abs(ours.state - checked.state).max() < 1e-6
    assert list(ours.outputs) == list(checked.outputs)


FLAT = {
    "boxes, skew": (["box", "box"], [0, 0, 30], 0.36),
    "lying cylinders": (["cylinder", "cylinder"], [0, 90, 0], 0.302),
}


@pytest.mark.parametrize("case", FLAT)
def test_flat_on_flat_is_the_same_hit_in_both_engines(case):
    (one, other), turn, apart = FLAT[case]
    pads = {
        "a": {"link": "one/body", "kind": one, "rotation_deg": turn} | SHAPES[one],
        "b": {"link": "target/body", "kind": other, "rotation_deg": [0, turn[1], 0]} | SHAPES[other],
    }
    law = {"stiffness": 2e4, "dissipation": 1.0, "friction": 0.3, "slip_velocity": 0.02}
    found = scene(
        {
            "robots": {"one": body("one", 2.0, {"velocity": [0, 0, 0.4]})},
            "target": body("other", 3.0, {"position": [0.1, 0.05, apart]}),
            "pads": pads,
            "contacts": {"bump": {"between": ["a", "b"]} | law},
        }
    )
    ours, checked = rolled(found, 0.12, 1e-3, 0.04), seen(found, 0.12, 0.04)
    assert [event.kind for event in checked.happened] == ["touched", "parted"]
    assert np.abs(ours.state - checked.state).max() < 1e-6


REFUSED = {
    "overlap": ({"target.base.position": [0.15, 0, 0]}, "overlap by 0.05 m at the start"),
    "no pad": ({"contacts.bump.between": ["one/body", "ball"]}, "no pad nor body/link 'ball'"),
    "no link": ({"contacts.bump.between": ["one/bodi", "target/body"]}, "no link 'bodi'.*body"),
    "itself": ({"contacts.bump.between": ["one/body", "one/body"]}, "fixed to each other"),
    "both": (
        {
            "contacts.bump": {
                "between": ["one/body", "target/body"],
                "stiffness": 1,
                "restitution": 0.5,
                "restitution_speed": 1,
                "dissipation": 0,
            }
        },
        "either `dissipation` or",
    ),
    "half": ({"contacts.bump.restitution": 0.5}, "belong together"),
    "planes": (
        {
            "pads": {
                "a": {"link": "one/body", "kind": "plane"},
                "b": {"link": "target/body", "kind": "plane"},
            },
            "contacts.bump.between": ["a", "b"],
        },
        "a and b are two half-spaces, which have no distance; put another shape",
    ),
    "no radius": ({"pads": {"a": {"link": "one/body", "kind": "sphere"}}}, "pads.a.radius: missing"),
    "a length": (
        {"pads": {"a": {"link": "one/body", "kind": "sphere", "radius": 1, "length": 1}}},
        r"unknown key .length.; allowed: .*radius.*kind: sphere",
    ),
    "edges": (
        {"pads": {"a": {"link": "one/body", "kind": "box", "size": [1, 0, 1]}}},
        "allowed: numbers above 0",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_is_refused_in_one_line(case):
    changes, told = REFUSED[case]
    plain = meeting({"stiffness": 1e4})
    with pytest.raises(ScenarioError, match=told) as fault:
        build_scene(plain.scenario, changes)
    assert "\n" not in str(fault.value)


def test_a_pad_that_nothing_names_is_told():
    pad = {"link": "one/body", "kind": "sphere", "radius": 0.1}
    found = meeting({"stiffness": 1e4}, pads={"spare": pad})
    assert "pads.spare: without effect, no contact names it" in found.warnings


def test_shapes_that_just_touch_begin_within_their_domes_and_that_is_told():
    blocks = {
        name: {"link": link, "kind": "box", "size": [0.2, 0.3, 0.3]}
        for name, link in (("a", "one/body"), ("b", "target/body"))
    }
    law = {"stiffness": 1e4, "between": ["a", "b"]}
    near = meeting(law, pads=blocks).scenario
    (told,) = build_scene(near, {"target.base.position": [0.2, 0, 0]}).warnings
    assert "contacts.bump: a and b begin 0.0006 m inside the domes" in told
    for apart, crown in ((0.2007, 1e-3), (0.20007, 1e-4)):
        changes = {"target.base.position": [apart, 0, 0], "contacts.bump.crown": crown}
        assert build_scene(near, changes).warnings == ()


def test_an_overlap_that_is_asked_for_is_taken():
    plain = meeting({"stiffness": 1e4, "may_overlap": True})
    assert build_scene(plain.scenario, {"target.base.position": [0.15, 0, 0]}).contacts


@functools.cache
def touching(exponent):
    stiffness = 2e3 if exponent == 1 else 2e4
    changes = {
        "contacts.bump.exponent": exponent,
        "contacts.bump.stiffness": stiffness,
        "contacts.bump.longest_step": 8e-3,
    }
    return build_closed_loop(build_scene(tumbling(0).scenario, changes))


@functools.cache
def end(exponent, step, method):
    steps = {"duration_s": 1.0, "step_s": step, "output_step_s": 1.0}
    return build_rollout(touching(exponent), **steps, method=method, backend="interpreted").run()


@pytest.mark.parametrize(
    ("exponent", "method", "order"), [(1.0, "tanaka6", 6), (1.5, "rk4", 4), (1.5, "tanaka6", 6)]
)
def test_the_methods_order_holds_through_a_contact(exponent, method, order):
    loop = touching(exponent)
    found = end(exponent, 4e-4, "tanaka6")
    assert [loop.events[event.event].kind for event in found.events] == ["touched", "parted"]
    steps = np.array([4e-3, 2e-3, 1e-3]) * (1 if exponent == 1 else 2)  # then down to rounding
    errors = [np.abs(end(exponent, step, method).state[-1] - found.state[-1]).max() for step in steps]
    slope = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert order - 0.6 < slope < order + 1
