"""A campaign: whether gains hold over what is not known of the object and the grips."""

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
    """Failures of two sets of gains, what matters, and the worst sample as a result of its own."""
    scene = sr.load_scene("paper", CHANGES | {"campaign.samples": samples} | (changes or {}))
    found = sr.campaign(scene, folder, progress=print)  # run again after a kill, it goes on where it was
    for name, told in found.summary["gains"].items():
        failed = told["failure"]["any"]
        print(f"{name}: fails with {failed['value']:.1%} ({failed['low']:.1%} to {failed['high']:.1%})")

    # found.data is xarray: draw(sample, parameter), tip_error_peak(sample, gains, ...), ...
    worst = int(found.data.tip_error_peak.sel(gains="printed").max("tip_error_peak_of").argmax("sample"))
    result = found.simulate(worst, "printed")
    print(f"worst sample {worst}:", result.summary["tip_error"]["rpr1/tip"]["norm"])
    peaks = {
        name: found.data.tip_error_peak.sel(gains=name).max("tip_error_peak_of")
        for name in CHANGES["campaign"]["gains"]
    }
    drawn = figures.robustness(peaks, quantity="largest tip error", unit="m", limit=0.002)
    (folder / "robustness.png").write_bytes(figures.to_bytes(drawn, "png"))
    viz.write_recording(result, folder / "film.gif", frames_per_s=5, speed=2, size_px=(480, 300))


if __name__ == "__main__":
    main()
