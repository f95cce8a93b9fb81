"""Where is it captured? The paper's gains and tuned ones over tumble rate, lateral offset and sensor bias."""

from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.stats import binomtest

import spacerobot as sr
import viz

DURATION_S = 20.0  # until shortly after both grips close
CHANGES = {  # the scenario's own campaign, with an object that turns faster
    "simulation.duration": DURATION_S,
    "campaign.parameters.tumble.lower": -30,
    "campaign.parameters.tumble.upper": 30,
    "campaign.parameters.lateral.lower": -0.3,
    "campaign.parameters.lateral.upper": 0.3,
    "campaign.metrics": ["capture_time", "miss_distance", "joint_torque_peak"],
    "campaign.limits": {},
    "campaign.step": 0.01,
}
EDGES_DEG = np.array([0, 6, 12, 18, 24, 30])  # of the tumble rate, per second
MOST_DRIFT = 0.01  # of the total momentum; beyond it steps were too long, and the capture is not believed
MOST_NM = 100.0  # captures that ask for more torque are told apart


def main(folder: Path = Path("out/examples/capture"), samples: int = 512) -> None:
    """P(capture) by tumble rate for each set of gains: a table, and a figure with its intervals."""
    scene = sr.load_scene("docking", CHANGES | {"campaign.samples": samples})
    done = sr.campaign(scene, folder, progress=print)
    data = done.data  # run again after a kill, it goes on where it was
    rate = abs(data.draw.sel(parameter="tumble").values)
    figure, axes = plt.subplots(figsize=(6, 3.5), layout="constrained")
    print(f"tumble [deg/s]  gains      P(capture), 95 % interval    and at most {MOST_NM:g} N m")
    for shift, gains in enumerate(map(str, data.gains.values)):
        own = data.sel(gains=gains)
        captured = (own.captured.values > 0).all(axis=1)  # NaN where a rollout diverged
        captured &= (own.momentum_drift.values < MOST_DRIFT).all(axis=1)
        within = captured & (own.joint_torque_peak.max("joint_torque_peak_of").values <= MOST_NM)
        told = []
        for low, high in pairwise(EDGES_DEG):
            these = (rate >= low) & (rate < high)
            p = binomtest(int(captured[these].sum()), int(these.sum()))
            ends = p.proportion_ci(0.95)
            told.append((p.statistic, *ends))
            interval = f"{p.statistic:.1%} ({ends.low:.1%} to {ends.high:.1%})"
            print(f"{low:2} to {high:2}        {gains:9}  {interval}", end="")
            print(f"      {within[these].mean():.1%}")
        value, lower, upper = np.array(told).T
        middle = (EDGES_DEG[:-1] + EDGES_DEG[1:]) / 2 + 0.3 * shift  # so that intervals stand side by side
        axes.errorbar(middle, value, [value - lower, upper - value], fmt="o-", capsize=3, label=gains)
    axes.set(xlabel="tumble rate [deg/s]", ylabel="P(capture)", ylim=(0, 1.05))
    axes.legend()
    figure.savefig(folder / "capture.png")
    fastest = int(np.where((data.captured.sel(gains="tuned") > 0).all("captured_of"), rate, 0).argmax())
    viz.write_recording(
        done.simulate(fastest, "tuned"), folder / "film.gif", frames_per_s=5, speed=4, size_px=(480, 300)
    )


if __name__ == "__main__":
    main()
