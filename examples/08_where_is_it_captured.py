"""Probability of capture over tumble rate, lateral offset and sensor bias, for three sets of gains."""

from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.stats import binomtest

import spacerobot as sr
import viz

DURATION_S = 20.0  # until shortly after both grips close
CHANGES = {  # the campaign of the scenario, with an object that tumbles faster
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
MAX_DRIFT = 0.01  # of the total momentum; with a larger drift a sample counts as not captured
MAX_TORQUE_NM = 100.0  # captures with more joint torque are counted separately


def main(folder: Path = Path("out/examples/capture"), samples: int = 512) -> None:
    """Print P(capture) by tumble rate for each set of gains, and draw it with its intervals."""
    scene = sr.load_scene("docking", CHANGES | {"campaign.samples": samples})
    # an interrupted campaign resumes when it is run again
    campaign = sr.campaign(scene, folder, progress=sr.print_progress)
    data = campaign.data
    rate = abs(data.draw.sel(parameter="tumble").values)
    figure, axes = plt.subplots(figsize=(6, 3.5), layout="constrained")
    print(f"tumble [deg/s]  gains      P(capture), 95 % interval    with at most {MAX_TORQUE_NM:g} N m")
    for shift, gains in enumerate(map(str, data.gains.values)):
        samples_of_gains = data.sel(gains=gains)
        captured = (samples_of_gains.captured.values > 0).all(axis=1)  # NaN where a rollout diverged
        captured &= (samples_of_gains.momentum_drift.values < MAX_DRIFT).all(axis=1)
        within = captured & (
            samples_of_gains.joint_torque_peak.max("joint_torque_peak_of").values <= MAX_TORQUE_NM
        )
        estimates = []
        for low, high in pairwise(EDGES_DEG):
            in_bin = (rate >= low) & (rate < high)
            p = binomtest(int(captured[in_bin].sum()), int(in_bin.sum()))
            ends = p.proportion_ci(0.95)
            estimates.append((p.statistic, *ends))
            interval = f"{p.statistic:.1%} ({ends.low:.1%} to {ends.high:.1%})"
            print(f"{low:2} to {high:2}        {gains:9}  {interval}", end="")
            print(f"      {within[in_bin].mean():.1%}")
        value, lower, upper = np.array(estimates).T
        middle = (EDGES_DEG[:-1] + EDGES_DEG[1:]) / 2 + 0.3 * shift  # side by side
        axes.errorbar(middle, value, [value - lower, upper - value], fmt="o-", capsize=3, label=gains)
    axes.set(xlabel="tumble rate [deg/s]", ylabel="P(capture)", ylim=(0, 1.05))
    axes.legend()
    figure.savefig(folder / "capture.png")
    fastest = int(np.where((data.captured.sel(gains="tuned") > 0).all("captured_of"), rate, 0).argmax())
    viz.write_recording(
        campaign.simulate(fastest, "tuned"), folder / "film.gif", frames_per_s=5, speed=4, size_px=(480, 300)
    )
    print(f"files in {folder}:", ", ".join(sorted(path.name for path in folder.iterdir())))


if __name__ == "__main__":
    main()
