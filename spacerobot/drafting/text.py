"""YAML text of a drafted scenario, with comments on the origin of its numbers."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import yaml

from spacerobot.drafting.arms import DraftArm, as_name
from spacerobot.drafting.numbers import RATES, SPAN, DraftMotion, Gains, short
from spacerobot.scenario.paths import Document
from spacerobot.scenario.yaml_text import Dumper


@dataclass(frozen=True)
class DraftText:
    """Content of a drafted scenario.

    Attributes:
        name: Name of the scenario.
        arms, bare: The robots, and the scenario without gains.
        gains: Gains by the labels of tips.
        move: Reference motion of the target.
        steps: Steps of rollouts with these gains, and with the upper bounds of the gains [s].
        payload: Keys of the object as payload of the only arm; None with several arms.
    """

    name: str
    arms: Sequence[DraftArm]
    bare: Document
    gains: Mapping[str, Gains]
    move: DraftMotion
    steps: tuple[float, float]
    payload: Document | None = None


def text_of(draft: DraftText) -> str:
    """YAML text of a drafted scenario."""
    lines = [
        "# Drafted by `spacerobot new`. Every number is a proposal; edit it.",
        "# Units are SI unless a name says otherwise; `spacerobot schema` exports every field with its unit.",
        f"name: {flow(as_name(draft.name))}",
        "",
        "robots:",
    ]
    for arm in draft.arms:
        lines += robot_lines(draft, arm)
    bare, move = draft.bare, draft.move
    reference = {"kind": "line", "displacement": move.displacement, "duration": move.duration}
    peak = 1.5 * max(draft.move.displacement) / draft.move.duration
    allowed = short(max(draft.move.displacement) / 5, 1)
    campaign = [
        "# Uncertain parameters of `spacerobot campaign`; ranges are proposals (docs/how_to/monte_carlo.md)",
        "campaign:",
        "  parameters:",
        "    object_mass: {paths: 'target.links.*.mass', apply: factor, lower: 0.8, upper: 1.2}",
        "    link_mass: {paths: 'robots.*.links.*.mass', apply: factor, lower: 0.95, upper: 1.05}",
        "    # standard deviation: a hundredth of the peak speed of the reference",
        "    velocity_offset: {paths: 'robots.*.sensors.tip_velocity.offset', kind: normal, mean: 0, "
        f"std: {short(peak / 100, 1):g}}}",
        "  samples: 256",
        f"  limits: {{tip_error: {allowed:g}}}   # [m], a fifth of the reference's displacement",
        f"  step: {min(0.002, draft.steps[0]):g}",
    ]
    lines += [
        "",
        "target:",
        *target_lines(bare["target"]),
        f"  base: {flow(bare['target']['base'])}   # placed so that this grasp closes",
        "  # The line leads away from the arm. It moves no joint by more than about 0.3 rad, and the object",
        "  # by at most a tenth of the distance from base to tip. No joint moves faster than about a tenth",
        "  # of its rate limit, and the motion is slow relative to the bandwidth.",
        f"  reference: {flow(reference)}",
        "",
        "grasps:   # a weld is rigid; `kind: compliant` has stiffness and damping",
        *(f"  {name}: {flow(grasp)}" for name, grasp in bare["grasps"].items()),
        "",
        f"simulation: {flow({'duration': move.duration + 2, 'output_step': 0.02})}   "
        "# the step is chosen by an error estimate",
        "",
        *tuning_lines(draft),
        "",
        *campaign,
    ]
    return "\n".join(lines) + "\n"


def joint_lines(arm: DraftArm, bare: Document) -> list[str]:
    """First lines of a robot's section: URDFs, base and posture."""
    chain = {name: state for name, state in arm.joints.items() if "locked" not in state}
    locked = {name: state for name, state in arm.joints.items() if "locked" in state}
    lines = [
        f"  {arm.name}:",
        f"    urdf: {flow(bare['urdf'])}",
        f"    base: {flow(bare['base'])}",
    ]
    if bare.get("mounts"):
        lines.append("    mounts:")
        lines += [f"      {name}: {flow(mount)}" for name, mount in bare["mounts"].items()]
    for link, bus in bare.get("links", {}).items():
        lines += [
            "    # The root link of the URDF is lighter than the arm. It is replaced by a spacecraft: a cube",
            "    # of 300 kg/m^3 with 20 times the mass of the arm, but not lighter than the object.",
            f"    links: {{{flow(link)}: {flow(bus)}}}",
        ]
    lines += [
        "    joints:   # a posture near mid-range from which the tip can move in every direction",
        *(f"      {flow(name)}: {flow(state)}" for name, state in chain.items()),
    ]
    if locked:
        lines.append("      # these joints are not between base and tip and are locked")
        lines += [f"      {flow(name)}: {flow(state)}" for name, state in locked.items()]
    return lines


def target_lines(target: Document) -> list[str]:
    """Lines of the target's section before its base: URDF, and joints."""
    lines = [f"  urdf: {flow(target['urdf'])}"]
    if target.get("joints"):
        lines += [
            "  joints:   # without a controller they would move freely, so they are locked",
            *(f"    {flow(name)}: {flow(state)}" for name, state in target["joints"].items()),
        ]
    return lines


def guidance_lines(arm: DraftArm, gain: float, payload: Document) -> list[str]:
    """Lines of the controller of an arm's tip inside ``controllers``, with a comment."""
    guidance: Document = {"kind": "resolved_rate", "gain": gain, "rate_gain": short(RATES * gain, 2)}
    guidance |= {} if arm.turns else {"orientation": False}
    return [
        "      # Joint rates follow from the generalized Jacobian, which includes the reaction of the base.",
        "      # `gain` is the bandwidth of the tip error: the rate at which the slowest joint reaches its",
        "      # rate limit by its effort, between 0.5 and 2 1/s. `rate_gain` is the bandwidth of the joint",
        "      # rates. While the object is held, it is the payload, in axes of the tip.",
        f"      guidance: {flow(guidance | payload)}",
    ]


def guidance_variables(arm: DraftArm, gain: float) -> list[str]:
    """Lines of the tuning variables of an arm's controller."""
    path, lines = f"robots.{arm.name}.controllers.guidance", list[str]()
    for name, value in (("gain", gain), ("rate_gain", RATES * gain)):
        bounds = {"lower": short(value / SPAN), "upper": short(value * SPAN), "scale": "log"}
        lines.append(f"    {name}: {flow({'paths': f'{path}.{name}'} | bounds)}")
    return lines


def robot_lines(draft: DraftText, arm: DraftArm) -> list[str]:
    """Lines of a robot's section."""
    bare, gains = draft.bare["robots"][arm.name], draft.gains[f"{arm.name}/{arm.tip_name}"]
    lines, tip = joint_lines(arm, bare), bare["tips"][arm.tip_name]
    if draft.payload is not None:
        lines += ["    controllers:", *guidance_lines(arm, gains.guidance, draft.payload), "    tips:"]
        frame = {"frame": tip["frame"]} if "frame" in tip else {}
        return [*lines, f"      {arm.tip_name}: {flow(frame)}"]
    lines += [
        "    tips:",
        f"      {arm.tip_name}:",
        f"        # effective mass at the tip: {gains.mass:.3g} kg (free-floating); bandwidth w = "
        f"{gains.bandwidth:g} rad/s:",
        "        # the rate at which the slowest joint reaches its rate limit by its effort, between 0.5 and",
        "        # 10, or 2 if the URDF has no limits; K_p = m w, K_i = m w^2 / 4",
    ]
    if "frame" in tip:
        lines.append(f"        frame: {flow(tip['frame'])}")
    lines.append(f"        pid: {flow(gains.pid(gains.mass) | {'feedback': 'inertial'})}")
    if gains.inertia is not None:
        lines.append(f"        # the same for the effective inertia of {gains.inertia:.3g} kg m^2")
        turn = gains.pid(gains.inertia) | {"feedback": "inertial"}
        lines.append(f"        orientation_pid: {flow(turn)}")
    if gains.joint_inertia is not None:
        kd = short(gains.joint_inertia * gains.bandwidth)
        lines.append("    # damps joint motions in the null space of the tips: smallest inertia times w")
        lines.append(f"    joint_pd: {flow({'kd': kd, 'null_space': True})}")
    return lines


def tuning_lines(draft: DraftText) -> list[str]:
    """Lines of the tuning section."""
    lines = [
        f"# Variables of tuning: {1 / SPAN:g} to {SPAN:g} the proposed values (docs/how_to/tune.md)",
        "tuning:",
        "  variables:",
    ]
    for arm in draft.arms:
        gains = draft.gains[f"{arm.name}/{arm.tip_name}"]
        if draft.payload is not None:
            lines += guidance_variables(arm, gains.guidance)
            continue
        suffix = "" if len(draft.arms) == 1 else f"_{arm.name}"
        for key, prefix, mass in (("pid", "", gains.mass), ("orientation_pid", "turn_", gains.inertia)):
            for gain, value in ({} if mass is None else gains.pid(mass)).items():
                variable = {
                    "paths": f"robots.{arm.name}.tips.{arm.tip_name}.{key}.{gain}",
                    "lower": short(value / SPAN),
                    "upper": short(value * SPAN),
                    "scale": "log",
                }
                lines.append(f"    {prefix}{gain}{suffix}: {flow(variable)}")
    return [
        *lines,
        "  # integral of squared tip errors (minimax: the largest); a radian of the target counts as 0.3 m",
        "  objective: {kind: ise, object_rotation: 0.1}",
        "  # constraints: {max_joint_torque: 50, max_grip_force: 100}",
        f"  step: {draft.steps[1]:g}   # resolves the fastest motion at the upper bounds",
    ]


def flow(value: Any) -> str:
    """YAML text of a value on one line."""
    if isinstance(value, str):
        value = yaml.dump(value, Dumper=Dumper, width=10_000, allow_unicode=True).splitlines()[0]
        return str(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{flow(key)}: {flow(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(flow(item) for item in value) + "]"
    return f"{value:g}" if isinstance(value, float) else json.dumps(value)
