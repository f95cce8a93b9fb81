"""A changed mass scales the inertia, unless that is given: in the scene, in setup(p), in gradients alike."""

from __future__ import annotations

import numpy as np
import pytest

from spacerobot.closedloop import build_closed_loop
from spacerobot.common.errors import ScenarioError
from spacerobot.pinocchio_engine import PinocchioLoop
from spacerobot.rollout import build_rollout
from spacerobot.scenario.document import parse_yaml
from spacerobot.scenario.load import to_yaml, validate
from spacerobot.scene import build_scene, load_scene
from tests.oracles.small_scenes import PLANAR, SPATIAL, random_x, small_scene

LINK = {"planar": "robots.one.links.link_2", "spatial": "robots.one.links.b"}
TEXTS = {"planar": PLANAR, "spatial": SPATIAL}
OWN = [0.5, 0.4, 0.3, 0.01, 0.0, 0.0]


def link_of(scene, path):
    _, robot, _, name = path.split(".")
    return scene.scenario.robots[robot].links[name]


def rate(loop, scene, changes=None):
    c = loop.setup(loop.parameters(changes or {}))[1]
    x = random_x(scene, np.random.default_rng(4), loop.nx)
    return loop.dynamics(0.3, x, c).full().ravel()


@pytest.mark.parametrize("kind", TEXTS)
def test_inertia_follows_the_mass_in_both_engines_and_in_setup(kind):
    text, path = TEXTS[kind], LINK[kind]
    plain, heavy = small_scene(text), small_scene(text, {f"{path}.mass": 9.0})
    before, after = link_of(plain, path), link_of(heavy, path)
    np.testing.assert_allclose(after.inertia, np.array(before.inertia) * 9 / before.mass, rtol=1e-15)
    loop, own = build_closed_loop(plain), build_closed_loop(heavy)
    x = random_x(plain, np.random.default_rng(4), loop.nx)
    expected = PinocchioLoop(heavy).derivative(0.3, x)
    for found in (rate(loop, plain, {f"{path}.mass": 9.0}), rate(own, heavy)):
        np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    assert np.abs(rate(loop, plain) - expected).max() > 1e-3


@pytest.mark.parametrize("kind", TEXTS)
@pytest.mark.parametrize("order", [1, -1])
def test_an_inertia_that_is_set_stands(kind, order):
    text, path = TEXTS[kind], LINK[kind]
    changes = [(f"{path}.mass", 9.0), (f"{path}.inertia", OWN)][::order]
    scene = small_scene(text, changes)
    assert list(link_of(scene, path).inertia) == OWN
    again = small_scene(text, [*changes, (f"{path}.mass", 12.0)])
    assert list(link_of(again, path).inertia) == OWN
    one = small_scene(text, [(f"{path}.inertia.2", 0.7), (f"{path}.mass", 9.0)][::order])
    before = link_of(small_scene(text), path).inertia
    assert link_of(one, path).inertia == (*before[:2], 0.7, *before[3:])
    loop = build_closed_loop(scene)
    expected = rate(build_closed_loop(again), again)
    np.testing.assert_allclose(rate(loop, scene, {f"{path}.mass": 12.0}), expected, atol=1e-12)


def test_an_inertia_in_the_file_stands():
    given = "    links: {link_2: {mass: 9, inertia: [1, 2, 3, 0, 0, 0]}}\n    tips:\n"
    told = PLANAR.replace("    tips:\n", given)
    scene = small_scene(told, {"robots.one.links.link_2.mass": 11})
    assert link_of(scene, LINK["planar"]).inertia == (1, 2, 3, 0, 0, 0)
    alone = PLANAR.replace("    tips:\n", "    links: {'link_*': {mass: 8}}\n    tips:\n", 1)
    found, before = (link_of(small_scene(text), LINK["planar"]) for text in (alone, PLANAR))
    np.testing.assert_allclose(found.inertia, np.array(before.inertia) * 8 / before.mass, rtol=1e-15)


def test_patterns_scale_each_link_by_its_own_mass():
    plain, heavy = small_scene(SPATIAL), small_scene(SPATIAL, {"robots.*.links.*.mass": 6.0})
    for name in ("one", "two"):
        for link, found in heavy.scenario.robots[name].links.items():
            before = plain.scenario.robots[name].links[link]
            np.testing.assert_allclose(found.inertia, np.array(before.inertia) * 6 / before.mass, rtol=1e-15)
    set_all = small_scene(SPATIAL, {"robots.*.links.*.inertia": OWN, "robots.*.links.*.mass": 6.0})
    assert all(list(link.inertia) == OWN for link in set_all.scenario.robots["one"].links.values())


def test_a_scenario_that_was_written_scales_like_the_one_it_came_from():
    path = LINK["spatial"]
    first = small_scene(SPATIAL, {f"{path}.mass": 9.0})
    again = build_scene(validate(parse_yaml(to_yaml(first.scenario))), {f"{path}.mass": 4.0})
    expected = link_of(small_scene(SPATIAL, {f"{path}.mass": 4.0}), path)
    np.testing.assert_allclose(link_of(again, path).inertia, expected.inertia, rtol=1e-14)


@pytest.mark.parametrize("kind", TEXTS)
def test_gradients_go_through_the_inertia(kind):
    text, path = TEXTS[kind], f"{LINK[kind]}.mass"
    scene = small_scene(text)
    rollout = build_rollout(build_closed_loop(scene), duration_s=0.4, step_s=0.01, backend="interpreted")
    slope = rollout.jacobian(wrt=[path], outputs=["tip_position"]).outputs["tip_position"][..., 0]
    mass = link_of(scene, LINK[kind]).mass
    ends = []
    for sign in (1, -1):  # scenes of their own, so that this is the slope of `--set`
        own = build_closed_loop(small_scene(text, {path: mass + sign * 1e-4}))
        ends.append(build_rollout(own, duration_s=0.4, step_s=0.01, backend="interpreted").run())
    difference = (ends[0].outputs["tip_position"] - ends[1].outputs["tip_position"]) / 2e-4
    assert np.abs(difference).max() > 1e-6
    np.testing.assert_allclose(slope, difference, atol=1e-6 * max(1e-2, np.abs(difference).max()))


def test_mass_and_inertia_that_are_both_varied_are_each_what_they_say():
    path = LINK["spatial"]
    vary = [f"{path}.mass", f"{path}.inertia.2"]
    values = {vary[0]: 4.0, vary[1]: 0.25}
    plain, own = small_scene(SPATIAL), small_scene(SPATIAL, values)
    found = rate(build_closed_loop(plain, vary=vary), plain, values)
    expected = rate(build_closed_loop(own), own)
    np.testing.assert_allclose(found, expected, atol=1e-12 * np.abs(expected).max())


def test_an_assumption_says_so_once_for_each_body():
    told = "target: inertia scaled with the mass, which is not the URDF's"
    assert not any(told in a for a in load_scene("paper").assumptions)
    changed = load_scene("paper", {"target.links.body.mass": 40})
    assert [a for a in changed.assumptions if a.startswith(told)] == [
        f"{told} (give `inertia` if it shall not be): body"
    ]
    given = {"target.links.body.mass": 40, "target.links.body.inertia.2": 5}
    assert not any(told in a for a in load_scene("paper", given).assumptions)


def test_the_shipped_scenarios_keep_the_inertias_of_their_urdfs():
    for name in ("paper", "servicer"):
        scene = load_scene(name)
        for body in scene.bodies:
            for link in body.description.links:
                if link.name in body.config.links:
                    i = link.inertia
                    own = (i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2])
                    assert body.config.links[link.name].inertia == own


def test_a_mass_for_no_inertia_is_refused():
    with pytest.raises(ScenarioError, match="inertia_at_mass: found 0, allowed: above 0"):
        small_scene(SPATIAL, {f"{LINK['spatial']}.inertia_at_mass": 0})
