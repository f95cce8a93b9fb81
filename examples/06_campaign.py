"""Monte Carlo robustness analysis of two sets of gains with an uncertain object and uncertain grasps."""

from pathlib import Path

import spacerobot as sr
import viz
from viz import figures

CHANGES = {
    "campaign": {
        "parameters": {
            "object_mass": {"paths": "target.links.body.mass", "lower": 10, "upper": 40},
            "tumble": {"paths": "target.base.spin_deg.2", "lower": -2, "upper": 2},
            "grip": {"paths": "grasps.*.stiffness", "apply": "factor", "lower": 0.7, "upper": 1.3},
        },
        # two sets of gains on the same samples
        "gains": {"printed": {}, "stiff": {"robots.rpr1.tips.tip.amnesia.ge": 5000}},
        "design": "latin_hypercube",
        "metrics": ["tip_error_peak", "grip_force_peak"],
        "limits": {"tip_error": 0.002},
    }
}


def main(
    folder: Path = Path("out/examples/campaign"), samples: int = 256, changes: dict[str, float] | None = None
) -> None:
    """Print failure probabilities of both sets of gains, and simulate the worst sample."""
    scene = sr.load_scene("paper", CHANGES | {"campaign.samples": samples} | (changes or {}))
    # an interrupted campaign resumes when it is run again
    campaign = sr.campaign(scene, folder, progress=sr.print_progress)
    for name, summary in campaign.summary["gains"].items():
        failure = summary["failure"]["any"]
        interval = f"95 % interval {failure['low']:.1%} to {failure['high']:.1%}"
        print(f"{name}: probability of failure {failure['value']:.1%} ({interval})")

    # campaign.data is an xarray dataset: draw(sample, parameter), tip_error_peak(sample, gains, ...), ...
    errors = campaign.data.tip_error_peak
    worst = int(errors.sel(gains="printed").max("tip_error_peak_of").argmax("sample"))
    result = campaign.simulate(worst, "printed")
    error = result.summary["tip_error"]["rpr1/tip"]["norm"]
    print(f"worst sample {worst}: peak error of rpr1/tip {1e3 * error['max_m']:.3f} mm")
    peaks = {name: errors.sel(gains=name).max("tip_error_peak_of") for name in CHANGES["campaign"]["gains"]}
    drawing = figures.robustness(peaks, quantity="peak tip error", unit="m", limit=0.002)
    (folder / "robustness.png").write_bytes(figures.to_bytes(drawing, "png"))
    viz.write_recording(result, folder / "film.gif", frames_per_s=5, speed=2, size_px=(480, 300))
    print(f"files in {folder}:", ", ".join(sorted(path.name for path in folder.iterdir())))


if __name__ == "__main__":
    main()
