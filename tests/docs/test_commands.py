"""Commands that the README, the tutorials and ``--help`` show, as they are written there.

Options of every command are valid, its scenario loads with its ``--set`` and ``--plugin``, and a file or
folder that it reads ships, is a block of the page, or is written by an earlier command of the page. Cheap
commands run, in an empty folder. :data:`NOT_RUN` lists the others, and the tests that run the same.
"""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from spacerobot.cli.app import command_line, plugins_first
from tests import forks
from tests.docs.test_docs import ROOT, files_of

TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
SHOWN = re.compile(r"^ {4}spacerobot (.+)$", re.MULTILINE)
NOT_RUN = {
    "studio": "serves until Ctrl-C: tests/viz/studio",
    "plan": "solves for seconds to minutes: tests/optim/planning",
    "tune": "tests/optim/methods",
    "sweep": "tests/optim/methods",
    "campaign": "tests/optim/campaign",
    "robust": "tests/optim/robust",
    "compare": "tests/optim/comparison",
    "falsify": "tests/optim/reliability",
    "reliability": "tests/optim/reliability",
    "margins": "tests/cli/test_margins_command.py",
    "animate": "serves until Ctrl-C: tests/viz",
    "export": "tests/exports",
    "figures": "tests/viz/figures",
    "report": "tests/viz",
    "identify": "tests/optim/test_identification.py",
    "orbit": "tests/scenario/test_orbit_states.py",
    "passive-safety": "tests/result/test_passive_safety.py",
    "paper": "simulates all variants: tests/docs/test_docs.py",
    "run": "simulations: each scenario by tests/closedloop, tests/missions and tests/examples",
}
"""Why commands are not run, and which tests run them."""
PLACE = re.compile(r"tests/[\w/.]+")
CHEAP = ("check", "kinds", "make-arm", "new", "scenarios", "schema")
"""Commands that run; drafts without their simulation."""
SHORT = (
    "run paper --set 'robots.*.tips.tip.pid.kp=400' --out out/paper",
    "report out/paper",
    "export out/paper paper.csv",
    "run caught-unknown --out out/caught",
    "identify out/caught",
    "run mine.yaml --out out/mine",
    "run arm.yaml --plugin eight.py --set 'robots.mine.tips.tip.reference={kind: eight, duration: 3}'",
)
"""Simulations that take a few seconds, which run too."""
YOURS = {"my.yaml", "mine.yaml", "suite"}
"""Scenarios of the reader in examples of ``--help``: their options alone are checked."""


def commands(text: str) -> list[list[str]]:
    """Words behind ``spacerobot`` of each command of a page, without comments."""
    return [shlex.split(line, comments=True) for line in SHOWN.findall(text)]


def examples_of_help() -> list[list[str]]:
    """The same of the docstrings of all commands: an example is an indented paragraph."""
    found = []
    for command in command_line().commands.values():
        for part in [command, *getattr(command, "commands", {}).values()]:
            source = getattr(part.callback, "__wrapped__", part.callback)
            paragraphs = (source.__doc__ or "").split("\n\n")
            lines = [" ".join(paragraph.split()) for paragraph in paragraphs]
            found += [shlex.split(line)[1:] for line in lines if line.startswith("spacerobot ")]
    return found


def parsed(words: list[str]) -> tuple[str, dict[str, object], list[str]]:
    """Command, its parameters and its plugins; a usage error is raised."""
    rest, plugins, line = plugins_first(words), [], command_line()
    while rest[0] == "--plugin":
        plugins.append(rest[1])
        rest = rest[2:]
    command, name = line.commands[rest[0]], rest[0]
    while hasattr(command, "commands"):  # a group
        command, rest = command.commands[rest[1]], rest[1:]
    return name, command.make_context(rest[0], rest[1:]).params, plugins


def written(words: list[str]) -> str | None:
    """File or folder that a command writes."""
    return words[words.index("--out") + 1] if "--out" in words else None


def succeed(words: list[str], folder: Path) -> None:
    """Run a command; a draft is not simulated."""
    drafts = words[0] == "new" and "--plugin" not in words
    options = ["--no-simulate"] if drafts else []
    result = forks.command(*words, *options, folder=folder, SPACEROBOT_COMPILER="none", COLUMNS="100")
    assert result.returncode == 0, f"spacerobot {shlex.join(words)}\n{result.stdout}{result.stderr}"


def reserve(file: Path) -> None:
    """Write an empty file in place of a scenario that a command which is not run would have written."""
    if file.suffix == ".yaml" and not file.exists():
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()


LOADS = """
import sys
import spacerobot as sr
from spacerobot.cli.options import parse_changes
from spacerobot.elements import load_plugin

plugin, scenario, *changes = sys.argv[1:]
if plugin:
    load_plugin(plugin)
sr.load_scene(scenario, parse_changes(changes))
"""


def loads(words: list[str], folder: Path) -> None:
    """Load the scenario of a command with its plugin and its changes."""
    _, params, plugins = parsed(words)
    scenario = str(params["scenario"])
    if not plugins and not params.get("changes") and not scenario.endswith(".yaml"):
        return  # a scenario that ships, as it is: other tests load all of them
    scenario = str(folder / scenario) if scenario.endswith(".yaml") else scenario
    plugin = str(folder / plugins[0]) if plugins else ""
    result = forks.run(LOADS, plugin, scenario, *(params.get("changes") or ()))
    assert result.returncode == 0, f"spacerobot {shlex.join(words)}\n{result.stderr}"


@pytest.mark.parametrize("page", [ROOT / "README.md", *TUTORIALS], ids=lambda page: page.stem)
def test_commands_of_a_page(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")  # README: commands of a checkout
    for source_page in TUTORIALS if page in TUTORIALS else ():  # a tutorial uses files of others
        for file, source in files_of(source_page):
            (tmp_path / file).write_text(source, encoding="utf-8")
    made = set()
    for words in commands(page.read_text(encoding="utf-8")):
        shown = f"{page.name}: spacerobot {shlex.join(words)}"
        for place in (word for word in words if word.startswith("out/") and word != written(words)):
            assert "/".join(Path(place).parts[:2]) in made, f"{shown}: nothing wrote {place}"
            reserve(tmp_path / place)
        name, params, _ = parsed(words)  # its scenario exists
        if name in CHEAP or shlex.join(words) in SHORT:
            succeed([word for word in words if word != "--view"], tmp_path)
        else:
            assert name in NOT_RUN, shown
        if "scenario" in params and not str(params["scenario"]).startswith("out/"):
            loads(words, tmp_path)
        made.add(written(words))


@pytest.mark.parametrize("words", examples_of_help(), ids=shlex.join)
def test_examples_of_help(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for place in (word for word in words[1:] if word in YOURS or word.endswith("/followed.yaml")):
        if place != written(words):
            reserve(tmp_path / place)
    name, params, _ = parsed(words)
    scenario = str(params.get("scenario", ""))
    if name in CHEAP and scenario not in YOURS:
        succeed(words, tmp_path)
    else:
        assert name in NOT_RUN or scenario in YOURS
        if scenario and scenario not in YOURS and not scenario.startswith("out/"):
            loads(words, tmp_path)


def test_every_command_is_run_or_has_a_reason():
    assert sorted({*CHEAP, *NOT_RUN}) == sorted(command_line().commands)
    places = [place for reason in NOT_RUN.values() for place in PLACE.findall(reason)]
    assert [place for place in places if not (ROOT / place).exists()] == []
    with pytest.raises(Exception, match="No such option"):
        parsed(["run", "paper", "--sett", "a=1"])
