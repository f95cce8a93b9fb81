"""Tune three gains of the paper's first robot with exact gradients, and simulate the result."""

import casadi as ca

import spacerobot as sr
from spacerobot import rollout

TIP = "robots.rpr1.tips.tip"


def main(duration_s: float = 2.0, method: str = "nlp") -> None:
    """Small tip errors at little torque; ``method`` may be ga, de, pso, cmaes, manual or nlp_ga as well."""
    changes = {"simulation.duration": duration_s, "robots.*.tips.*.reference.duration": duration_s}
    problem = sr.build_problem(
        sr.load_scene("paper", changes),
        variables={
            "kd": (f"{TIP}.pid.kd", 100, 400),
            "ge": (f"{TIP}.amnesia.ge", 100, 2000),
            "ta": (f"{TIP}.amnesia.ta", 1, 30),
        },
        objective=lambda s: rollout.integral(
            1e6 * ca.sumsqr(s["tip_error"]) + 1e-3 * ca.sumsqr(s["joint_torque"])
        ),
    )
    # one start: the scenario's own gains; more starts are found by a seeded search
    found = sr.tune(problem, method, effort=sr.Effort(starts=1))
    print(found.status, found.objective, dict(found.gains))
    print(sr.simulate(found.scene).summary["tip_error"]["rpr1/tip"])


if __name__ == "__main__":
    main()
