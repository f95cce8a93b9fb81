"""Tune three gains of the paper's first robot with exact gradients, and simulate the result."""

from pathlib import Path

import casadi as ca

import spacerobot as sr
import viz
from spacerobot import rollout

TIP = "robots.rpr1.tips.tip"


def main(folder: Path = Path("out/examples/tune"), duration_s: float = 2.0, method: str = "nlp") -> None:
    """Minimise tip errors and torque; ``method`` may also be ga, de, pso, cmaes, manual or nlp_ga."""
    changes = {"simulation.duration": duration_s, "robots.*.tips.*.reference.duration": duration_s}
    scene = sr.load_scene("paper", changes)
    problem = sr.build_problem(
        scene,
        variables={
            "kd": (f"{TIP}.pid.kd", 100, 400),
            "ge": (f"{TIP}.amnesia.ge", 100, 2000),
            "ta": (f"{TIP}.amnesia.ta", 1, 30),
        },
        objective=lambda s: rollout.integral(
            1e6 * ca.sumsqr(s["tip_error"]) + 1e-3 * ca.sumsqr(s["joint_torque"])
        ),
    )
    # one start, at the scenario's gains; a seeded search chooses further starts
    tuned = sr.tune(problem, method, effort=sr.Effort(starts=1), progress=sr.print_progress)
    gains = ", ".join(f"{name} {value:.4g}" for name, value in tuned.gains.items())
    print(f"{tuned.status}: objective {tuned.objective:.4g} with {gains}")
    before, after = sr.simulate(scene), sr.simulate(tuned.scene)
    for name, result in {"before": before, "after": after}.items():
        error = result.summary["tip_error"]["rpr1/tip"]["norm"]
        print(
            f"{name}: peak error of rpr1/tip {1e3 * error['max_m']:.3f} mm, rms {1e3 * error['rms_m']:.3f} mm"
        )
    viz.save_figures(after, folder / "figures", before, formats=("png",), names=["tip_errors"])
    viz.write_recording(after, folder / "film.gif", frames_per_s=5, speed=0.5, size_px=(480, 300))
    print(f"files in {folder}:", ", ".join(sorted(path.name for path in folder.iterdir())))


if __name__ == "__main__":
    main()
