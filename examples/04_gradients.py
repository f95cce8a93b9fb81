"""Many rollouts at once, and the exact gradient of a measure with respect to any numbers of the scenario."""

import casadi as ca

import spacerobot as sr
from spacerobot import rollout

GAINS = ["robots.rpr1.tips.tip.pid.kd", "robots.rpr1.tips.tip.amnesia.ta", "target.links.body.mass"]


def main(duration_s: float = 2.0, backend: rollout.Backend = "auto") -> None:
    """The squared tip errors' integral, its gradient, and differences of rollouts to check it by."""
    loop = sr.build_closed_loop(sr.load_scene("paper"))
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

    # one batch holds both sides of every difference; rows are sets of values
    nominal = [loop.parameters()[loop.index(path)] for path in GAINS]
    rows = [
        [value * (1 + side * 1e-4 * (i == j)) for j, value in enumerate(nominal)]
        for i in range(len(GAINS))
        for side in (1, -1)
    ]
    cost = run.batch(GAINS, rows).costs["squared"]
    for i, path in enumerate(GAINS):
        difference = (cost[2 * i] - cost[2 * i + 1]) / (2e-4 * nominal[i])
        print(f"{path}: exact {exact[i]:+.6e}, by differences {difference:+.6e}")


if __name__ == "__main__":
    main()
