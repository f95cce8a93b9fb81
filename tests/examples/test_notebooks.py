"""The notebooks run from top to bottom, print what is kept in them and draw the figures kept in them."""

import ast
import base64
import io
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.examples.recording import draw_square_frames

FOLDER = Path(__file__).parents[2] / "examples" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))


def test_notebooks_are_here_and_small():
    assert len(NOTEBOOKS) >= 3
    assert max(path.stat().st_size for path in NOTEBOOKS) < 600_000


def shown(source: str, name: str, names: dict[str, object]) -> object:
    """Run a cell; the value of its last line if that is an expression."""
    tree = ast.parse(source, name)
    last = ast.Expression(tree.body.pop().value) if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, name, "exec"), names)
    return None if last is None else eval(compile(last, name, "eval"), names)


def grey(picture: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(picture)).convert("L")).astype(float)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_shows_what_it_holds(path, tmp_path, monkeypatch, capsys):
    """Texts are the same; figures too, up to small differences of fonts."""
    draw_square_frames(monkeypatch)
    for file in (file for file in FOLDER.parent.iterdir() if file.suffix in (".yaml", ".urdf", ".npz")):
        shutil.copy(file, tmp_path)
    place = tmp_path / FOLDER.name
    place.mkdir()
    monkeypatch.chdir(place)
    names: dict[str, object] = {}
    pictures = 0
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    for cell in cells:
        if cell["cell_type"] != "code":
            continue
        value = shown("".join(cell["source"]), path.name, names)
        texts = [out["text"] for out in cell["outputs"] if out["output_type"] == "stream"]
        assert capsys.readouterr().out == "".join("".join(text) for text in texts)
        for out in cell["outputs"]:
            if out["output_type"] == "execute_result":
                stored, drawn = grey(base64.b64decode(out["data"]["image/png"])), grey(value._repr_png_())
                assert stored.shape == drawn.shape
                assert np.abs(stored - drawn).mean() < 2
                pictures += 1
    assert pictures
    # the film that the last cell writes is shown, with as many frames
    text = "".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    (film,) = re.findall(r"\]\(([^)]+\.gif)\)", text)
    with Image.open(FOLDER / film) as stored, Image.open(place / "film.gif") as drawn:
        assert (stored.size, stored.n_frames) == (drawn.size, drawn.n_frames)
