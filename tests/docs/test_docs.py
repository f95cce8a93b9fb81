"""What the documentation shows is run, and what it names is there."""

import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "examples/README.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
FILE = re.compile(r"# ([\w-]+\.(?:yaml|py))\n")
"""First line of a block that the reader saves as a file."""


PRINTS = re.compile(r"^```python\n((?:(?!^```).*\n)*)^```\n\nIt (?:still )?prints `(.+?)`", re.MULTILINE)
"""Blocks of Python, and what the next paragraph states that they print."""

OUTPUT = re.compile(r"^```python\n((?:(?!^```).*\n)*)^```\n\n```text\n((?:(?!^```).*\n)*)^```", re.MULTILINE)
"""Blocks of Python, and their output in the block below."""

NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
ELLIPSIS = "..."
"""Line in a block of output that stands for any lines."""


def blocks(page, language):
    return re.findall(
        rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )


def files_of(page):
    """Blocks that a page asks the reader to save: their first line is a comment with the file's name."""
    for language in ("yaml", "python"):
        for source in blocks(page, language):
            if named := FILE.match(source):
                yield named[1], source


def differences(shown, printed):
    """Lines of a block of output that a program did not print, in this order, with numbers within 1 %."""
    missing, rest = [], iter(printed.splitlines())
    anywhere = False
    for line in shown.splitlines():
        if line == ELLIPSIS:
            anywhere = True
            continue
        candidates = rest if anywhere else [next(rest, "")]
        if not any(is_same_line(line, candidate) for candidate in candidates):
            missing.append(line)
        anywhere = False
    return missing


def is_same_line(shown, printed):
    values, others = ([float(x) for x in NUMBER.findall(line)] for line in (shown, printed))
    words, their_words = (" ".join(NUMBER.sub("#", line).split()) for line in (shown, printed))
    return words == their_words and values == pytest.approx(others, rel=0.01)


def deep_imports(text):
    """Imports of modules inside the packages, but for those of plugins: elements, and scenes to change."""
    found = re.findall(r"^ *(?:from|import) ((?:spacerobot|optim|viz)\.[\w.]+)", text, re.MULTILINE)
    return [name for name in found if name not in ("spacerobot.elements", "spacerobot.scene")]


def test_examples_and_pages_import_nothing_deeper_than_one_level():
    texts = {page: "\n".join(blocks(page, "python")) for page in PAGES if page.name != "CONTRIBUTING.md"}
    texts |= {file: file.read_text(encoding="utf-8") for file in (ROOT / "examples").rglob("*.py")}
    found = {str(path): deep_imports(text) for path, text in texts.items()}
    assert {path: names for path, names in found.items() if names} == {}
    for page in (ROOT / "docs" / "tutorials").glob("*.md"):
        assert "import spacerobot as sr" in texts[page], page
    assert deep_imports("from optim.tuning import tune\n    import viz.page.page") != []


@pytest.mark.parametrize(
    "page", [p for p in PAGES if blocks(p, "python")], ids=lambda p: p.relative_to(ROOT).as_posix()
)
def test_python_of_a_page_runs(page, tmp_path, monkeypatch, capsys):
    text = page.read_text(encoding="utf-8")
    stated, outputs = dict(PRINTS.findall(text)), dict(OUTPUT.findall(text))
    monkeypatch.chdir(tmp_path)
    namespace = {}
    for other in {*page.parent.glob("*.md"), page} if page.parent.name == "tutorials" else {page}:
        for file, source in files_of(other):  # a tutorial uses files of others
            (tmp_path / file).write_text(source, encoding="utf-8")
    for source in blocks(page, "python"):
        if FILE.match(source):
            continue
        with monkeypatch.context() as patch:
            if re.search(r"import gymnasium|environment\(", source):
                pytest.importorskip("gymnasium")
            if re.search(r"build_rollout|gymnasium|environment\(|sr\.(gradient|batch)\(", source):
                # its few rollouts take less time than to compile them
                patch.setenv("SPACEROBOT_COMPILER", "none")
            exec(compile(source, str(page), "exec"), namespace)
        printed = capsys.readouterr().out
        assert stated.pop(source, "") in printed
        assert differences(outputs.pop(source, ""), printed) == [], printed
    assert not stated
    assert not outputs


def test_output_that_differs_is_found():
    printed = "a\ntip 9.331 mm\nb 2\nend\n"
    assert differences("a\ntip 9.33 mm\n", printed) == []
    assert differences("...\nend\n", printed) == []
    for wrong in (
        "a\ntip 9.5 mm\n",
        "tip 9.33 mm\n",
        "...\nend\n...\na\n",
        "a\ntip 9.33 m\n",
        "a\ntip -9.33 mm\n",
    ):
        assert differences(wrong, printed) != []


def test_the_glossary_is_sorted_and_has_the_terms_of_the_field():
    rows = (ROOT / "docs" / "reference" / "glossary.md").read_text(encoding="utf-8").splitlines()
    terms = [row.split(" | ")[0].removeprefix("| ") for row in rows if row.startswith("| ")][1:]
    assert terms == sorted(terms, key=str.lower)
    text = "\n".join(terms)
    fields = ("SE(3)", "generalized Jacobian", "MEKF", "NEES", "NIS", "disk margin", "saltation", "wrench")
    assert [name for name in fields if name not in text] == []


def test_the_readmes_own_scenario_checks(tmp_path):
    from spacerobot.description.find import find_urdf
    from spacerobot.scene import load_scene

    (text,) = blocks(ROOT / "README.md", "yaml")
    servicer = find_urdf("servicer.urdf").read_text(encoding="utf-8")
    renamed = {"left_joint_2": "shoulder", "left_joint_4": "elbow", "left_tip": "gripper"}
    for old, new in renamed.items():
        servicer = servicer.replace(f'"{old}"', f'"{new}"')
    (tmp_path / "my_robot.urdf").write_text(servicer, encoding="utf-8")
    (tmp_path / "mine.yaml").write_text(text, encoding="utf-8")
    scene = load_scene(tmp_path / "mine.yaml")
    assert yaml.safe_load(text)["robots"].keys() == {"mine"}
    assert [grasp.name for grasp in scene.grasps] == ["hold"]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_files_that_a_page_names_exist(page):
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"`((?:spacerobot|optim|viz|urdf|tests|benchmarks|docs)/[\w/.]+\.\w+)`", text)
    named += [
        str((page.parent / link).relative_to(ROOT))
        for link in re.findall(r"\]\(((?!http)[\w/.-]+)(?:#[\w-]+)?\)", text)
    ]
    missing = [name for name in named if not (ROOT / name).exists()]
    assert not missing


def anchors(page):
    """Anchors of a page's headings, as the site makes them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for heading in re.findall(r"^#+ (.*)$", text, re.MULTILINE):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        yield re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", words).strip().lower())


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_headings_that_a_page_links_to_exist(page):
    """Tutorials and guides: headings of other folders are partly generated with the site."""
    missing = []
    for link, anchor in re.findall(r"\]\(((?!http)[\w/.-]*)#([\w-]+)\)", page.read_text(encoding="utf-8")):
        target = (page.parent / link).resolve() if link else page
        if target.parent.name in {"tutorials", "how_to"} and anchor not in anchors(target):
            missing.append(f"{link}#{anchor}")
    assert not missing


def test_the_papers_table_is_what_the_code_prints():
    """The first variant of each page's table against a fresh run."""
    from spacerobot.simulation import simulate
    from spacerobot.simulation.paper import VARIANTS, error_bands_mm

    variant = next(v for v in VARIANTS if v.name == "base-amnesia-R0.10")
    bands = error_bands_mm(simulate(variant.scene()).summary)
    printed = " | ".join(f"{low:.2f} .. {high:.2f}" for low, high in bands)
    assert printed in (ROOT / "docs" / "validation" / "paper.md").read_text(encoding="utf-8")
    assert printed in (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_docking_pages_scenario_is_caught_carried_and_let_go(tmp_path):
    from spacerobot.closedloop import build_closed_loop
    from spacerobot.scene import load_scene
    from tests.oracles.hybrid import roll

    (text,) = blocks(ROOT / "docs" / "tutorials" / "first_docking.md", "yaml")
    (tmp_path / "catch.yaml").write_text(text, encoding="utf-8")
    run = roll(build_closed_loop(load_scene(tmp_path / "catch.yaml")), 30.0, rtol=1e-7)
    told = [name for name in run.names if not name.endswith(("settling", "moving", "passed"))]
    carried = [
        "hand.entered",
        "hand.captured",
        "approach.captured",
        "carry.settled",
        "hand.release_commanded",
        "part.timeout",
    ]
    assert told == carried


def test_the_scenario_of_the_page_on_bases_holds_the_servicer():
    from spacerobot.scene import load_scene

    for text in blocks(ROOT / "docs" / "how_to" / "base_actuation.md", "yaml"):
        own = yaml.safe_load(text)["robots"]["servicer"]
        scene = load_scene("servicer", {f"robots.servicer.{key}": value for key, value in own.items()})
        assert any("robots.servicer.controllers.attitude" in told for told in scene.assumptions)
        assert not [told for told in scene.warnings if "nozzles" in told]
