"""Your own robot: a URDF, a scenario beside it, and what spacerobot understood of them."""

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
    for sentence in scene.assumptions:  # what neither file says, and what was taken instead
        print("-", sentence)

    result = sr.simulate(scene, progress=print)
    print(result.summary["status"]["state"], result.summary["tip_error"]["mine/tip"]["norm"])
    viz.save_figures(result, folder / "figures", formats=("png",), names=["docking", "joints"])
    viz.write_recording(result, folder / "film.gif", frames_per_s=5, speed=1, size_px=(480, 300))


if __name__ == "__main__":
    main()
