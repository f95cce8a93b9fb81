"""Change numbers by their paths and compare results: the same motion with heavier objects."""

from pathlib import Path

import spacerobot as sr
import viz


def main(folder: Path = Path("out/examples/compare"), duration_s: float = 10.0) -> None:
    """The paper's robots carry 20, 60 and 180 kg."""
    results = []
    for mass_kg in (20, 60, 180):
        changes = {"target.links.body.mass": mass_kg, "simulation.duration": duration_s}
        result = sr.simulate(sr.load_scene("paper", changes), progress=sr.print_progress)
        error_m = float(abs(result.data.tip_error).max())
        torque = float(abs(result.data.joint_torque).max())
        print(f"{mass_kg:4d} kg: peak tip error {1e3 * error_m:6.3f} mm, peak joint torque {torque:6.2f} N m")
        results.append(result)

    # figures, pages and reports accept several results and overlay them
    first, *others = results
    viz.save_figures(first, folder / "figures", *others, formats=("pdf", "png"), names=["tip_errors"])
    viz.write_animation(first, folder / "compared.html", *others)
    viz.write_recording(results[-1], folder / "film.gif", frames_per_s=5, speed=2, size_px=(480, 300))
    print(f"files in {folder}:", ", ".join(sorted(path.name for path in folder.iterdir())))


if __name__ == "__main__":
    main()
