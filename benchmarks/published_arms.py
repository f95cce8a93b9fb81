"""``python -m benchmarks.published_arms [NAME...]``: published arms, drafted, simulated and planned.

Each URDF of the package example-robot-data is drafted by ``spacerobot new --capture`` with the shipped
``satellite_box.urdf``, simulated by ``run`` and planned by ``plan``, without an edit. Prints rows of
docs/validation/drafts.md. Processor times are those of this process and of the compilers that it starts; the
compile cache is empty when an arm begins.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import spacerobot as sr

TARGET = "satellite_box.urdf"
ARMS = {
    "UR3": ("ur_description/urdf/ur3_robot.urdf", "tool0"),
    "UR3 with gripper": ("ur_description/urdf/ur3_gripper.urdf", "tool0"),
    "UR3, joints limited": ("ur_description/urdf/ur3_joint_limited_robot.urdf", "tool0"),
    "UR5": ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    "UR5 with gripper": ("ur_description/urdf/ur5_gripper.urdf", "tool0"),
    "UR5, joints limited": ("ur_description/urdf/ur5_joint_limited_robot.urdf", "tool0"),
    "UR10": ("ur_description/urdf/ur10_robot.urdf", "tool0"),
    "UR10, joints limited": ("ur_description/urdf/ur10_joint_limited_robot.urdf", "tool0"),
    "Franka Panda": ("panda_description/urdf/panda.urdf", "panda_hand"),
    "Kinova Jaco 2": ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
    "xArm7": ("xarm_description/urdf/xarm7.urdf", "link_eef"),
    "Unitree Z1": ("z1_description/urdf/z1.urdf", "gripperMover"),
    "Unitree B1 with Z1": ("b1_description/urdf/b1-z1.urdf", "gripperStator"),
    "SO-100": ("so_arm_description/urdf/so100.urdf", "jaw"),
    "SO-101": ("so_arm_description/urdf/so101.urdf", "gripper_frame_link"),
    "Talos, left arm": ("talos_data/robots/talos_left_arm.urdf", "gripper_left_base_link"),
    "Talos, whole": ("talos_data/robots/talos_reduced.urdf", "gripper_left_base_link"),
    "Tiago with hand": ("tiago_description/robots/tiago.urdf", "hand_grasping_frame"),
    "Tiago without hand": ("tiago_description/robots/tiago_no_hand.urdf", "wrist_ft_tool_link"),
    "Tiago, two arms": ("tiago_description/robots/tiago_dual.urdf", "hand_left_grasping_frame"),
    "Tiago Pro": ("tiago_pro_description/robots/tiago_pro.urdf", "gripper_left_base_link"),
    "Baxter": ("baxter_description/urdf/baxter.urdf", "left_gripper"),
    "PR2": ("pr2_description/urdf/pr2.urdf", "l_gripper_tool_frame"),
    "Centauro": ("centauro_description/urdf/centauro.urdf", "arm1_8"),
    "Anymal with Kinova": ("anymal_b_simple_description/robots/anymal-kinova.urdf", "j2s6s200_end_effector"),
    "Romeo": ("romeo_description/urdf/romeo_small.urdf", "l_gripper"),
    "Alex": ("alex_description/urdf/alex_nub_hands.urdf", "LeftWristYawIMULink"),
    "Simple humanoid": ("simple_humanoid_description/urdf/simple_humanoid.urdf", "l_wrist"),
    "iCub": ("icub_description/robots/icub_reduced.urdf", "l_gripper"),
    "Unitree G1": ("g1_description/urdf/g1_29dof_rev_1_0.urdf", "left_rubber_hand"),
    "Hextilt, flying arm of 5 joints": (
        "hextilt_description/urdf/hextilt_flying_arm_5.urdf",
        "flying_arm_5__gripper",
    ),
}
"""URDF, below the package's folder, and link that holds the object."""


def processor_time() -> float:
    """Processor time of this process and of its ended children [s]."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def row(name: str, folder: Path) -> str:
    """Row of the table for an arm."""
    urdf, tip = ARMS[name]
    robots = Path(
        str(distribution("example-robot-data").locate_file("cmeel.prefix/share/example-robot-data"))
    )
    os.environ["SPACEROBOT_CACHE_DIR"] = str(folder / "cache" / name)
    file = folder / f"{urdf.rpartition('/')[2].removesuffix('.urdf')}.yaml"
    begin = processor_time()
    try:
        draft = sr.draft(sr.DraftRequest([str(robots / "robots" / urdf)], TARGET, [tip]), file, capture=True)
    except sr.SpaceRobotError as fault:
        return f"| {name} | | not drafted: {str(fault).rpartition('urdf: ')[2]} | | |"
    draft_s = processor_time() - begin
    scene = sr.load_scene(draft.save())
    joints = sum(not state.locked for state in scene.robots[0].config.joints.values())
    if not draft.is_verified:
        return f"| {name} | {joints} | {draft.problems[0]} | {draft_s:.0f} | |"
    slowdowns = [line for line in draft.text.splitlines() if line.startswith("# Slowed down by")]
    slow = f", slowed down by {slowdowns[-1].split()[4].strip(':')}" if slowdowns else ""
    result = sr.simulate(scene)
    captured = next(e["time_s"] for e in result.summary["events"] if e["kind"] == "captured")
    begin = processor_time()
    try:
        plan = sr.plan(scene)
        warnings = f", {len(plan.warnings)} warnings" if getattr(plan, "warnings", ()) else ""
        plan_cell = f"{processor_time() - begin:.2g}{warnings}"
    except sr.SpaceRobotError as fault:
        plan_cell = f"none after {processor_time() - begin:.2g}: {fault}"
    return f"| {name} | {joints} | captured after {captured:.1f} s{slow} | {draft_s:.0f} | {plan_cell} |"


def main(names: list[str]) -> None:
    """Print a row for each arm."""
    try:
        distribution("example-robot-data")
    except PackageNotFoundError:
        sys.exit("needs the package example-robot-data")
    print("| arm | joints | first `run` | draft [s] | first `plan` [s] |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name in names or ARMS:
            print(row(name, Path(folder)), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
