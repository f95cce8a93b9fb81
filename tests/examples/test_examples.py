"""The numbered examples, each run as a user runs it, but small."""

import re
import runpy
from pathlib import Path

import pytest
from PIL import Image

from tests import forks
from tests.examples.recording import draw_square_frames

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
INDEX = EXAMPLES / "README.md"

# Small sizes of each example, and what it must print.
SMALL = {
    "01_first_steps": ({"duration_s": 0.5}, "peak error of rpr1/tip"),
    "02_own_robot": ({"duration_s": 0.5}, "completed"),
    "03_change_and_compare": ({"duration_s": 0.5}, " 180 kg: peak tip error"),
    "04_gradients": ({"duration_s": 0.1, "backend": "interpreted"}, "target.links.body.mass: exact"),
    "05_tune": ({"duration_s": 0.2}, ", ge "),
    "06_campaign": ({"samples": 8, "changes": {"simulation.duration": 0.5}}, "worst sample"),
    "07_own_element": ({"duration_s": 0.2, "backend": "interpreted"}, "soft.stiffness"),
    "08_where_is_it_captured": ({"samples": 12}, "tuned"),
    "09_least_disturbance": ({"duration_s": 0.2, "names": ["reaction null space, base"]}, " mm"),
    "10_capture_in_one_plan": (
        {"scenario": EXAMPLES / "catch.yaml", "changes": {}},
        "grip     captured at 5.1",
    ),
    "11_servicing_mission": (
        {"verify": False, "samples": 2, "planned": False, "changes": {"simulation.duration": 0.5}},
        "probability of failure",
    ),
}
OWN = "07_own_element"


def test_every_example_is_here_and_short():
    files = sorted(EXAMPLES.glob("*.py"))
    assert [file.stem for file in files] == list(SMALL)
    assert max(len(file.read_text(encoding="utf-8").splitlines()) for file in files) <= 80


@pytest.mark.parametrize("name", [name for name in SMALL if name != OWN])
def test_an_example_runs_and_draws(name, tmp_path, monkeypatch, capsys):
    draw_square_frames(monkeypatch)
    sizes, printed = SMALL[name]
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"](**sizes)
    out = capsys.readouterr().out
    assert printed in out
    *_, folder, names = re.match(r"files in (.*): (.*)", out.splitlines()[-1]).group(0, 1, 2)
    assert set(names.split(", ")) == {path.name for path in (tmp_path / folder).iterdir()}
    assert list(tmp_path.rglob("*.gif"))
    assert list(tmp_path.rglob("*.png"))


def test_an_example_with_elements_of_its_own_runs(tmp_path):
    """In a process of its own, so that its kinds stay out of other tests."""
    name = OWN
    sizes, printed = SMALL[name]
    run = lambda: runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"](**sizes)  # noqa: E731
    done = forks.start(run, folder=tmp_path).wait()
    assert done.returncode == 0, done.stderr
    assert printed in done.stdout
    assert done.stdout.splitlines()[-1] == "files in out/examples/own_element: figures, film.gif"


def test_every_example_has_a_picture_in_the_index_that_loads_quickly():
    rows = [line for line in INDEX.read_text(encoding="utf-8").splitlines() if line.startswith("|")]
    for name in (*SMALL, *(file.stem for file in (EXAMPLES / "notebooks").glob("*.ipynb"))):
        (row,) = [row for row in rows if f"{name}.py](" in row or f"{name}.ipynb](" in row]
        pictures = [EXAMPLES / link for link in re.findall(r"!\[[^]]+\]\(([^)]+)\)", row)]
        assert any(picture.suffix == ".gif" for picture in pictures), name
        assert max(picture.stat().st_size for picture in pictures) < 400e3, name
        for picture in pictures:
            with Image.open(picture) as image:
                assert picture.suffix != ".gif" or image.n_frames > 5
