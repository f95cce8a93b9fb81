"""A servicing mission from three URDFs: draft, simulation, planned approach and Monte Carlo analysis."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

import spacerobot as sr
import viz
from viz import figures

HERE = Path(__file__).parent
REQUEST = sr.DraftRequest(
    robots=(),
    bus=str(HERE / "servicer_bus.urdf"),
    mounts=[f"arm={HERE / 'service_arm.urdf'}@0.7,0,0"],  # on the front of the bus
    target=str(HERE / "client.urdf"),
    include=("wheels", "filters"),  # attitude control; a camera, a star tracker and a gyro with errors
)
JOINTS = "robots.servicer_bus.joints"
FOLDED = {  # the draft begins close to the client; the mission begins with a folded arm
    f"{JOINTS}.arm_upper.angle_deg": -75,
    f"{JOINTS}.arm_lower.angle_deg": 135,
    f"{JOINTS}.arm_wrist_pitch.angle_deg": -60,
}


def main(
    folder: Path = Path("out/examples/mission"),
    verify: bool = True,
    samples: int = 32,
    planned: bool = True,
    changes: Mapping[str, Any] = FOLDED,
) -> None:
    """Draft, simulate, plan, run a campaign, and draw each; the first run takes some minutes."""
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "mission.yaml"
    file.unlink(missing_ok=True)
    console = Console(stderr=True)
    # the draft is simulated, linearised and slowed down until it captures with margins
    print("1. draft")
    with console.status("drafting") as line:  # one line of progress, in a terminal
        draft = sr.draft(REQUEST, file, capture=True, simulate=verify, progress=line.update)
    draft.save()
    print(*draft.problems, *draft.checks, sep="\n")

    scene = sr.load_scene(file, {**changes, "campaign.samples": samples})
    print("2. simulation")
    with console.status("simulating") as line:
        result = sr.simulate(scene, progress=line.update)
    for event in result.summary["events"]:
        print(f"{event['time_s']:7.2f} s  {event['kind']}")
    names = ["storyboard", "approach", "wheels"]
    viz.save_figures(result, folder / "figures", formats=("png",), names=names)
    viz.write_recording(result, folder / "film.gif", frames_per_s=5, speed=15, size_px=(480, 300))

    # the approach from the draft's posture with the least torque and base rotation, verified by replay
    if planned:
        print("3. plan of the approach")
        with console.status("planning") as line:
            plan = sr.plan(sr.load_scene(file), folder / "plan", progress=line.update)
        print(plan)

    # uncertain masses, drift and sensor noise
    print("4. Monte Carlo analysis")
    with console.status("campaign") as line:
        campaign = sr.campaign(scene, folder / "campaign", progress=lambda done: line.update(str(done)))
    failure = campaign.summary["gains"]["scenario"]["failure"]["any"]
    print(f"probability of failure {failure['value']:.1%} ({failure['low']:.1%} to {failure['high']:.1%})")
    times = {"scenario": campaign.data.capture_time.values.ravel()}
    drawing = figures.robustness(times, quantity="capture time", unit="s")
    (folder / "figures" / "capture_time.png").write_bytes(figures.to_bytes(drawing, "png"))
    print(f"files in {folder}:", ", ".join(sorted(path.name for path in folder.iterdir())))


if __name__ == "__main__":
    main()
