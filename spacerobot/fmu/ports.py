"""Variables of a functional mock-up unit: parameters, inputs, outputs and integers of a closed loop."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from spacerobot.closedloop import ClosedLoop, CommandInput, OutputVariable
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.tables import unit_of_joint
from spacerobot.dynamics.rotations import rotation_from_quaternion
from spacerobot.fmu.names import keys_at, structured
from spacerobot.fmu.units import unit_definition
from spacerobot.scenario.load import to_document
from spacerobot.scenario.units import limits_at, unit_at
from spacerobot.scene import Scene
from spacerobot.scene.actuation import torque_limit, wrench_limits

AXES = ("x", "y", "z")
WHOLE = ("phase", "grasp_state")
"""Outputs with integer values."""


@dataclass(frozen=True)
class PlantVariable:
    """Variable of the unit.

    Attributes:
        name: Name by FMI's convention ``structured``.
        unit: Unit; empty for mixed units.
        text: Description.
        place: Index of the variable: of a parameter or input in p, of an output in y, of a switch among the
            switches, of a count among the events.
        start: Initial value of a parameter or an input.
        constant: Index in c of an input.
        tunable: Whether a parameter may change after initialization, which requires that the initial state
            does not depend on it.
        lower, upper: Limits of a parameter or an input; infinite if unlimited.
    """

    name: str
    unit: str
    text: str
    place: int
    start: float = 0.0
    constant: int = -1
    tunable: bool = False
    lower: float = -math.inf
    upper: float = math.inf


@dataclass(frozen=True)
class PlantPorts:
    """All variables of the unit.

    Attributes:
        parameters, inputs, outputs: Real variables.
        switches, counts: Integers: switches, 0 or 1; number of times each event fired.
        integer_outputs: Outputs with integer values.
        signals: (t, x, c) -> (y), in which ``outputs`` and ``integer_outputs`` have their indices.
    """

    parameters: tuple[PlantVariable, ...]
    inputs: tuple[PlantVariable, ...]
    outputs: tuple[PlantVariable, ...]
    switches: tuple[PlantVariable, ...]
    counts: tuple[PlantVariable, ...]
    integer_outputs: tuple[PlantVariable, ...]
    signals: ca.Function

    @property
    def integers(self) -> tuple[PlantVariable, ...]:
        """All integer variables."""
        return (*self.switches, *self.counts, *self.integer_outputs)


def find_ports(scene: Scene, loop: ClosedLoop, commands: Sequence[CommandInput] = ()) -> PlantPorts:
    """Variables of the unit of a closed loop.

    Args:
        scene, loop: The scene and its closed loop.
        commands: Parameters of the loop that are inputs.

    Raises:
        SpaceRobotError: If two variables have the same name, or a name has a character that FMI forbids.
    """
    outputs, integers, signals = _signals(scene, loop)
    switches = [
        PlantVariable(structured(["switches", *name.split(".")]), "", "1 while it is on, else 0", place)
        for place, name in enumerate(loop.switch_names)
        if ":" not in name  # those of references
    ]
    counts = [
        PlantVariable(
            structured(["events", *event.name.replace("/", ".").split(".")]),
            "",
            f"how often the event fired: {event.kind} ({event.who})",
            place,
        )
        for place, event in enumerate(loop.events)
        if ":" not in event.name and not (event.silent or event.routine or event.kink)
    ]
    ports = PlantPorts(
        parameters=tuple(_parameters(scene, loop, [command.path for command in commands])),
        inputs=tuple(_input(scene, loop, command) for command in commands),
        outputs=tuple(_with_units(scene, outputs)),
        switches=tuple(switches),
        counts=tuple(counts),
        integer_outputs=tuple(integers),
        signals=signals,
    )
    names = [v.name for v in (*ports.parameters, *ports.inputs, *ports.outputs, *ports.integers)]
    for name in names:
        if names.count(name) > 1 or name == "time":
            raise SpaceRobotError(f"more than one variable of the FMU is called {name!r}; rename the element")
    return ports


def _with_units(scene: Scene, variables: Sequence[PlantVariable]) -> Iterator[PlantVariable]:
    """Variables with one unit: of ``rad or m`` the first, where no joint slides, otherwise none.

    A unit that FMI cannot define is in the description.
    """
    kinds = scene.joint_kinds.values()
    for variable in variables:
        unit = variable.unit.replace(", ", " or ")
        if " or " in unit:
            unit = "" if "prismatic" in kinds else unit.partition(" or ")[0]
        if unit and unit_definition(unit) is None:
            variable = replace(variable, text=f"{variable.text} [{unit}]")
            unit = ""
        yield replace(variable, unit=unit)


def _parameters(scene: Scene, loop: ClosedLoop, inputs: Sequence[str]) -> Iterator[PlantVariable]:
    """Parameters that affect the initial state or the used constants of the loop."""
    document = to_document(scene.scenario)
    begun, prepared = (_dependence(loop.setup, result, 0) for result in (0, 1))
    used = set(loop.jumps)
    for function in (loop.dynamics, loop.outputs, *((loop.guards, loop.update) if loop.events else ())):
        for result in range(function.n_out()):
            used |= _dependence(function, result, 2).keys()
    if loop.tables:
        used |= _dependence(loop.rows, 0, 2).keys()
    for table in loop.tables:
        if table.noise < 0:
            used |= set(range(table.first, table.first + table.count * table.width))
    gaps = _dependence(loop.gaps, 0, 0) if loop.max_gaps else {}
    random_paths = {key for table in loop.noise for key in table.keys}
    for place, path in enumerate(loop.parameter_paths):
        constants = prepared.get(place, set())
        is_initial = place in begun or place in gaps or bool(constants & set(loop.jumps))
        if path in random_paths or path in inputs or not (is_initial or constants & used):
            continue
        keys = keys_at(document, path)
        if all(isinstance(key, int) for key in keys[-2:]):
            continue  # an entry of a table, such as that of a plan
        lower, upper = limits_at(scene.scenario, path)
        (variable,) = _with_units(
            scene,
            [
                PlantVariable(
                    structured(keys),
                    unit_at(scene.scenario, path),
                    path,
                    place,
                    float(loop.parameter_values[place]),
                    tunable=not is_initial,
                    lower=lower,
                    upper=upper,
                )
            ],
        )
        yield variable


def _dependence(function: ca.Function, result: int, argument: int) -> dict[int, set[int]]:
    """Entries of a result that depend on each entry of an argument; independent entries are missing."""
    rows, columns = function.jac_sparsity(result, argument).get_triplet()
    dependent_rows: dict[int, set[int]] = {}
    for row, column in zip(rows, columns, strict=True):
        dependent_rows.setdefault(column, set()).add(row)
    return dependent_rows


def _input(scene: Scene, loop: ClosedLoop, command: CommandInput) -> PlantVariable:
    """Input of a command, within the limits of its actuator."""
    place = loop.index(command.path)
    (constant,) = _dependence(loop.setup, 1, 0)[place]
    limit = _limit(scene, command)
    return PlantVariable(
        structured(command.keys),
        command.unit,
        command.text,
        place,
        0.0,
        constant,
        lower=0.0 - limit,
        upper=limit,
    )


def _limit(scene: Scene, command: CommandInput) -> float:
    """Greatest force or torque that the actuators of a joint or of a base deliver."""
    body = next(body for body in scene.robots if body.name == command.keys[1])
    *_, group, name = command.keys
    if group != "base" or len(command.keys) == 3:
        return torque_limit(body, name) or math.inf
    kind = {"f": "force", "t": "torque"}[name[0]]  # fx, ..., tz
    limits = [limit for part, limit in wrench_limits(scene, body).items() if part == kind]
    return float(limits[0][AXES.index(name[1])]) if limits else math.inf


def _signals(scene: Scene, loop: ClosedLoop) -> tuple[list[PlantVariable], list[PlantVariable], ca.Function]:
    """Real outputs, integer outputs, and the function of both: outputs of the loop, bodies and joints."""
    arguments = [
        ca.SX.sym(loop.outputs.name_in(i), loop.outputs.numel_in(i)) for i in range(loop.outputs.n_in())
    ]
    values = loop.outputs.call(arguments)
    kinds = scene.joint_kinds
    outputs: list[PlantVariable] = []
    integers: list[PlantVariable] = []
    entries: list[ca.SX] = []
    for variable, value in zip(loop.variables, values, strict=True):
        keys = _labels(scene, variable, value.numel())
        for keys_of_entry, entry in zip(keys, ca.vertsplit(ca.densify(value)), strict=True):
            if entry.is_constant() and np.isnan(float(entry)):
                continue  # what an element does not declare
            name, unit = structured([variable.name, *keys_of_entry]), variable.unit
            if variable.dims[:1] in (("joint",), ("driven_joint",)):
                unit = unit_of_joint(unit, kinds.get("/".join(map(str, keys_of_entry)), ""))
            listed = integers if variable.name in WHOLE else outputs
            listed.append(PlantVariable(name, unit, variable.text, len(entries)))
            entries.append(entry)
    for name, unit, text, entry in _configuration(scene, arguments[1]):
        outputs.append(PlantVariable(name, unit, text, len(entries)))
        entries.append(entry)
    names = ["t", "x", "c"]
    y = ca.densify(ca.vertcat(ca.SX(0, 1), *entries))
    return outputs, integers, ca.Function("outputs", arguments, [y], names, ["y"], {"cse": True})


def _labels(scene: Scene, variable: OutputVariable, size: int) -> list[list[str | int]]:
    """Words and indices of each entry's name after the name of its variable."""
    labels = [_words(label, variable.dims[:1] == ("driven_joint",)) for label in variable.labels]
    if variable.dims[:1] == ("joint",):
        joints = sorted(joint for body in scene.bodies for joint in body.arm_joints)
        labels = [[*str(scene.model.names[joint]).split("/", 1)] for joint in joints]
    elif variable.dims[:1] in ((), ("axis",)):
        labels = [[]]
    keys = labels
    if variable.dims[-1:] == ("axis",):
        keys = [[*label, axis] for label in labels for axis in AXES]
    if len(keys) != size:  # several numbers of one label
        keys = [[*label, i] for label in labels for i in range(size // max(1, len(labels)))]
    return keys


def _words(label: str, is_joint: bool) -> list[str | int]:
    """Words and indices of a label, ``servicer/wheels.0``; the name of a joint is one word."""
    if is_joint:
        return [*label.split("/", 1)]
    words = label.replace("/", ".").split(".")
    return [words[0], *(int(word) if word.isdecimal() else word for word in words[1:])]


def _configuration(scene: Scene, x: ca.SX) -> Iterator[tuple[str, str, str, ca.SX]]:
    """Attitudes and velocities of bodies that float, positions and rates of joints."""
    model = scene.model
    q, v = x[: model.nq], x[model.nq : model.nq + model.nv]
    for body in scene.bodies:
        if not body.root_joint:
            continue
        joint = model.joints[body.root_joint]
        pose, twist = q[joint.idx_q : joint.idx_q + joint.nq], v[joint.idx_v : joint.idx_v + joint.nv]
        if joint.nv == 3:
            half = ca.atan2(pose[3], pose[2]) / 2
            quaternion = ca.vertcat(0, 0, ca.sin(half), ca.cos(half))
            linear, angular = ca.vertcat(twist[:2], 0), ca.vertcat(0, 0, twist[2])
        else:
            quaternion, linear, angular = pose[3:7], twist[:3], twist[3:]
        rotation = rotation_from_quaternion(quaternion)
        for axis, entry in zip((*AXES, "w"), ca.vertsplit(ca.densify(quaternion)), strict=True):
            name = structured(["body_orientation", body.name, axis])
            yield name, "1", "orientation of root links, quaternion from their axes to the world's", entry
        vectors: Mapping[str, tuple[str, str, ca.SX]] = {
            "body_velocity": ("m/s", "velocity of root links", linear),
            "body_spin": ("rad/s", "angular velocity of root links", angular),
        }
        for kind, (unit, text, vector) in vectors.items():
            world = ca.densify(ca.mtimes(rotation, vector))
            for axis, entry in zip(AXES, ca.vertsplit(world), strict=True):
                yield structured([kind, body.name, axis]), unit, f"{text}, world axes", entry
    for index in sorted(joint for body in scene.bodies for joint in body.arm_joints):
        joint, keys = model.joints[index], str(model.names[index]).split("/", 1)
        position = q[joint.idx_q]
        if joint.nq == 2:
            position = ca.atan2(q[joint.idx_q + 1], q[joint.idx_q])
        kind = scene.joint_kinds.get("/".join(keys), "")
        units = [unit_of_joint(unit, kind) for unit in ("rad or m", "rad/s or m/s")]
        yield structured(["joint_position", *keys]), units[0], "joint positions", position
        yield structured(["joint_velocity", *keys]), units[1], "joint rates", v[joint.idx_v]
