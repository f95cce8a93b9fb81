"""What is printed can be read in a narrow terminal: lines break between words, numbers stay whole."""

from __future__ import annotations

from rich.console import Console

from spacerobot.cli import output


def printed(monkeypatch, width, act):
    made = Console(width=width, record=True, highlight=False)
    monkeypatch.setattr(output, "console", lambda: made)
    act(made)
    return made.export_text().rstrip().splitlines()


def test_prose_breaks_between_words_and_indents(monkeypatch):
    text = "robots.rpr2.base: placed at (1.8042, 0.0000, 0.0000) m so that grasp 'right' closes [m]"
    lines = printed(monkeypatch, 40, lambda _: output.prose(text, indent=2))
    assert all(len(line) <= 40 for line in lines)
    assert " ".join(line.strip() for line in lines) == text
    assert [line[: len(line) - len(line.lstrip())] for line in lines] == ["  ", "    ", "    "]


def test_whole_cells_keep_their_lines_and_the_first_column_gives_way(monkeypatch):
    rows = [["largest tip error, rpr1/tip x [mm]", "1.65\n(1.56..1.71)", "2.02\n(1.91..)"]]
    made = output.table(None, ("", "50 %", "95 %"), rows, whole=True)
    lines = printed(monkeypatch, 44, lambda console: console.print(made))
    assert any("(1.56..1.71)" in line and "(1.91..)" in line for line in lines)
