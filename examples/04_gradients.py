"""Batch of rollouts, and the exact gradient of a cost with respect to numbers of the scenario."""

from pathlib import Path

import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

import spacerobot as sr
import viz
from spacerobot import rollout

GAINS = ["robots.rpr1.tips.tip.pid.kd", "robots.rpr1.tips.tip.amnesia.ta", "target.links.body.mass"]


def main(
    folder: Path = Path("out/examples/gradients"), duration_s: float = 2.0, backend: rollout.Backend = "auto"
) -> None:
    """The squared tip errors' integral, its gradient, and differences of rollouts to check it by."""
    print("building and compiling the rollout")
    scene = sr.load_scene("paper", {"simulation.duration": duration_s})
    loop = sr.build_closed_loop(scene)
    signals = rollout.Signals.of(loop)
    measures = rollout.Measures(
        signals,
        {
            "squared": rollout.integral(1e6 * ca.sumsqr(signals["tip_error"])),
            "torque": rollout.peak(ca.fabs(signals["joint_torque"])),
        },
        costs=lambda results, _: {"squared": results["squared"]},
    )
    run = sr.build_rollout(loop, duration_s=duration_s, step_s=0.004, measures=measures, backend=backend)

    exact = run.value_and_gradient(wrt=GAINS).gradients["squared"]

    # one batch evaluates both sides of every central difference; each row is a set of values
    nominal = [loop.parameters()[loop.index(path)] for path in GAINS]
    rows = [
        [value * (1 + side * 1e-4 * (i == j)) for j, value in enumerate(nominal)]
        for i in range(len(GAINS))
        for side in (1, -1)
    ]
    cost = run.batch(GAINS, rows).costs["squared"]
    for i, path in enumerate(GAINS):
        difference = (cost[2 * i] - cost[2 * i + 1]) / (2e-4 * nominal[i])
        print(f"derivative of the cost by {path}: exact {exact[i]:+.6e}, by differences {difference:+.6e}")

    # exact slopes as tangents to the cost, which one batch evaluates at 21 values of each number
    factors = np.linspace(0.5, 1.5, 21)
    sets = np.repeat([nominal], len(GAINS) * len(factors), axis=0)
    for i in range(len(GAINS)):
        sets[i * len(factors) : (i + 1) * len(factors), i] *= factors
    curves = run.batch(GAINS, sets).costs["squared"].reshape(len(GAINS), len(factors))
    figure, panels = plt.subplots(1, len(GAINS), figsize=(9, 3), layout="constrained", sharey=True)
    for panel, path, value, curve, slope in zip(panels, GAINS, nominal, curves, exact, strict=True):
        near = factors[7:14]
        panel.plot(factors * value, curve, label="cost")
        panel.plot(near * value, curve[10] + slope * (near - 1) * value, "--", label="exact slope")
        panel.set(xlabel=path)
    panels[0].set_ylabel("squared tip error [mm² s]")
    panels[0].legend()
    folder.mkdir(parents=True, exist_ok=True)
    figure.savefig(folder / "gradients.png")
    result = sr.simulate(scene, backend=backend)
    viz.write_recording(result, folder / "film.gif", frames_per_s=5, speed=0.5, size_px=(480, 300))
    print(f"files in {folder}:", ", ".join(sorted(path.name for path in folder.iterdir())))


if __name__ == "__main__":
    main()
