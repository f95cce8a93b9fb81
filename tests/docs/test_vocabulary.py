"""Documentation and help texts use the field's terms; private words stay out of them."""

import ast
import re
from pathlib import Path

import pytest
import typer

from tests.oracles.syntax_trees import parsed_modules

ROOT = Path(__file__).parents[2]
PACKAGES = ("spacerobot", "optim", "viz", "benchmarks")

PRIVATE = {
    r"the house|rooms?|front doors?": "architecture, packages, public interface",
    r"tells|told": "reports, states, prints",
    r"is asked|are asked|asked for|asks for": "required, requested, commanded",
    r"planned motions?|least cost": "trajectory optimisation, optimal cost",
    r"plan(?:ned|s)? anew|anew": "replan, again",
    r"receding": "model predictive control",
    r"what is not known": "uncertain parameters",
    r"(?<!pareto )front of two": "Pareto front of two objectives",
    r"gives? way": "reacts, moves",
    r"comes? to(?! rest)|goes on|go on": "reaches, continues",
    r"stands?": "is defined in, is located at",
    r"bases that act": "base actuation and attitude control",
    r"lets? go|slips? off|slipped off|caught": "released, breaks away, captured",
    r"second writing|second opinion": "independent implementation",
    r"verdicts?|judged?|judges|blame": "verification result, verified, cause",
    r"rivals?|contests?|currency": "baseline, benchmark problem, cost unit",
    r"beside|behind|in lanes": "in addition to, after, batched",
    r"sights": "line-of-sight constraint",
}
"""Words that the documentation does not use, with what it says instead."""

WORDS = re.compile(rf"(?<![\w`./_-])(?:{'|'.join(PRIVATE)})(?![\w`_/-])", re.IGNORECASE)
IN_STRINGS = re.compile(r"(?<![\w`./_-])(?:asks?|asked|wanted|led|lets|rooms?)(?![\w`_/-])", re.IGNORECASE)
"""More words that messages, labels, descriptions of the schema and assumptions do not use."""

CODE = re.compile(r"^```.*?^```|^    .*?$|`[^`\n]*`|(?<=\]\()[^)\s]+", re.DOTALL | re.MULTILINE)

NOT_CONVERTED: set[str] = set()
"""Pages that still use private words. The list may only become shorter."""

COMMANDS_NOT_CONVERTED = {"compare"}
"""Commands whose help still uses private words. The list may only become shorter."""

PAGES = {
    path.relative_to(ROOT).as_posix(): path
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md")))
}


def private_words(text):
    return sorted({found.lower() for found in WORDS.findall(CODE.sub("", text))})


def help_texts():
    """Help of each command: its own text, and that of its options."""
    from spacerobot.cli.app import app

    group = typer.main.get_command(app)
    return {
        name: "\n".join([command.help or "", *(getattr(p, "help", None) or "" for p in command.params)])
        for name, command in group.commands.items()
    }


@pytest.mark.parametrize("page", PAGES)
def test_pages_use_the_terms_of_the_field(page):
    found = private_words(PAGES[page].read_text(encoding="utf-8"))
    if page in NOT_CONVERTED:
        assert found, f"{page} is converted: take it off the list"
    else:
        assert not found, f"{page}: {found}; see PRIVATE for the field's terms"


def test_help_texts_use_the_terms_of_the_field():
    found = {name: words for name, text in help_texts().items() if (words := private_words(text))}
    assert set(found) <= COMMANDS_NOT_CONVERTED, found


def test_listed_pages_and_commands_exist():
    assert set(PAGES) >= NOT_CONVERTED
    assert set(help_texts()) >= COMMANDS_NOT_CONVERTED


def test_pages_are_short():
    lengths = {page: len(path.read_text(encoding="utf-8").split()) for page, path in PAGES.items()}
    long = {page: length for page, length in lengths.items() if length > 2500}
    assert set(long) <= NOT_CONVERTED, long
    assert lengths["README.md"] <= 1300


def texts_for_users(tree):
    """String literals with spaces, docstrings left out: messages, labels, descriptions, assumptions."""
    documentation = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        is_text = isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value
        if is_text and id(node) not in documentation:
            yield node


def test_texts_for_users_use_the_terms_of_the_field():
    found = [
        f"{path}:{node.lineno}: {words}"
        for path, tree in parsed_modules(*PACKAGES)
        for node in texts_for_users(tree)
        if (words := private_words(node.value) + IN_STRINGS.findall(CODE.sub("", node.value)))
    ]
    assert not found


def test_docstrings_name_their_subject():
    found = []
    for path, tree in parsed_modules(*PACKAGES):
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
                text = ast.get_docstring(node) or ""
                if text.startswith("What "):
                    found.append(f"{path}: {text.splitlines()[0]}")
    assert not found
