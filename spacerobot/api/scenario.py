"""Checks of a scenario, and lists of scenarios and kinds of elements."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spacerobot.common.errors import SpaceRobotError, near_names
from spacerobot.common.files import StrPath
from spacerobot.common.tables import Content, Table, Tree
from spacerobot.common.tabular import Tabular

if TYPE_CHECKING:
    import pinocchio as pin

    from spacerobot.common.section import Section
    from spacerobot.scene import Scene, SceneBody


@dataclass(frozen=True)
class SceneCheck(Tabular):
    """Result of a check: the scene, its warnings and every modelling assumption.

    Attributes:
        scene: The scene.
        warnings: Warnings of the scene, and bodies that overlap at the start.
    """

    scene: Scene
    warnings: tuple[str, ...]

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Modelling assumptions for values that the scenario does not state."""
        return self.scene.assumptions

    def content(self) -> Sequence[Content]:
        """Tree of the scene, its phases, its plan and its assumptions."""
        content: list[Content] = [scene_tree(self.scene)]
        if self.scene.scenario.phases:
            content.append(_phase_table(self.scene))
        if self.scene.scenario.plan is not None:
            content.append(Table("plan", (), [("collision avoidance", _avoidance(self.scene))]))
        return [*content, Table("assumptions", (), [(text,) for text in self.assumptions])]

    def notices(self) -> Sequence[str]:
        """Warnings of the check."""
        return self.warnings

    def __repr__(self) -> str:
        """Name and number of warnings, in one line."""
        return f"<SceneCheck of {self.scene.scenario.name}: {len(self.warnings)} warnings>"


def check(scene: Scene | StrPath) -> SceneCheck:
    """Check a scene before it is simulated.

    Args:
        scene: A scene, or the name or file of its scenario.

    Raises:
        ScenarioError, DescriptionError: If the scene cannot be simulated, or its result exceeds the memory.
    """
    from spacerobot.scene import to_scene
    from spacerobot.scene.memory import check_size
    from spacerobot.scene.overlaps import overlaps

    scene = to_scene(scene)
    check_size(scene)
    # limits of phases name outputs, which are checked when the closed loop is built
    phases = scene.scenario.phases.values()
    if any(phase.abort or (phase.until is not None and phase.until.limit) for phase in phases):
        from spacerobot.closedloop.loop_cache import cached_closed_loop
        from spacerobot.updates import UpdatedScene

        updated = UpdatedScene.of(scene)
        cached_closed_loop(scene if updated is None else updated.scene)
    return SceneCheck(scene, (*scene.warnings, *overlaps(scene)))


def _phase_table(scene: Scene) -> Table:
    """Table of the phases: end conditions, next phases, and changes of the scenario in each phase."""
    from spacerobot.scenario.phases import differences, ways

    rows = []
    for name, phase in scene.scenario.phases.items():
        rows.append((name, ways(name, scene.scenario.phases)))
        rows += [("", f"  {difference}") for difference in differences(phase)]
    return Table("phases", (), rows)


def _avoidance(scene: Scene) -> str:
    """Number of link pairs between which plans avoid collisions, in words."""
    from optim.planning.formulation.link_pairs import link_pairs

    pairs = link_pairs(scene)
    if not pairs:
        return "no links; switched off, or none have collision shapes and may meet"
    counts: dict[str, int] = {}
    for pair in pairs:
        first, second = (name.partition("/")[0] for name in (pair.first, pair.second))
        bodies = f"within {first}" if first == second else f"of {first} and {second}"
        counts[bodies] = counts.get(bodies, 0) + 1
    words = ", ".join(f"{count} {bodies}" for bodies, count in counts.items())
    return f"plans keep {len(pairs)} pairs of links apart, {words}"


def scene_tree(scene: Scene) -> Tree:
    """Tree of a scene: bodies with masses, joints and tips, grasps and contacts with initial gaps."""
    import numpy as np
    import pinocchio as pin

    from spacerobot.scene.contacts import gaps

    kind = "planar" if scene.planar else "spatial"
    simulation = scene.scenario.simulation
    step = f"steps of {simulation.step * 1e3:g} ms" if simulation.step else "step chosen from its tolerance"
    branches = [_body_tree(scene, body) for body in scene.bodies]
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)
    for grasp in scene.grasps:
        config, tip, frame = grasp.config, data.oMf[grasp.tip.frame], data.oMf[grasp.frame]
        distance = float(np.linalg.norm(tip.translation - frame.translation))
        holds = "holds" if config.begins == "closed" else "can hold"
        mated = (0.0, 0.0, 0.0) if config.capture is None else config.capture.mated_deg
        rotation = pin.log3((frame.rotation @ pin.rpy.rpyToMatrix(np.radians(mated))).T @ tip.rotation)
        angle = float(np.degrees(np.linalg.norm(rotation)))
        gap = f"initial gap {round(distance, 9):.3g} m"
        text = f"{grasp.tip.label} {holds} {config.frame}, {config.words()}, {gap}"
        desired = ", ".join(f"{x:g}" for x in mated)
        lines = (
            f"{grasp.tip.label} begins at {_pose_text(tip)}",
            f"{config.frame} begins at {_pose_text(frame)}",
            f"misaligned by {round(angle, 6):.3g} deg from `mated_deg` [{desired}]",
        )
        branches.append(Tree(f"grasp {grasp.name}:", text, lines))
    for contact in scene.contacts:
        first, second = contact.config.between
        gap = f"{min(gaps(scene, contact)):.3g} m apart at the start"
        text = f"{first} and {second}, {contact.config.words()}, {gap}"
        branches.append(Tree(f"contact {contact.name}:", text))
    for name, environment in scene.scenario.environment.items():
        branches.append(Tree(f"environment {name}:", environment.words()))
    text = f"{kind}, {scene.model.nv} velocities; {simulation.duration:g} s by {simulation.engine}, {step}"
    return Tree(scene.scenario.name, text, branches)


def _pose_text(pose: pin.SE3) -> str:
    """Position [m] and roll, pitch, yaw [deg] of a pose in words."""
    import numpy as np
    import pinocchio as pin

    angles = np.degrees(pin.rpy.matrixToRpy(pose.rotation))
    parts = (", ".join(f"{x + 0.0:.4g}" for x in np.round(v, 6)) for v in (pose.translation, angles))
    return "({}) m, roll, pitch, yaw ({}) deg".format(*parts)


def _body_tree(scene: Scene, body: SceneBody) -> Tree:
    """Tree of a body: mass, initial base position, joints, elements and tips."""
    import pinocchio as pin

    from spacerobot.scenario import Robot
    from spacerobot.scene.model import lent

    mass = sum(link.mass or 0.0 for link in body.config.links.values())
    mass -= sum(body.config.links[name].mass or 0.0 for name, _, _ in lent(scene.model, body))
    data = scene.model.createData()
    pin.framesForwardKinematics(scene.model, data, scene.q)
    x, y, z = data.oMf[body.root_frame].translation
    text = (
        f"{body.description.path.name}: {mass:g} kg, {body.base.joint} base at ({x:.4g}, {y:.4g}, {z:.4g}) m"
    )
    branches: list[Tree | str] = [
        f"{name}_ mounted on {mount.link or body.description.root}: {mount.urdf.rpartition('/')[2]}"
        for name, mount in getattr(body.config, "mounts", {}).items()
    ]
    joints = list(_joint_lines(scene, body))
    count = len(body.joints) - len(body.passive)
    branches += [Tree("", f"{count} joints", joints)] if count else joints
    branches += [f"flexible {name}: {flexible.words()}" for name, flexible in body.config.flexible.items()]
    if isinstance(body.config, Robot):
        branches += [f"{key.replace('.', ' ')}: {element.words()}" for key, element in body.config.parts()]
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
        branches.append(Tree(f"tip {tip.label}:", "; ".join(parts)))
    return Tree(body.name, text, branches)


def _joint_lines(scene: Scene, body: SceneBody) -> Iterator[str]:
    """Lines of a body's joints, without those of flexible links."""
    by_name = {joint.name: joint for joint in body.description.joints}
    bends = {body.joint_name(scene.model, joint) for joint in body.passive}
    for name, joint in body.config.joints.items():
        if name in bends:
            continue
        mimic = by_name[name].mimic
        state = f"at {joint.offset:g} m" if joint.offset is not None else f"at {joint.angle_deg or 0:g} deg"
        child = body.config.links.get(by_name[name].child)
        moved = f", moves {by_name[name].child}" + (f" of {child.mass:g} kg" if child else "")
        slides = by_name[name].kind == "prismatic"
        unit, per_rate = ("N", "N s/m") if slides else ("N m", "N m s/rad")
        limit = "" if joint.torque_limit is None else f", limit {joint.torque_limit:g} {unit}"
        if mimic is not None:
            state = f"mimics {mimic.joint} ({mimic.multiplier:g} q + {mimic.offset:g})"
        yield (
            f"{name}: {by_name[name].kind}, {state}, damping {joint.damping or 0:g} {per_rate}{limit}{moved}"
        )


@dataclass(frozen=True)
class ScenarioList(Tabular):
    """Shipped scenarios and URDFs.

    Attributes:
        scenarios: Description of each scenario by name.
        urdfs: Path of each URDF by file name.
    """

    scenarios: dict[str, str]
    urdfs: dict[str, Path]

    def content(self) -> Sequence[Content]:
        """Table of the scenarios, and a sentence with the names of the URDFs."""
        folder = next(iter(self.urdfs.values())).parent
        return [
            Table("scenarios", ("name", "description"), list(self.scenarios.items())),
            f"URDFs in {folder}: {', '.join(self.urdfs)}",
        ]

    def __repr__(self) -> str:
        """Numbers of scenarios and URDFs, in one line."""
        return f"<ScenarioList: {len(self.scenarios)} scenarios, {len(self.urdfs)} URDFs>"


def list_scenarios() -> ScenarioList:
    """List the shipped scenarios and URDFs.

    Raises:
        DescriptionError: If the URDFs are missing.
    """
    from spacerobot.description.find import shipped_names, shipped_urdf_folder
    from spacerobot.scenario.catalogue import shipped
    from spacerobot.scenario.document import read_document

    descriptions = {
        name: " ".join(str(read_document(path).get("description", "")).split())
        for name, path in shipped().items()
    }
    return ScenarioList(descriptions, {name: shipped_urdf_folder() / name for name in shipped_names()})


def scenario_schema() -> dict[str, Any]:
    """JSON schema of scenario files."""
    from spacerobot.scenario.load import json_schema

    return json_schema()


QUANTITY, QUANTITIES = "quantity", "quantities"
"""Name of the family of quantities, and its plural."""


@dataclass(frozen=True)
class KindList(Tabular):
    """Kinds of elements, goals, limits and costs that scenarios may name.

    Attributes:
        kinds: Section of each kind, by family and name.
        summaries: Description of each kind in one line, by family and name.
        keys: Whether :meth:`content` has the keys of the kinds instead of their descriptions.
    """

    kinds: dict[str, dict[str, type[Section]]]
    summaries: dict[str, dict[str, str]]
    keys: bool = False

    def content(self) -> Sequence[Content]:
        """Descriptions of the kinds, or the keys of each."""
        from spacerobot.elements.core.kind_table import fields_of

        if self.keys:
            return [
                Table(f"{_words(family)} {name}", ("key", "default", "description"), fields_of(section))
                for family, sections in self.kinds.items()
                for name, section in sections.items()
            ]
        return [
            Table(_words(family), ("kind", "description"), list(summaries.items()))
            for family, summaries in self.summaries.items()
        ]

    def __repr__(self) -> str:
        """Numbers of families and kinds, in one line."""
        return f"<KindList: {sum(map(len, self.kinds.values()))} kinds in {len(self.kinds)} families>"


def list_kinds(name: str | None = None, kind: str | None = None) -> KindList:
    """List the kinds of elements, goals, limits and costs, or the keys of one kind.

    Args:
        name: Family, whose kinds are listed, or kind, whose keys are listed; all kinds if None. The family
            ``quantity`` has the quantities that simulations and plans measure.
        kind: Kind in the family ``name``, if two families have kinds of the same name.

    Raises:
        SpaceRobotError: If the family or kind is unknown.
    """
    families = _families()
    if name is None:
        return _kind_list(families)
    if kind is None and name in (QUANTITY, QUANTITIES):
        return KindList({}, {QUANTITY: _quantities()})
    family = name.replace(" ", "_").replace("-", "_")
    if kind is not None and family not in families:
        raise SpaceRobotError(f"no family {name!r}; {near_names(family, families)}")
    if kind is None and family in families:
        return _kind_list({family: families[family]})
    chosen = families if kind is None else {family: families[family]}
    kind_name = name if kind is None else kind
    homes = {each: {kind_name: kinds[kind_name]} for each, kinds in chosen.items() if kind_name in kinds}
    if homes:
        return _kind_list(homes, keys=True)
    if kind is None and name in _quantities():
        return KindList({}, {QUANTITY: {name: _quantities()[name]}})
    if kind is not None:
        raise SpaceRobotError(f"no kind of {_words(family)} {kind!r}; {near_names(kind, families[family])}")
    names = {*families, QUANTITY, *_quantities(), *(each for kinds in families.values() for each in kinds)}
    near = get_close_matches(name, names)
    help_text = near_names(name, near) if near else f"families: {', '.join([*families, QUANTITY])}"
    raise SpaceRobotError(f"no family or kind {name!r}; {help_text}")


def _quantities() -> dict[str, str]:
    """Description and unit of each quantity by its name."""
    from spacerobot.quantities import quantities

    return {name: f"{one.description} [{one.unit}]" for name, one in quantities().items()}


def _kind_list(families: dict[str, dict[str, tuple[type[Section], str]]], *, keys: bool = False) -> KindList:
    sections = {
        family: {name: section for name, (section, _) in kinds.items()} for family, kinds in families.items()
    }
    summaries = {
        family: {name: summary for name, (_, summary) in kinds.items()} for family, kinds in families.items()
    }
    return KindList(sections, summaries, keys)


def _words(family: str) -> str:
    return family.replace("_", " ")


def _families() -> dict[str, dict[str, tuple[type[Section], str]]]:
    """Section and description of each kind, by family and name."""
    from spacerobot.elements import FAMILIES, PLANS, kinds
    from spacerobot.elements.core.kind_table import summary_of
    from spacerobot.quantities import planned
    from spacerobot.scenario.plan_cost import PlanCost

    families: dict[str, dict[str, tuple[type[Section], str]]] = {
        family: {name: (section, summary_of(section)) for name, section in kinds(family).items()}
        for family in FAMILIES | PLANS
    }
    costs: dict[str, tuple[type[Section], str]] = {
        name: (PlanCost, cost.description) for name, cost in planned().items()
    }
    return families | {"plan_cost": costs}
