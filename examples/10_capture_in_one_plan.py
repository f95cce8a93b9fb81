"""Two arms of a servicer capture a satellite one after the other: three phases in one trajectory."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import spacerobot as sr
import viz

LEFT = {"tip": "servicer/left_tip", "frame": "mate_left"}
RIGHT = {"tip": "servicer/right_tip", "frame": "mate_right"}
CONE = {"half_angle_deg": 25, "final_fraction": 0.2}
PHASES = {  # each grasp closes at the end of its phase
    "reach": {"duration": 8, "goals": {"left": LEFT}, "approach_cones": {"left": {**LEFT, **CONE}}},
    "stop": {"duration": {"lower": 1, "upper": 10, "guess": 2}, "intervals": 2},
    "second": {
        "duration": {"lower": 3, "upper": 12, "guess": 6},
        "goals": {"right": RIGHT},
        "approach_cones": {"right": {**RIGHT, **CONE}},
    },
}
CHANGES = {  # goals and cones move from the plan of one arm to the phases
    "plan.duration": None,
    "plan.goals": {},
    "plan.approach_cones": {},
    "plan.costs": {"torque": 1e-3, "joint_acceleration": 1, "base_rotation": 10, "time": 0.01},
    "plan.intervals": 6,
    "plan.phases": PHASES,
}


def main(scenario: str | Path = "capture", changes: Mapping[str, Any] = CHANGES) -> None:
    """Plan and simulate; print when and at which speed each grasp closes."""
    folder = Path("out/examples/one_plan")
    plan = sr.plan(sr.load_scene(scenario, changes), folder, progress=sr.print_progress)
    for phase in plan.summary["phases"]:
        print(f"{phase['name']:8} {phase['duration_s']:7.3f} s")
    result = sr.simulate(plan.scene(), progress=sr.print_progress)
    for event in result.summary["events"]:
        if event["kind"] == "captured":
            speed = 1e3 * sum(v**2 for v in event["relative_velocity_m_s"]) ** 0.5
            print(f"{event['who']:8} captured at {event['time_s']:.3f} s, at {speed:.1e} mm/s")
    viz.save_figures(result, folder / "figures", formats=("png",), names=["storyboard"])
    viz.write_recording(result, folder / "film.gif", frames_per_s=5, speed=3, size_px=(480, 300))
    print(f"files in {folder}:", ", ".join(sorted(path.name for path in folder.iterdir())))


if __name__ == "__main__":
    main()
