"""The notebooks run from top to bottom, and print what is kept in them."""

import json
from pathlib import Path

import pytest

NOTEBOOKS = sorted((Path(__file__).parents[2] / "examples" / "notebooks").glob("*.ipynb"))


def test_notebooks_are_here_and_small():
    assert len(NOTEBOOKS) >= 2
    assert max(path.stat().st_size for path in NOTEBOOKS) < 20_000


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_prints_what_it_holds(path, capsys):
    names: dict[str, object] = {}
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            exec(compile("".join(cell["source"]), path.name, "exec"), names)
            kept = "".join("".join(output["text"]) for output in cell["outputs"])
            assert capsys.readouterr().out == kept
