"""First steps: load a shipped scenario, simulate it, read numbers, save the result, write its pages."""

from pathlib import Path

import spacerobot as sr
import viz


def main(folder: Path = Path("out/examples/first_steps"), duration_s: float = 10.0) -> None:
    """Two robots carry an object round a circle."""
    scene = sr.load_scene("paper", {"simulation.duration": duration_s})
    result = sr.simulate(scene, progress=sr.print_progress)

    # every array has names, units and world axes
    error_m = result.data.tip_error.sel(tip="rpr1/tip", axis="x")
    print(f"peak error of rpr1/tip along x: {1e3 * float(abs(error_m).max()):.3f} mm")

    # no external force acts, so momentum is conserved, and its drift is an error of the integration
    drift = result.summary["ledger"]["momentum"]["linear"]["relative_drift"]
    print(f"drift of the linear momentum: {drift:.1e} of the largest momentum of a body")

    result.save(folder / "result")  # sr.load(folder / "result") reads it again
    viz.write_animation(result, folder / "docking.html")
    viz.save_figures(result, folder / "figures", formats=("pdf", "png"), names=["tip_errors", "docking"])
    viz.write_recording(result, folder / "film.gif", frames_per_s=5, speed=2, size_px=(480, 300))
    print(f"files in {folder}:", ", ".join(sorted(path.name for path in folder.iterdir())))


if __name__ == "__main__":
    main()
