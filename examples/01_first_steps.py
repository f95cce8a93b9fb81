"""First steps: load a scenario that ships, simulate it, read numbers, keep the result, make its pages."""

from pathlib import Path

import spacerobot as sr
import viz


def main(folder: Path = Path("out/examples/first_steps"), duration_s: float = 10.0) -> None:
    """Two robots carry an object round a circle."""
    scene = sr.load_scene("paper", {"simulation.duration": duration_s})
    result = sr.simulate(scene, progress=print)  # the first time it is compiled, which takes seconds

    # every array has names, units and world axes
    error_m = result.data.tip_error.sel(tip="rpr1/tip", axis="x")
    print(f"largest error of rpr1/tip along x: {1e3 * float(abs(error_m).max()):.3f} mm")

    # nothing acts from outside, so momentum is conserved; what changes is the integration's error
    drift = result.summary["ledger"]["momentum"]["linear"]["relative_drift"]
    print(f"linear momentum changed by {drift:.1e} of the largest body's own")

    result.save(folder / "result")  # and back: sr.load(folder / "result")
    viz.write_animation(result, folder / "docking.html")
    viz.save_figures(result, folder / "figures", formats=("pdf", "png"), names=["tip_errors", "docking"])
    viz.write_recording(result, folder / "film.gif", frames_per_s=5, speed=2, size_px=(480, 300))
    print(f"open {folder / 'docking.html'}")


if __name__ == "__main__":
    main()
