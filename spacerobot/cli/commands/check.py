"""``spacerobot check``: validate a scenario before it is run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from spacerobot.cli.command import Command
from spacerobot.cli.options import Changes, ScenarioName, parse_changes
from spacerobot.cli.output import console, prose, warn

if TYPE_CHECKING:
    from rich.tree import Tree

    from spacerobot.scene import Scene, SceneBody


@Command.of("check", place=2)
def command(scenario: ScenarioName, changes: Changes = None) -> None:
    """Validate a scenario: print its scene as a tree, and every modelling assumption.

    Example:

        spacerobot check paper --set grasps.left.stiffness=200
    """
    from spacerobot.scene import load_scene

    scene = load_scene(scenario, parse_changes(changes))
    from spacerobot.scene.memory import check_size
    from spacerobot.scene.overlaps import overlaps

    check_size(scene)
    # refuse limits of outputs that there are not: the closed loop alone knows which there are
    phases = scene.scenario.phases.values()
    if any(phase.abort or (phase.until is not None and phase.until.limit) for phase in phases):
        from optim.planning.mpc.flown_scene import FlownScene, mpc_controllers
        from spacerobot.loop_cache import cached_closed_loop

        cached_closed_loop(FlownScene.of(scene).scene if mpc_controllers(scene) else scene)
    for warning in (*scene.warnings, *overlaps(scene)):
        warn(warning)
    console().print(scene_tree(scene))
    if scene.scenario.phases:
        console().print("\nphases", style="bold")
        # phases as a timeline: how each ends, what follows, and what differs in it
        from spacerobot.scenario.phases import differences, ways

        width = max(map(len, scene.scenario.phases))
        for name, phase in scene.scenario.phases.items():
            prose(f"{name:{width}}  {ways(name, scene.scenario.phases)}", indent=2)
            for difference in differences(phase):
                prose(difference, indent=width + 4)
    if scene.scenario.plan is not None:
        console().print("\nplan", style="bold")
        from optim.planning.formulation.link_pairs import link_pairs

        # which pairs of links plans keep apart by themselves
        pairs = link_pairs(scene)
        avoidance = "no links; switched off, or none have collision shapes and may meet"
        if pairs:
            by_bodies: dict[str, int] = {}
            for pair in pairs:
                one, other = (name.partition("/")[0] for name in (pair.first, pair.second))
                bodies = f"within {one}" if one == other else f"of {one} and {other}"
                by_bodies[bodies] = by_bodies.get(bodies, 0) + 1
            told = ", ".join(f"{count} {bodies}" for bodies, count in by_bodies.items())
            avoidance = f"plans keep {len(pairs)} pairs of links apart, {told}"
        prose(f"collision avoidance: {avoidance}", indent=2)
    console().print("\nassumptions", style="bold")
    for assumption in scene.assumptions:
        prose(assumption, indent=2)


def scene_tree(scene: Scene) -> Tree:
    """Tree of bodies, joints, tips, grasps, masses and initial gaps."""
    import numpy as np
    import pinocchio as pin
    from rich.markup import escape
    from rich.tree import Tree

    from spacerobot.scene.contacts import gaps

    kind = "planar" if scene.planar else "spatial"
    simulation = scene.scenario.simulation
    step = f"steps of {simulation.step * 1e3:g} ms" if simulation.step else "step chosen from its tolerance"
    root = Tree(
        f"[bold]{escape(scene.scenario.name)}[/] {kind}, {scene.model.nv} velocities; "
        f"{simulation.duration:g} s by {simulation.engine}, {step}"
    )
    for body in scene.bodies:
        _add_body(root, scene, body)
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)

    def pose(place: pin.SE3) -> str:
        """Position, and roll, pitch, yaw."""
        angles = np.degrees(pin.rpy.matrixToRpy(place.rotation))
        parts = (", ".join(f"{x + 0.0:.4g}" for x in np.round(v, 6)) for v in (place.translation, angles))
        return "({}) m, roll, pitch, yaw ({}) deg".format(*parts)

    for grasp in scene.grasps:
        config, tip, frame = grasp.config, data.oMf[grasp.tip.frame], data.oMf[grasp.frame]
        distance = float(np.linalg.norm(tip.translation - frame.translation))
        holds = "holds" if config.begins == "closed" else "can hold"
        text = f"{grasp.tip.label} {holds} {config.frame}, {config.words()}, initial gap {distance:.3g} m"
        branch = root.add(f"grasp [bold]{escape(grasp.name)}[/]: {escape(text)}")
        branch.add(escape(f"{grasp.tip.label} begins at {pose(tip)}"))
        branch.add(escape(f"{config.frame} begins at {pose(frame)}"))
        mated = (0.0, 0.0, 0.0) if config.capture is None else config.capture.mated_deg
        turned = pin.log3((frame.rotation @ pin.rpy.rpyToMatrix(np.radians(mated))).T @ tip.rotation)
        angle = float(np.degrees(np.linalg.norm(turned)))
        branch.add(
            escape(f"{angle:.3g} deg between them, from `mated_deg` [{', '.join(f'{x:g}' for x in mated)}]")
        )
    for contact in scene.contacts:
        first, second = contact.config.between
        apart = f"{min(gaps(scene, contact)):.3g} m apart at the start"
        text = f"{first} and {second}, {contact.config.words()}, {apart}"
        root.add(f"contact [bold]{escape(contact.name)}[/]: {escape(text)}")
    for name, environment in scene.scenario.environment.items():
        root.add(f"environment [bold]{escape(name)}[/]: {escape(environment.words())}")
    return root


def _add_body(root: Tree, scene: Scene, body: SceneBody) -> None:
    import pinocchio as pin
    from rich.markup import escape

    from spacerobot.scenario import Robot
    from spacerobot.scene.model import lent

    mass = sum(link.mass or 0.0 for link in body.config.links.values())
    mass -= sum(body.config.links[name].mass or 0.0 for name, _, _ in lent(scene.model, body))
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)
    x, y, z = data.oMf[body.root_frame].translation
    branch = root.add(
        f"[bold]{escape(body.name)}[/] {escape(body.description.path.name)}: {mass:g} kg, "
        f"{body.base.joint} base at ({x:.4g}, {y:.4g}, {z:.4g}) m"
    )
    for name, mount in getattr(body.config, "mounts", {}).items():
        where = mount.link or body.description.root
        branch.add(escape(f"{name}_ mounted on {where}: {mount.urdf.rpartition('/')[2]}"))
    count = len(body.joints) - len(body.passive)
    chain = branch.add(f"{count} joints") if count else branch
    by_name = {joint.name: joint for joint in body.description.joints}
    bends = {body.joint_name(scene.model, joint) for joint in body.passive}
    for name, flexible in body.config.flexible.items():
        branch.add(escape(f"flexible {name}: {flexible.words()}"))
    for name, joint in body.config.joints.items():
        if name in bends:
            continue
        mimic = by_name[name].mimic
        state = f"{joint.offset:g} m" if joint.offset is not None else f"{joint.angle_deg or 0:g} deg"
        child = body.config.links.get(by_name[name].child)
        carries = f", carries {by_name[name].child}" + (f" {child.mass:g} kg" if child else "")
        slides = by_name[name].kind == "prismatic"
        unit, per_rate = ("N", "N s/m") if slides else ("N m", "N m s/rad")
        limit = "" if joint.torque_limit is None else f", at most {joint.torque_limit:g} {unit}"
        if mimic is not None:
            state = f"mimics {mimic.joint} ({mimic.multiplier:g} q + {mimic.offset:g})"
        text = f"{name}: {by_name[name].kind}, {state}, resistance {joint.damping or 0:g} {per_rate}"
        chain.add(escape(text + limit + carries))
    if isinstance(body.config, Robot):
        for key, element in body.config.parts():
            branch.add(escape(f"{key.replace('.', ' ')}: {element.words()}"))
    for tip in (tip for tip in scene.tips if tip.body.name == body.name):
        parts = [
            f"reference {reference.config.kind}"
            + (" of the target" if reference.from_target else "")
            + (f" in {', '.join(reference.phases)}" if len(tip.references) > 1 else "")
            for reference in tip.references
        ]
        parts += [f"{key} {controller.words()}" for key, controller in tip.config.elements()]
        for key in ("amnesia", "orientation_amnesia"):
            memory = getattr(tip.config, key)
            if memory is not None:
                parts.append(f"{key} G_e {memory.ge:g} 1/s^2, t_a {memory.ta:.4g} 1/s")
        branch.add(f"tip [bold]{escape(tip.label)}[/]: {escape('; '.join(parts))}")
