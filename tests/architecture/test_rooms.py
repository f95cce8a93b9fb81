"""Each room knows only the rooms behind it, and nobody knows the command line."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

KNOWS = {
    "spacerobot.errors": set(),
    "spacerobot.interrupts": set(),
    "spacerobot.files": {"errors"},
    "spacerobot.front_door": set(),
    "spacerobot.section": {"errors"},
    "spacerobot.dynamics": {"errors"},
    "spacerobot.symbolic": {"dynamics"},
    "spacerobot.shapes": {"dynamics"},
    "spacerobot.elements": {"errors", "section", "dynamics", "shapes", "symbolic"},
    "spacerobot.scenario": {"errors", "section", "elements", "shapes"},
    "spacerobot.description": {"errors"},
    "spacerobot.scene": {"errors", "section", "elements", "scenario", "description", "shapes"},
    "spacerobot.closedloop": {
        *("errors", "section", "elements", "symbolic", "scenario", "scene", "dynamics", "shapes"),
    },
    "spacerobot.compiled": {"errors"},
    "spacerobot.rollout": {"errors", "compiled"},
    "spacerobot.kept": {"closedloop", "compiled", "elements", "scenario", "scene"},
    "spacerobot.pinocchio_engine": {"errors", "elements", "scenario", "scene", "rollout"},
    "spacerobot.result": {"errors", "files", "interrupts", "scenario", "scene", "closedloop", "rollout"},
    "spacerobot.simulation": {
        *("errors", "closedloop", "kept", "pinocchio_engine", "result", "rollout", "scene"),
    },
    "spacerobot.paper": {"result", "scene", "simulation"},
}
"""What each room of the library may import, the command line aside."""


def imports(path):
    """Modules that a file imports, at any depth."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.module, f"{path}: relative import"
            assert not node.level, f"{path}: relative import"
            # `from spacerobot import x` names a room, or a name of the package itself
            yield from (
                (f"spacerobot.{a.name}" for a in node.names) if node.module == "spacerobot" else [node.module]
            )


def files(room):
    place = ROOT / room.replace(".", "/")
    found = sorted(place.rglob("*.py")) if place.is_dir() else [place.with_suffix(".py")]
    assert found
    return found


@pytest.mark.parametrize("room", KNOWS)
def test_a_room_knows_only_the_rooms_behind_it(room):
    own = room.split(".")[1]
    for path in files(room):
        for module in imports(path):
            top, _, rest = module.partition(".")
            assert top not in ("optim", "viz", "tests", "benchmarks"), f"{path}: {module}"
            if top == "spacerobot" and rest:
                assert rest.split(".")[0] in KNOWS[room] | {own}, f"{path}: {module}"


def test_every_room_of_the_library_is_listed():
    here = {
        f"spacerobot.{p.stem}"
        for p in (ROOT / "spacerobot").iterdir()
        if p.suffix == ".py" or (p / "__init__.py").exists()
    }
    assert here - {"spacerobot.__init__", "spacerobot.__main__", "spacerobot.cli"} == set(KNOWS)


@pytest.mark.parametrize("package", ["optim", "viz", "spacerobot.cli"])
def test_nothing_that_ships_knows_tests_and_benchmarks(package):
    for path in files(package):
        assert not any(module.partition(".")[0] in ("tests", "benchmarks") for module in imports(path)), path


def test_tuning_knows_nothing_of_pictures():
    for path in files("optim"):
        assert not any(module.partition(".")[0] == "viz" for module in imports(path)), path


def test_commands_import_what_is_built_on_the_library_only_when_they_need_it():
    for path in files("spacerobot.cli"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = [node.module] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names]
                assert not any(name.partition(".")[0] in ("optim", "viz") for name in names), path


@pytest.mark.parametrize("package", ["optim", "viz"])
def test_nobody_but_the_command_line_prints_or_knows_it(package):
    rooms = [path for room in KNOWS for path in files(room)] + files(package)
    for path in rooms:
        if path.name in ("__main__.py", "readme_picture.py"):
            continue
        assert not any(module.startswith("spacerobot.cli") for module in imports(path)), path
        calls = (n for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.Call))
        assert not any(isinstance(c.func, ast.Name) and c.func.id == "print" for c in calls), path


LONGEST_FUNCTION, LONGEST_MODULE = 60, 400


def functions(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            first = min([node.lineno, *(decorator.lineno for decorator in node.decorator_list)])
            yield node.name, node.end_lineno - first + 1


def everything():
    return [path for top in ("spacerobot", "optim", "viz", "benchmarks") for path in files(top)]


def test_functions_fit_on_a_screen():
    long = {
        f"{path.relative_to(ROOT).as_posix()}: {name}"
        for path in everything()
        for name, lines in functions(path)
        if lines > LONGEST_FUNCTION
    }
    assert long == set()


def test_modules_stay_short():
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in everything()}
    assert [path for path, lines in lengths.items() if lines > LONGEST_MODULE] == []
