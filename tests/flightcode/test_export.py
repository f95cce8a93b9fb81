"""Flight code of scenarios: no warnings, the same bits on two processors, refused in one line."""

import re
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import yaml

import spacerobot as sr
from spacerobot.cli import app
from spacerobot.common.errors import ScenarioError, SpaceRobotError
from spacerobot.flightcode.c_functions import count_operations
from spacerobot.flightcode.c_text import identifier
from spacerobot.flightcode.evaluation import evaluate_rows, library_bounds
from spacerobot.flightcode.onboard import common_tick
from spacerobot.flightcode.package import LIBRARY, write_package
from spacerobot.flightcode.vectors import record_vectors
from tests.flightcode.conftest import FLOWN, QUICK, STEPS, software_of

SMALL = "examples/as-flown.yaml"


def compiled(compiler, folder, sources, *more):
    target = folder / f"built-{len(more)}"
    subprocess.run([compiler, *QUICK, *more, *sources, "-o", target, "-lm"], cwd=folder, check=True)
    return target


def report(*command, folder):
    done = subprocess.run(list(map(str, command)), cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return {line.split()[0]: [float(word) for word in line.split()[1:4]] for line in done.stdout.splitlines()}


@pytest.mark.compiler
@pytest.mark.parametrize("name", [SMALL, *FLOWN])
def test_functions_agree_with_their_vectors_here_and_on_another_processor(export, program, name):
    _, software, folder = export(name, FLOWN.get(name, ()))
    text = (folder / "README.md").read_text(encoding="utf-8")
    assert re.search(r"export 0 of \d+ values differed", text), "bit for bit on this computer"
    cross, emulator = program("aarch64-linux-gnu-gcc"), program("qemu-aarch64")
    sources = ["test_vectors.c", f"{software.name}_functions.c"]
    target = compiled(cross, folder, sources, "-static")
    measured = report(emulator, target, "vectors", folder=folder)
    assert set(measured) == {task.name for task in software.functions}
    for task in software.functions:
        values, differing, _ = measured[task.name]
        assert values == STEPS * sum(one.size for one in task.writes)
        if not count_operations(task.function).libm:
            assert differing == 0


def test_a_new_export_without_a_compiler_leaves_no_library_of_an_earlier_one(tmp_path, monkeypatch):
    monkeypatch.setenv("SPACEROBOT_COMPILER", "none")
    (tmp_path / LIBRARY).write_bytes(b"of an earlier export")
    write_package(software_of(sr.load_scene(SMALL)), tmp_path, "double", 2)
    assert not (tmp_path / LIBRARY).exists()
    assert "no C compiler" in (tmp_path / "README.md").read_text(encoding="utf-8")


@pytest.mark.compiler
def test_a_wrong_vector_is_noticed(export, compiler):
    _, software, folder = export(SMALL)
    target = compiled(compiler, folder, ["test_vectors.c", f"{software.name}_functions.c"])
    path = folder / "vectors" / "output.bin"
    content = path.read_bytes()
    path.write_bytes(content[:-9] + bytes([content[-9] ^ 1]) + content[-8:])  # a bound of 8 bytes is last
    try:
        done = subprocess.run([target, "vectors"], cwd=folder, capture_output=True, text=True, check=False)
    finally:
        path.write_bytes(content)
    assert done.returncode == 1
    assert "output: DIFFERS" in done.stderr


@pytest.mark.compiler
def test_the_misra_addon_finds_nothing_in_flown_sources_and_elsewhere_what_the_readme_explains(
    export, program
):
    _, software, folder = export(SMALL)
    bench = ["test_vectors.c", "processor_in_the_loop.c"]
    sources = [f"{software.name}.c", f"{software.name}_functions.c", *bench]
    command = [program("cppcheck"), "--std=c99", "--addon=misra", "--quiet", *sources]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    places = re.findall(r"^([\w.]+):\d+:.*\[misra-c2012-([\d.]+)\]$", done.stderr, re.MULTILINE)
    assert len(places) > 10
    assert not {file for file, _ in places if file.startswith(software.name)}
    table = (folder / "README.md").read_text(encoding="utf-8").partition("| rule |")[2]
    explained = {
        rule for row in re.findall(r"^\| ([\d., ]+) \|", table, re.MULTILINE) for rule in row.split(", ")
    }
    assert {rule for _, rule in places} <= explained


@pytest.mark.compiler
def test_cmake_builds_and_tests_it(export, program, tmp_path):
    _, _, folder = export(SMALL)
    cmake = program("cmake")
    subprocess.run([cmake, "-S", folder, "-B", tmp_path], check=True, capture_output=True)
    subprocess.run([cmake, "--build", tmp_path], check=True, capture_output=True)
    subprocess.run([tmp_path / "test_vectors", folder / "vectors"], check=True, capture_output=True)
    assert (folder / "libcontroller.so").is_file()


@pytest.mark.compiler
def test_floats_agree_with_floats(compiler, tmp_path):
    sr.export(SMALL, tmp_path / "code", "controller", precision="float", steps=50)
    text = (tmp_path / "code" / "README.md").read_text(encoding="utf-8")
    assert "type `float`" in text


def test_another_mathematical_library_keeps_within_the_bounds():
    """NumPy's functions differ from those of C by some units; all else agrees to the bit."""
    software = software_of(sr.load_scene(SMALL))
    for one in record_vectors(software, 40, 1, "double"):
        again = evaluate_rows(one.task.function, one.arguments, np.float64)
        largest = np.abs(one.results).max(axis=1, initial=1e-300)
        differences = np.abs(again - one.results).max(axis=1) / (np.finfo(float).eps * largest)
        assert (differences <= one.bounds).all()
        assert (one.bounds < 1000).all()
        assert bool(count_operations(one.task.function).libm) == one.bounds.any()


def test_the_bound_is_the_condition_of_a_function():
    """One rounding, and 4 times 2 units of the cosine, in roundings of a difference that cancels."""
    angle = ca.SX.sym("a")
    function = ca.Function("f", [angle], [ca.cos(angle) - 1])
    angles = np.array([[0.01], [1.5]])
    cosines = np.cos(angles[:, 0])
    bounds = library_bounds(function, angles, np.float64)
    np.testing.assert_allclose(bounds, 1 + 8 * cosines / (1 - cosines), rtol=1e-6)
    products = ca.Function("g", [angle], [angle * angle])
    assert not library_bounds(products, angles, np.float64).any()


def test_vectors_depend_on_nothing_but_the_seed():
    software = software_of(sr.load_scene(SMALL))
    first, second = (record_vectors(software, 20, 1, "double") for _ in range(2))
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.results, other.results)
    other = record_vectors(software, 20, 2, "double")
    assert not np.array_equal(first[0].results, other[0].results)


def test_the_header_states_units_frames_and_rates(export):
    _, _, folder = export(SMALL)
    text = next(folder.glob("as_flown.h")).read_text(encoding="utf-8")
    assert "joint_rate[3]; /* rates of joints [rad/s or m/s]; joint axes; every 0.02 s */" in text
    assert "mesh" not in text


@pytest.mark.parametrize(
    ("changes", "where", "words"),
    [
        (
            {"robots.arm.tips.tip.pid.sampled": None},
            "robots.arm.tips.tip.pid",
            "found a continuous controller",
        ),
        ({"simulation.engine": "pinocchio"}, "simulation.engine", "found pinocchio"),
    ],
)
def test_what_cannot_be_exported_is_named_in_one_line(changes, where, words, tmp_path):
    scene = sr.load_scene(SMALL, changes)
    with pytest.raises(ScenarioError, match=words) as error:
        sr.export(scene, tmp_path / "code", "controller")
    assert error.value.where == where
    assert "\n" not in str(error.value)
    assert not (tmp_path / "code").exists()


def test_a_controller_in_python_is_refused(tmp_path):
    with pytest.raises(ScenarioError, match="Python function") as error:
        sr.export(_python_scene(tmp_path), tmp_path / "code", "controller")
    assert error.value.where == "robots.arm.controllers.mine"


def _python_scene(tmp_path):
    plugin = tmp_path / "mine.py"
    plugin.write_text(PLUGIN, encoding="utf-8")
    sr.load_plugin(plugin)
    changes = {"robots.arm.controllers.mine": {"kind": "flight_test_python"}}
    return sr.load_scene(SMALL, changes)


PLUGIN = '''
"""A controller in Python."""
from typing import Literal
import numpy as np
import spacerobot as sr
from spacerobot.elements import PythonController

@sr.register
class FlightTestPython(PythonController):
    "No torque."
    kind: Literal["flight_test_python"] = "flight_test_python"

    def update(self, t, measurements):
        return np.zeros(3)
'''


def test_a_scenario_without_periodic_laws_is_refused(tmp_path):
    scene = sr.load_scene("drift")
    with pytest.raises(ScenarioError, match="no controller or estimator with sample instants"):
        sr.export(scene, tmp_path / "code", "controller")


@pytest.mark.parametrize(
    ("times", "tick"), [([0.01, 0.002, 0.1], "1/500"), ([0.25, 0.1], "1/20"), ([1 / 30, 0.1], "1/30")]
)
def test_the_tick_is_the_largest_common_divisor(times, tick):
    assert str(common_tick(times)) == tick


def test_periods_without_a_common_divisor_are_refused():
    with pytest.raises(ValueError, match="whole numbers"):
        common_tick([0.01, 2**0.5])


@pytest.mark.compiler
def test_names_of_joints_do_not_break_the_sources(compiler, tmp_path):
    """Names of URDF elements are free text; ``-Wall`` refuses comments within comments and trigraphs."""
    joint = "a/*b*/ ??/"
    urdf = Path("urdf/short_arm.urdf").read_text(encoding="utf-8")
    (tmp_path / "arm.urdf").write_text(urdf.replace('"joint_1"', f'"{joint}"'), encoding="utf-8")
    document = yaml.safe_load(Path(SMALL).read_text(encoding="utf-8"))
    document = {key: value for key, value in document.items() if key not in ("tuning", "campaign")}
    arm = document["robots"]["arm"]
    arm["urdf"] = "arm.urdf"
    arm["joints"][joint] = arm["joints"].pop("joint_1")
    (tmp_path / "hostile.yaml").write_text(yaml.safe_dump(document), encoding="utf-8")
    sr.export(tmp_path / "hostile.yaml", tmp_path / "code", "controller", steps=2)
    assert "a/ *b* / ? ?/" in (tmp_path / "code" / "as_flown.h").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("path", "name"),
    [("a-b.C", "a_b_c_2"), ("double", "double_2"), ("3d", "n3d"), ("机械", "n"), ("copy", "copy_2")],
)
def test_identifiers_are_free_names_of_c(path, name):
    assert identifier(path, {"a_b_c", "copy"}) == name


@pytest.mark.compiler
def test_the_command_line_writes_the_folder(compiler, tmp_path):
    words = ["export", "controller", SMALL, "--out", str(tmp_path / "code"), "--steps", "5"]
    app.command_line()(words, standalone_mode=False)
    assert (tmp_path / "code" / "as_flown.c").is_file()


def test_a_format_without_out_is_named():
    with pytest.raises(SpaceRobotError, match="found the format 'controller' without --out"):
        app.command_line()(["export", "controller", SMALL], standalone_mode=False)
