"""Tune three gains of the paper's first robot with exact gradients, and simulate the result."""

import casadi as ca

from optim import Effort, integral, tune
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate

scene = load_scene("paper", {"simulation.duration": 2, "robots.*.tips.*.reference.duration": 2})
tip = "robots.rpr1.tips.tip"
found = tune(
    scene,
    method="nlp",  # or ga, de, pso, cmaes, manual, nlp_ga
    variables={
        "kd": (f"{tip}.pid.kd", 100, 400),
        "ge": (f"{tip}.amnesia.ge", 100, 2000),
        "ta": (f"{tip}.amnesia.ta", 1, 30),
    },
    objective=lambda s: integral(1e6 * ca.sumsqr(s["tip_error"]) + 1e-3 * ca.sumsqr(s["joint_torque"])),
    effort=Effort(starts=1),  # from the scenario's own gains; more starts are found by a seeded search
)
print(found.status, found.objective, dict(found.gains))
print(simulate(found.scene).summary["tip_error"]["rpr1/tip"])
