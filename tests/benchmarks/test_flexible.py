"""The page on flexible links: its frequencies are what the script finds, and within 1e-3 of Exudyn's."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks import flexible

PAGE = Path(__file__).parents[2] / "docs" / "validation" / "flexible.md"


def rows():
    """Frequencies of ours and of Exudyn [Hz] by beam and model."""
    found = {}
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if len(cells) == 6 and cells[0] in ("clamped", "on a free hub"):
            numbers = (" ".join(cells[2:4]).split(), cells[4].replace(",", " ").split())
            found[tuple(cells[:2])] = tuple(np.array(values, dtype=float) for values in numbers)
    return found


@pytest.mark.parametrize(
    ("base", "title", "name", "section"),
    [
        ("fixed", "clamped", "beam, 4 segments", flexible.beam(4)),
        ("planar", "on a free hub", "beam, 4 segments", flexible.beam(4)),
        ("planar", "on a free hub", "modes, 4", flexible.clamped_modes(4)),
    ],
)
def test_the_page_states_what_the_script_finds(base, title, name, section):
    np.testing.assert_allclose(flexible.ours(base, section), rows()[title, name][0], atol=5e-6)


def test_exudyn_agrees():
    found = rows()
    for key in (("clamped", "beam, 32 segments"), ("on a free hub", "beam, 32 segments")):
        np.testing.assert_allclose(*found[key], rtol=1e-3)
    np.testing.assert_allclose(*found["on a free hub", "modes, 2"], rtol=1e-3)
