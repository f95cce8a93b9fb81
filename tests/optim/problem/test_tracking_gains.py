"""The gains with which a planned motion is followed are tuned as any others."""

from __future__ import annotations

import numpy as np
import pytest

from optim import Effort, EvolutionSettings, build_problem, tune
from spacerobot.description.planar import PlanarBase, PlanarLink, planar_arm_urdf
from spacerobot.scene import load_scene
from tests.oracles.plans import plan_of, write_plan

TEXT = """
robots:
  arm:
    urdf: arm.urdf
    base: {joint: planar}
    joints: {joint_1: {angle_deg: 40}}
    tips: {tip: {reference: {kind: plan, file: plan.nc}}}
    controllers: {follow: {kind: joint_tracking, file: plan.nc, kp: 20, kd: 2}}
simulation: {duration: 1, output_step: 0.1, step: 0.05}
tuning:
  changes: {robots.arm.links.link_1.mass: 8}      # other than the plan believes
  variables:
    kp: {paths: robots.arm.controllers.follow.kp, lower: 1, upper: 100, scale: log}
    feed_forward: {paths: robots.arm.controllers.follow.feed_forward, lower: 0.5, upper: 2}
  objective: {kind: ise, effort: 1e-6}
"""


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    place = tmp_path_factory.mktemp("gains")
    link = PlanarLink(length_m=0.5, mass_kg=5.0, inertia_kg_m2=(0.1, 0.1))
    base = PlanarBase(mass_kg=30.0, inertia_kg_m2=4.0, radius_m=0.3)
    (place / "arm.urdf").write_text(planar_arm_urdf(links=1, link=link, base=base, damping=0.3))
    before = TEXT[: TEXT.index("    tips")] + "    tips: {tip: {}}\n"
    (place / "before.yaml").write_text(before)
    plan = plan_of(load_scene(place / "before.yaml"), {"arm/joint_1": 0.8}, 1.0, 6)
    write_plan(plan, place / "plan.nc")
    (place / "follow.yaml").write_text(TEXT)
    return build_problem(load_scene(place / "follow.yaml"))


def test_derivatives_by_the_gains_are_exact(problem):
    u, h = np.array([0.6, 0.4]), 1e-5
    gradient = problem.linearise(u).gradient
    for i in range(2):
        shift = h * np.eye(2)[i]
        rise = problem.evaluate(u + shift).objective - problem.evaluate(u - shift).objective
        assert gradient[i] == pytest.approx(rise / (2 * h), rel=1e-4)


def test_gradients_find_what_evolution_looks_for(problem):
    nlp = tune(problem, "nlp", effort=Effort(starts=1))
    ga = tune(problem, "ga", effort=Effort(runs=1, protocol=EvolutionSettings(budget=80, population=20)))
    assert nlp.objective <= ga.objective
    assert nlp.objective < 0.2 * problem.evaluate(problem.variables.unit(problem.variables.start)).objective
    assert nlp.gains["feed_forward"] > 1.1  # more mass than planned for
