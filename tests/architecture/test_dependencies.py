"""Each room knows only the rooms behind it, and nobody knows the command line."""

import ast
import functools
import re
import runpy
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

from tests.oracles.syntax_trees import parsed

ROOT = Path(__file__).parents[2]

EVERYWHERE = {"common"}
"""What every room of the library may import."""

KNOWS = {
    "spacerobot.common": set(),
    "spacerobot.dynamics": set(),
    "spacerobot.symbolic": {"dynamics"},
    "spacerobot.shapes": {"dynamics"},
    "spacerobot.samplers": set(),
    "spacerobot.description": set(),
    "spacerobot.compiled": set(),
    "spacerobot.rollout": {"compiled", "symbolic"},
    "spacerobot.quantities": {"rollout"},
    "spacerobot.elements": {"description", "dynamics", "quantities", "shapes", "symbolic"},
    "spacerobot.scenario": {"samplers", "elements", "quantities"},
    "spacerobot.scene": {"elements", "scenario", "description", "shapes"},
    "spacerobot.closedloop": {"compiled", "elements", "symbolic", "scenario", "scene", "dynamics", "shapes"},
    "spacerobot.pinocchio_engine": {
        "compiled",
        "dynamics",
        "symbolic",
        "shapes",
        "elements",
        "scenario",
        "scene",
        "closedloop",
        "rollout",
    },
    "spacerobot.result": {"elements", "scenario", "scene", "closedloop", "rollout"},
    "spacerobot.updates": {
        "elements",
        "compiled",
        "scenario",
        "scene",
        "closedloop",
        "pinocchio_engine",
        "rollout",
    },
    "spacerobot.flightcode": {"closedloop", "elements", "rollout", "scenario", "scene", "updates"},
    "spacerobot.simulation": {
        "closedloop",
        "flightcode",
        "pinocchio_engine",
        "result",
        "rollout",
        "scene",
        "updates",
    },
    "spacerobot.linear": {"closedloop", "elements", "rollout", "scene", "simulation"},
    "spacerobot.drafting": {
        "closedloop",
        "description",
        "linear",
        "result",
        "scenario",
        "scene",
        "simulation",
    },
    "spacerobot.fmu": {
        "closedloop",
        "compiled",
        "dynamics",
        "rollout",
        "scenario",
        "scene",
        "simulation",
        "updates",
    },
}
"""What each room of the library may import, the command line aside."""

ON_TOP = (
    "spacerobot.api",
    "spacerobot.basilisk",
    "spacerobot.exports",
    "spacerobot.learning",
    "spacerobot.cli",
)
"""Packages that join the library with what is built on it, imported where it is used."""

ELEMENTS = {
    "core": set(),
    "shapes": {"core"},
    "sensors": {"core"},
    "flexible": {"core"},
    "grasps": {"core"},
    "contacts": {"core", "shapes"},
    "estimators": {"core", "sensors"},
    "references": {"core", "grasps"},
    "environments": {"core", "references"},
    "actuators": {"core", "references"},
    "controllers": {"core", "references", "sensors"},
    "goals": {"core", "references", "shapes"},
    "limits": {"core", "goals", "shapes"},
}
"""Packages of elements that each of them may import."""

BUILT_ON = {
    "optim.json_files": set(),
    "optim.workers": set(),
    "optim.problem": {"optim.workers"},
    "optim.evaluation": {"optim.problem"},
    "optim.torch": {"optim.evaluation"},
    "optim.search": {"optim.problem", "optim.workers"},
    "optim.methods": {"optim.problem", "optim.search", "optim.workers"},
    "optim.planning": set(),
    "optim.planning.formulation": set(),
    "optim.planning.solver": set(),
    "optim.planning.transcription": {"optim.planning.formulation", "optim.planning.solver"},
    "optim.planning.verification": {
        "optim.problem",
        "optim.planning.formulation",
        "optim.planning.solver",
        "optim.planning.transcription",
    },
    "optim.planning.search": {
        "optim.json_files",
        "optim.problem",
        "optim.workers",
        "optim.planning.formulation",
        "optim.planning.solver",
        "optim.planning.transcription",
        "optim.planning.verification",
    },
    "optim.planning.studies": {
        "optim.problem",
        "optim.planning.formulation",
        "optim.planning.solver",
        "optim.planning.transcription",
        "optim.planning.search",
    },
    "optim.planning.output": {
        "optim.json_files",
        "optim.problem",
        "optim.planning.formulation",
        "optim.planning.transcription",
        "optim.planning.verification",
        "optim.planning.search",
        "optim.planning.studies",
    },
    "optim.planning.mpc": {
        "optim.planning.formulation",
        "optim.planning.solver",
        "optim.planning.transcription",
        "optim.planning.verification",
        "optim.planning.search",
        "optim.problem",
    },
    "optim.identification": {"optim.json_files"},
    "optim.reliability": {
        "optim.json_files",
        "optim.problem",
        "optim.search",
        "optim.methods",
        "optim.evaluation",
        "optim.campaign.sampling",
    },
    "optim.tuning": {"optim.json_files", "optim.problem", "optim.search", "optim.methods", "optim.workers"},
    "optim.campaign.sampling": {"optim.problem"},
    "optim.campaign.rollouts": {"optim.problem", "optim.campaign.sampling"},
    "optim.campaign.store": {"optim.campaign.rollouts"},
    "optim.campaign.analysis": {
        "optim.problem",
        "optim.campaign.sampling",
        "optim.campaign.rollouts",
        "optim.campaign.store",
    },
    "optim.campaign": {
        "optim.problem",
        "optim.workers",
        "optim.campaign.rollouts",
        "optim.campaign.store",
        "optim.campaign.analysis",
    },
    "optim.robust": {
        "optim.json_files",
        "optim.problem",
        "optim.search",
        "optim.methods",
        "optim.workers",
        "optim.campaign.sampling",
        "optim.campaign.analysis",
    },
    "optim.comparison": {
        "optim.json_files",
        "optim.problem",
        "optim.search",
        "optim.methods",
        "optim.workers",
        "optim.robust",
    },
    "viz.drawing": set(),
    "viz.figure_formats": set(),
    "viz.figures": {"viz.figure_formats", "viz.drawing", "optim.campaign"},
    "viz.page": {"viz.drawing", "viz.figures"},
    "viz.recording": {"viz.drawing", "viz.figures", "viz.page"},
    "viz.studio": {
        "viz.drawing",
        "viz.page",
        "viz.recording",
        "optim.problem",
        "optim.search",
        "optim.methods",
        "optim.campaign.sampling",
        "optim.campaign.rollouts",
        "optim.planning.output",
        "optim.planning.search",
    },
    "viz.report": {
        "viz.page",
        "viz.figures",
        "viz.recording",
        "optim.campaign",
        "optim.campaign.analysis",
        "optim.comparison",
        "optim.evaluation",
        "optim.planning.output",
        "optim.problem",
        "optim.tuning",
    },
}
"""What each room of tuning and of pictures may import beside the library."""


def nodes(path):
    """Every node of a file, those for type checkers included: a reader follows them as well."""
    return ast.walk(parsed(path))


def imports(path):
    """Modules that a file imports, at any depth."""
    for node in nodes(path):
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


def modules():
    """Path of each module by its dotted name."""
    paths = [path for top in ("spacerobot", "optim", "viz") for path in files(top)]
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in paths
    }


@functools.cache
def edges():
    """Modules that each module imports, at any depth."""
    found = {}
    for module, path in MODULES.items():
        found[module] = set()
        for node in nodes(path):
            if isinstance(node, ast.Import):
                found[module] |= {alias.name for alias in node.names} & MODULES.keys()
            elif isinstance(node, ast.ImportFrom):
                inside = {f"{node.module}.{alias.name}" for alias in node.names} & MODULES.keys()
                found[module] |= inside or {node.module} & MODULES.keys()
    return found


MODULES = modules()


@pytest.mark.parametrize("room", KNOWS)
def test_a_room_knows_only_the_rooms_behind_it(room):
    own = room.split(".")[1]
    for path in files(room):
        for module in imports(path):
            top, _, rest = module.partition(".")
            assert top not in ("optim", "viz", "tests", "benchmarks"), f"{path}: {module}"
            if top == "spacerobot" and rest:
                assert rest.split(".")[0] in KNOWS[room] | EVERYWHERE | {own}, f"{path}: {module}"


@pytest.mark.parametrize("family", ELEMENTS)
def test_families_of_elements_import_only_those_below_them(family):
    home = f"spacerobot.elements.{family}"
    for path in files(home):
        for module in imports(path):
            package = re.match(r"spacerobot\.elements\.(\w+)", module)
            assert package is None or package[1] in ELEMENTS[family] | {family}, f"{path}: {module}"
    tuple(TopologicalSorter(ELEMENTS).static_order())


def test_every_family_of_elements_is_listed():
    assert {path.parent.name for path in (ROOT / "spacerobot/elements").glob("*/__init__.py")} == set(
        ELEMENTS
    )


def room_of(module):
    """The listed room that a module of ``optim`` or ``viz`` stands in."""
    parts = module.split(".")
    heads = (".".join(parts[:k]) for k in range(len(parts), 1, -1))
    return next(head for head in heads if head in BUILT_ON)


@pytest.mark.parametrize("package", ["optim", "viz"])
def test_a_room_of_tuning_or_pictures_knows_only_the_rooms_behind_it(package):
    for module, path in MODULES.items():
        if module.startswith(f"{package}."):
            room = room_of(module)
            for known in edges()[module]:
                if known.partition(".")[0] in ("optim", "viz"):
                    assert room_of(known) in BUILT_ON[room] | {room}, f"{path}: {known}"


def test_no_room_knows_itself_by_way_of_others():
    tuple(TopologicalSorter(BUILT_ON).static_order())
    tuple(TopologicalSorter(KNOWS).static_order())


def test_no_module_knows_itself_by_way_of_others():
    """The front doors aside, which load nothing before a name is used."""
    doors = {"spacerobot", "optim", "viz"}
    tuple(
        TopologicalSorter({m: known - doors for m, known in edges().items() if m not in doors}).static_order()
    )


def test_every_room_of_the_library_is_listed():
    here = {
        f"spacerobot.{p.stem}"
        for p in (ROOT / "spacerobot").iterdir()
        if p.suffix == ".py" or (p / "__init__.py").exists()
    }
    on_top = {"spacerobot.__init__", "spacerobot.__main__", *ON_TOP}
    assert here - on_top == set(KNOWS)


def test_every_room_stands_in_the_documentation():
    told = runpy.run_path(str(ROOT / "docs" / "reference_pages.py"))["packages"]()
    rooms = [room.replace(".", "/") for room in (*KNOWS, *ON_TOP, *BUILT_ON)]
    assert [room for room in rooms if not re.search(rf"`{room}`: [A-Z`]", told)] == []


@pytest.mark.parametrize("package", ["optim", "viz", *ON_TOP])
def test_nothing_that_ships_knows_tests_and_benchmarks(package):
    for path in files(package):
        assert not any(module.partition(".")[0] in ("tests", "benchmarks") for module in imports(path)), path


def test_tuning_knows_nothing_of_pictures():
    for path in files("optim"):
        assert not any(module.partition(".")[0] == "viz" for module in imports(path)), path


def test_commands_import_what_is_built_on_the_library_only_when_they_need_it():
    for path in [path for package in ON_TOP for path in files(package)]:
        for node in parsed(path).body:
            if isinstance(node, ast.Import | ast.ImportFrom):
                names = [node.module] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names]
                assert not any(name.partition(".")[0] in ("optim", "viz") for name in names), path


@pytest.mark.parametrize("package", ["optim", "viz"])
def test_nobody_but_the_command_line_prints_or_knows_it(package):
    rooms = [path for room in (*KNOWS, "spacerobot.exports") for path in files(room)] + files(package)
    for path in rooms:
        if path.name == "__main__.py" or path.match("spacerobot/common/progress.py"):  # `print_progress`
            continue
        assert not any(module.startswith("spacerobot.cli") for module in imports(path)), path
        calls = (n for n in ast.walk(parsed(path)) if isinstance(n, ast.Call))
        assert not any(isinstance(c.func, ast.Name) and c.func.id == "print" for c in calls), path


LONGEST_FUNCTION, LONGEST_MODULE, MOST_PARAMETERS = 120, 700, 6


def functions(path):
    for node in ast.walk(parsed(path)):
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


def parameters(node):
    """How many parameters a function takes, the object or class that it belongs to aside."""
    every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return len(every) - (bool(every) and every[0].arg in ("self", "cls"))


def test_functions_take_few_parameters():
    """Commands aside, whose parameters are the command line's options."""
    many = set()
    for path in everything():
        place = path.relative_to(ROOT).as_posix()
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                command = place.startswith("spacerobot/cli/") and (
                    node.name == "command" or node.decorator_list
                )
                if parameters(node) > MOST_PARAMETERS and not command:
                    many.add(f"{place}: {node.name}")
    assert many == set()


def test_modules_stay_short():
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in everything()}
    assert [path for path, lines in lengths.items() if lines > LONGEST_MODULE] == []
