"""Your own robot: a URDF, a scenario that uses it, and the assumptions that were made."""

from pathlib import Path

import spacerobot as sr
import viz

SCENARIO = """
name: mine
robots:
  mine:
    urdf: my_arm.urdf                             # relative to this file
    base: {joint: planar}                         # a floating base in the plane; free_flyer in space
    joints: {joint_1: {angle_deg: 40}, joint_2: {angle_deg: -70}, joint_3: {angle_deg: 60}}
    tips:
      tip:
        pid: {kp: 150, ki: 60, kd: 40, feedback: inertial}
        reference: {kind: line, displacement: [-0.1, 0.05, 0], duration: 3}
target:
  urdf: rectangle.urdf                            # ships with spacerobot
  base: {joint: planar, close_grasp: hold}        # placed so that the grasp closes
grasps:
  hold: {tip: mine/tip, frame: mate_1, kind: weld}
simulation: {duration: 4}
"""


def main(folder: Path = Path("out/examples/own_robot"), duration_s: float = 4.0) -> None:
    """An arm of three links moves an object that it holds rigidly."""
    folder.mkdir(parents=True, exist_ok=True)
    # any URDF will do; this one is written from numbers, as `spacerobot make-arm arm` does
    link, base = sr.PlanarLink(mass_kg=5.0), sr.PlanarBase(mass_kg=100.0, inertia_kg_m2=10.0)
    sr.make_arm(folder / "my_arm.urdf", 3, link, base)
    (folder / "mine.yaml").write_text(SCENARIO, encoding="utf-8")

    scene = sr.load_scene(folder / "mine.yaml", {"simulation.duration": duration_s})
    for assumption in scene.assumptions:  # for everything that neither file specifies
        print("-", assumption)

    result = sr.simulate(scene, progress=sr.print_progress)
    error = result.summary["tip_error"]["mine/tip"]["norm"]
    print(f"{result.summary['status']['state']}: peak tip error {1e3 * error['max_m']:.3f} mm", end=", ")
    print(f"{1e3 * error['final_m']:.3f} mm at the end")
    viz.save_figures(result, folder / "figures", formats=("png",), names=["docking", "joints"])
    viz.write_recording(result, folder / "film.gif", frames_per_s=5, speed=1, size_px=(480, 300))
    print(f"files in {folder}:", ", ".join(sorted(path.name for path in folder.iterdir())))


if __name__ == "__main__":
    main()
