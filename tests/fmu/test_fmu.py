"""Plants as functional mock-up units, read and run by FMPy, which shares no code with the export."""

import io
import json
import re
import zipfile

import numpy as np
import pytest

from spacerobot.cli import app
from spacerobot.closedloop import build_commanded_loop
from spacerobot.common.errors import CompileError, ScenarioError, SpaceRobotError
from spacerobot.fmu import build_fmu
from spacerobot.fmu.names import keys_at, structured
from spacerobot.fmu.ports import find_ports
from spacerobot.fmu.unit import _with_held_values
from spacerobot.fmu.units import unit_definition
from spacerobot.rollout import build_rollout
from spacerobot.scenario.load import to_document
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from tests.oracles.small_scenes import PLANAR, SPATIAL, folder, small_scene

fmpy = pytest.importorskip("fmpy")

from fmpy.fmi2 import FMU2Slave  # noqa: E402
from fmpy.fmi3 import FMU3Slave  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

SHORT = {"simulation.duration": 18.0}
"""A docking through its capture, at 16.57 s."""


@pytest.fixture(scope="session")
def units(tmp_path_factory):
    """Function from a scene and options to the file of its unit, each built once."""
    folder, built = tmp_path_factory.mktemp("fmu"), {}

    def unit(scene, **options):
        key = (json.dumps(to_document(scene.scenario)), *sorted(options.items()))
        if key not in built:
            built[key] = folder / f"{len(built)}.fmu"
            built[key].write_bytes(build_fmu(scene, **options))
        return str(built[key])

    return unit


@pytest.fixture(scope="session")
def docking():
    return load_scene("docking", {"simulation.duration": 60})


class Slave:
    """An instance of a unit, of either version, by the names of its variables."""

    def __init__(self, file, start=0.0, **parameters):
        self.description = fmpy.read_model_description(file)
        self.folder = fmpy.extract(file)
        kind = FMU2Slave if self.description.fmiVersion == "2.0" else FMU3Slave
        self.messages = []
        self.slave = kind(
            guid=self.description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=self.description.coSimulation.modelIdentifier,
        )
        self.slave.instantiate()
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.time = start
        self.is_3 = kind is FMU3Slave
        if self.is_3:
            self.slave.enterInitializationMode(startTime=start)
        else:
            self.slave.setupExperiment(startTime=start)
            self.slave.enterInitializationMode()
        self.set(**parameters)
        self.slave.exitInitializationMode()

    def set(self, **values):
        setter = self.slave.setFloat64 if self.is_3 else self.slave.setReal
        for name, value in values.items():
            setter([self.references[name]], [value])

    def get(self, *names):
        getter = self.slave.getFloat64 if self.is_3 else self.slave.getReal
        return np.array(getter([self.references[name] for name in names]))

    def count(self, name):
        getter = self.slave.getInt32 if self.is_3 else self.slave.getInteger
        return getter([self.references[name]])[0]

    def step(self, length):
        result = self.slave.doStep(currentCommunicationPoint=self.time, communicationStepSize=length)
        self.time += length
        return result

    def outputs(self):
        return self.get(
            *(
                v.name
                for v in self.description.modelVariables
                if v.causality == "output" and v.type in ("Real", "Float64")
            )
        )

    @property
    def state(self):
        return self.slave.getFMUState()

    @state.setter
    def state(self, value):
        self.slave.setFMUState(value)

    def serialized(self, state):
        return self.slave.serializeFMUState(state)

    def deserialized(self, stored):
        return self.slave.deserializeFMUState(stored)

    def close(self):
        self.slave.terminate()
        self.slave.freeInstance()


def series(result, run):
    """Pairs of values of the result of a simulation and of FMPy's, by name, at the times of both."""
    data = result.data
    count = len(data.time)
    for name in run.dtype.names:
        variable, *labels = name.replace("[", ".").translate({ord(mark): None for mark in "]'"}).split(".")
        if variable not in data:
            continue
        values = data[variable]
        for axis in ("axis", "quaternion"):
            if axis in values.dims:
                values = values.sel({axis: labels.pop()})
        others = [dim for dim in values.dims if dim != "time"]
        if others:
            known = {re.sub(r"[/.]", "", str(label)): label for label in values[others[0]].values}
            values = values.sel({others[0]: known["".join(labels)]})
        yield name, values.values[:count], np.asarray(run[name], dtype=float)[:count]


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_whole_docking_equals_the_simulation(units, docking, fmi):
    file = units(docking, fmi=fmi)
    assert validate_fmu(file) == []
    result = simulate(docking)
    run = fmpy.simulate_fmu(file, output_interval=docking.scenario.simulation.output_step)
    assert abs(run["time"][: len(result.data.time)] - result.data.time.values).max() < 1e-9
    compared = 0
    for name, expected, found in series(result, run):
        both = np.isfinite(expected) & np.isfinite(found)
        assert (np.isfinite(expected) == np.isfinite(found)).all(), name
        scale = max(1.0, np.abs(expected[both]).max(initial=0.0))
        assert np.abs(expected - found)[both].max(initial=0.0) < 1e-9 * scale, name
        compared += 1
    assert compared > 150
    ended = [event for event in result.summary["events"] if event["kind"] == "end"]
    assert len(ended) == 1
    assert run["events.part.time"][-1] == 1
    assert run["events.left.captured"][-1] == run["events.right.captured"][-1] == 1
    assert [*dict.fromkeys(run["phase"])] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_state_that_is_restored_gives_the_same_bits(units, docking, fmi):
    slave = Slave(units(docking, fmi=fmi))
    for _ in range(166):
        slave.step(0.1)
    slave.step(-0.037 + 0.1)  # within a step of the grid
    state, time = slave.state, slave.time
    stored = slave.serialized(state)
    first = []
    for length in (0.013, 0.1, 0.0071, 0.5):
        slave.step(length)
        first.append(slave.outputs())
    captured = slave.count("events.left.captured")
    for one in (state, slave.deserialized(stored)):
        slave.state, slave.time = one, time
        second = []
        for length in (0.013, 0.1, 0.0071, 0.5):
            slave.step(length)
            second.append(slave.outputs())
        assert np.array_equal(first, second, equal_nan=True)
        assert slave.count("events.left.captured") == captured == 1
    slave.close()


def test_the_trajectory_does_not_depend_on_the_communication_step(units, docking):
    ends = []
    rng = np.random.default_rng(3)
    for lengths in ([0.05] * 340, [17.0], [*rng.uniform(0.0001, 0.11, 280), None]):
        slave = Slave(units(docking, fmi=3))
        for length in lengths:
            slave.step(17.0 - slave.time if length is None else length)
        ends.append(slave.outputs())
        assert slave.count("events.left.captured") == 1
        slave.close()
    assert np.allclose(ends[0], ends[1], rtol=0, atol=1e-11, equal_nan=True)
    assert np.allclose(ends[0], ends[2], rtol=0, atol=1e-11, equal_nan=True)


def test_outputs_between_two_steps_are_those_of_short_steps(units, docking):
    slave = Slave(units(docking, fmi=2))
    slave.step(1.0023)
    between = slave.get("tip_position.rpr1.tip.x", "tip_position.rpr1.tip.y")
    times = {"simulation.duration": 1.0023, "simulation.step": 1.0023 / 400, "simulation.output_step": 1.0023}
    fine = simulate(load_scene("docking", times)).data.tip_position.isel(time=-1).sel(tip="rpr1/tip")
    assert np.abs(between - fine.values[:2]).max() < 1e-10
    slave.close()


def test_parameters_before_the_initialization_are_those_of_the_scenario(units, docking):
    changes = {"target.links.body.mass": 26.0, "robots.rpr1.joints.joint_1.angle_deg": 24.0}
    result = simulate(load_scene("docking", {**SHORT, **changes}))
    run = fmpy.simulate_fmu(units(docking, fmi=3), stop_time=18, output_interval=0.05, start_values=changes)
    nominal = fmpy.simulate_fmu(units(docking, fmi=3), stop_time=18, output_interval=0.05)
    assert np.abs(run["joint_position.rpr1.joint_1"] - nominal["joint_position.rpr1.joint_1"]).max() > 0.01
    for name, expected, found in series(result, run):
        both = np.isfinite(expected) & np.isfinite(found)
        scale = max(1.0, np.abs(expected[both]).max(initial=0.0))
        assert np.abs(expected - found)[both].max(initial=0.0) < 1e-9 * scale, name


def test_a_start_at_another_time_shifts_the_scenario(units, docking):
    early, late = (Slave(units(docking, fmi=fmi), start=start) for fmi, start in ((2, 0.0), (2, 100.0)))
    for _ in range(40):
        early.step(0.05)
        late.step(0.05)
    assert np.allclose(early.outputs(), late.outputs(), rtol=0, atol=1e-10, equal_nan=True)
    assert late.get("time")[0] == pytest.approx(102)
    early.close()
    late.close()


SAMPLED = {
    "robots.one.tips.tip.pid.sampled": {"period": 0.02},
    "robots.two.tips.tip.pid.sampled": {"period": 0.02},
    "robots.one.tips.tip.amnesia": None,
    "simulation.output_step": 0.01,
}


@pytest.mark.parametrize("text", [PLANAR, SPATIAL])
def test_recorded_commands_move_an_open_plant_as_the_controllers_did(units, text):
    scene = small_scene(text, SAMPLED)
    result = simulate(scene)
    file = units(scene, fmi=3, is_open=True)
    assert validate_fmu(file) == []
    slave = Slave(file)
    inputs = [v.name for v in slave.description.modelVariables if v.causality == "input"]
    assert inputs
    assert all(name.startswith("commands.") for name in inputs)
    torque, worst = result.data.joint_torque, 0.0
    for k in range(100):
        for name in inputs:
            label = name.removeprefix("commands.").replace(".", "/")
            slave.set(**{name: float(torque.isel(time=2 * k + 1).sel(joint=label))})  # held over the period
        slave.step(0.02)
        for robot in ("one", "two"):
            found = slave.get(*(f"tip_position.{robot}.tip.{axis}" for axis in "xyz"))
            expected = result.data.tip_position.isel(time=2 * k + 2).sel(tip=f"{robot}/tip").values
            worst = max(worst, np.abs(found - expected).max())
    assert worst < 1e-9
    assert np.abs(result.data.tip_position.isel(time=-1) - result.data.tip_position.isel(time=0)).max() > 0.01
    slave.close()


def test_an_input_within_a_step_cuts_the_step(units):
    scene = small_scene(PLANAR)
    loop, commands = build_commanded_loop(scene, ["one", "two"])
    values = {commands[0].path: 0.3, commands[-1].path: -0.2}
    rollout = build_rollout(loop, duration_s=1.0, step_s=0.0005, output_step_s=1.0, backend="interpreted")
    slave = Slave(units(scene, fmi=2, is_open=True))
    slave.set(**values)
    for length in (0.0033, 0.25, 0.0301, 1 - 0.2834):
        slave.step(length)
    expected = rollout.run(values).outputs["tip_position"][-1]
    labels = [f"tip_position.{robot}.tip.{axis}" for robot in ("one", "two") for axis in "xyz"]
    assert np.abs(slave.get(*labels) - expected).max() < 1e-9
    # a command that is given for a part of the time gives its part of the momentum
    other = Slave(units(scene, fmi=2, is_open=True))
    for value, length in ((0.3, 0.5017), (0.0, 0.4983)):
        other.set(**{commands[0].path: value})
        other.step(length)
    assert np.abs(other.get(*labels) - slave.get(*labels)).max() > 1e-4
    slave.close()
    other.close()


def test_a_tunable_parameter_acts_from_its_change_on(units):
    scene = small_scene(PLANAR)
    file = units(scene, fmi=3)
    kinds = {v.name: v.variability for v in fmpy.read_model_description(file).modelVariables}
    assert kinds["robots.one.tips.tip.pid.kp"] == "tunable"
    assert kinds["robots.one.base.velocity[0]"] == "fixed"
    gain = "robots.one.tips.tip.pid.kp"
    stiff = Slave(file, **{gain: 60.0})
    changed, nominal = Slave(file), Slave(file)
    changed.set(**{gain: 60.0})  # ahead of the first step
    for one in (stiff, changed, nominal):
        one.step(0.5013)
    assert np.allclose(stiff.outputs(), changed.outputs(), rtol=0, atol=1e-12, equal_nan=True)
    assert not np.allclose(nominal.outputs(), changed.outputs(), rtol=0, atol=1e-6, equal_nan=True)
    with pytest.raises(Exception, match="fmi3SetFloat64"):
        nominal.set(**{"robots.one.base.velocity[0]": 0.5})
    for one in (stiff, changed, nominal):
        one.close()


def limits_in(file):
    return {
        v.name: (v.min, v.max) for v in fmpy.read_model_description(file).modelVariables if v.min or v.max
    }


@pytest.mark.parametrize("fmi", [2, 3])
def test_limits_of_the_scenario_are_those_of_the_variables(units, fmi):
    scene = small_scene(PLANAR)
    file = units(scene, fmi=fmi, is_open=True)
    assert validate_fmu(file) == []
    limits = limits_in(file)
    assert limits["robots.one.links.link_1.mass"] == ("0.0", None)
    assert "robots.one.base.velocity[0]" not in limits
    efforts = {joint.name: joint.effort for joint in scene.robots[0].description.joints}
    joints = [scene.robots[0].joint_name(scene.model, joint) for joint in scene.robots[0].driven_joints]
    assert joints
    for name in joints:
        effort = float(efforts[name])
        assert tuple(map(float, limits[f"commands.one.{name}"])) == (-effort, effort)


def test_sensors_with_noise_are_outputs_of_an_open_plant(units):
    errors = {"period": 0.05, "noise": 0.01}
    changes = {
        "robots.one.sensors": {"joint_rate": {"errors": errors}},
        "robots.one.tips.tip.pid.feedback": "base",
    }
    scene = small_scene(PLANAR, changes)
    loop, _ = build_commanded_loop(scene, ["one", "two"])
    assert loop.noise
    rollout = build_rollout(loop, duration_s=1.0, step_s=0.004, output_step_s=0.02, backend="interpreted")
    measured = rollout.run().outputs["measured_joint_rate"]
    slave = Slave(units(scene, fmi=3, is_open=True))
    names = [f"measured_joint_rate.one.joint_{i}" for i in (1, 2, 3)]
    for k in range(50):
        slave.step(0.02)
        assert np.abs(slave.get(*names) - measured[k + 1]).max() < 1e-9
    assert len(np.unique(np.round(measured[:, 0], 9))) > 15
    slave.close()


def test_a_robot_without_controllers_takes_commands_in_any_case(units):
    scene = small_scene(PLANAR, {"robots.two.tips.tip.pid": None, "robots.two.tips.tip.reference": None})
    description = fmpy.read_model_description(units(scene, fmi=3))
    inputs = {v.name: v.unit for v in description.modelVariables if v.causality == "input"}
    assert inputs == {f"commands.two.joint_{i}": "N m" for i in (1, 2, 3)}


def test_units_are_declared_of_all_numbers_that_have_one(units):
    description = fmpy.read_model_description(units(small_scene(SPATIAL, SAMPLED), fmi=3, is_open=True))
    units_of = {v.name: v.unit for v in description.modelVariables}
    assert units_of["commands.one.slide"] == "N"
    assert units_of["commands.one.slant"] == "N m"
    assert units_of["joint_position.one.slide"] == "m"
    assert units_of["joint_velocity.one.round"] == "rad/s"
    assert units_of["robots.one.joints.slant.angle_deg"] == "deg"
    degree = next(unit for unit in description.unitDefinitions if unit.name == "deg")
    assert degree.baseUnit.factor == pytest.approx(np.pi / 180)
    assert degree.baseUnit.rad == 1


def test_the_same_scene_gives_the_same_bytes_and_another_one_another_token():
    scene, other = small_scene(PLANAR), small_scene(PLANAR, {"robots.one.tips.tip.pid.kp": 31.0})
    first = build_fmu(scene, fmi=3)
    assert first == build_fmu(scene, fmi=3)
    tokens = []
    for content in (first, build_fmu(other, fmi=3)):
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}
            tokens.append(
                re.search(r'instantiationToken="({[^"]+})"', archive.read("modelDescription.xml").decode())[1]
            )
            for name in archive.namelist():
                assert b"/tmp" not in archive.read(name), name
                assert b"/home" not in archive.read(name), name
    assert tokens[0] != tokens[1]


def test_a_binary_of_the_sources_alone_gives_the_same_motion(units, tmp_path):
    """FMPy compiles them by CMake and what ``buildDescription.xml`` says."""
    pytest.importorskip("cmake")
    from fmpy.build import build_platform_binary

    file = units(small_scene(PLANAR), fmi=3)
    folder = fmpy.extract(file, unzipdir=str(tmp_path / "unit"))
    expected = fmpy.simulate_fmu(file, stop_time=1, output_interval=0.1)
    for binary in (tmp_path / "unit/binaries").rglob("*.so"):
        binary.unlink()
    build_platform_binary(folder)
    found = fmpy.simulate_fmu(folder, stop_time=1, output_interval=0.1)
    for name in expected.dtype.names:
        assert np.allclose(expected[name], found[name], rtol=0, atol=1e-9, equal_nan=True), name


def test_a_controller_that_python_updates_is_refused_unless_the_plant_is_open():
    with pytest.raises(
        ScenarioError, match=r"controllers\.\w+: the controller \(mpc\) is updated by Python.*--open"
    ):
        build_fmu(load_scene("docking-as-flown"))


def test_an_open_plant_has_the_sensors_of_controllers_that_python_updates():
    scene = _with_held_values(load_scene("docking-as-flown"))
    loop, commands = build_commanded_loop(scene, ["rpr1", "rpr2"])
    ports = find_ports(scene, loop, commands)
    outputs = {variable.name: variable for variable in ports.outputs}
    assert len(ports.inputs) == 16
    assert outputs["measured_base_position.rpr1.x"].unit == "m"
    names = {variable.name for variable in ports.parameters}
    assert "target.links.body.mass" in names
    assert not any("][" in name for name in names)  # tables of plans
    numbers = {variable.name: variable for variable in ports.parameters}
    assert numbers["robots.rpr1.sensors.joint_rate.offset"].unit == "rad/s"
    noise = numbers["robots.rpr1.sensors.joint_rate.errors.noise"]  # its unit is no product of whole powers
    assert (noise.unit, noise.text) == (
        "",
        "robots.rpr1.sensors.joint_rate.errors.noise [signal's unit s^0.5]",
    )


def test_the_command_writes_what_the_function_gives(units, tmp_path):
    scene, file = small_scene(PLANAR), tmp_path / "flat.yaml"
    text = PLANAR.replace("urdf: ", f"urdf: {folder()}/")
    file.write_text(text, encoding="utf-8")
    app.command_line()(
        ["export", "plant", str(file), "--out", str(tmp_path / "flat.fmu"), "--fmi", "2", "--open"],
        standalone_mode=False,
    )
    with (
        zipfile.ZipFile(tmp_path / "flat.fmu") as found,
        zipfile.ZipFile(units(scene, fmi=2, is_open=True)) as one,
    ):
        assert found.namelist() == one.namelist()
        name = "modelDescription.xml"
        assert len(found.read(name)) == len(one.read(name))


def test_no_compiler_is_an_error_of_one_line(interpreted):
    with pytest.raises(CompileError, match="an FMU is compiled: no C\\+\\+ compiler"):
        build_fmu(small_scene(PLANAR))


@pytest.mark.parametrize(
    ("keys", "name"),
    [
        (["robots", "one", "base", "position", 0], "robots.one.base.position[0]"),
        (["robots", "arm-2", "joints", "a.b", "offset"], "robots.'arm-2'.joints.'a.b'.offset"),
        (["switches", "2nd"], "switches.'2nd'"),
    ],
)
def test_names_are_structured(keys, name):
    assert structured(keys) == name


def test_a_name_that_no_importer_could_read_is_refused():
    with pytest.raises(SpaceRobotError, match="found the name 'größe'"):
        structured(["größe"])


def test_keys_with_dots_are_one_word():
    document = {"robots": {"one": {"joints": {"a.b": {"offset": 1.0}, "a": {"b": [1.0, 2.0]}}}}}
    assert keys_at(document, "robots.one.joints.a.b.offset") == ["robots", "one", "joints", "a.b", "offset"]


@pytest.mark.parametrize(
    ("name", "exponents", "factor"),
    [
        ("N m s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}, 1),
        ("deg/s^2", {"rad": 1, "s": -2}, np.pi / 180),
        ("1", {}, 1),
        ("W", {"kg": 1, "m": 2, "s": -3}, 1),
    ],
)
def test_units_are_powers_of_base_units(name, exponents, factor):
    definition = unit_definition(name)
    assert definition.exponents == exponents
    assert definition.factor == pytest.approx(factor)


@pytest.mark.parametrize("name", ["SI", "rad/sqrt(s)", "signal's unit", "m^-1"])
def test_what_is_no_product_of_powers_has_no_definition(name):
    assert unit_definition(name) is None
