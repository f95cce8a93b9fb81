"""Printed progress: every stage, and a stage at most once a second."""

import spacerobot as sr
from spacerobot.common import progress


def test_a_stage_is_printed_at_most_once_a_second(monkeypatch, capsys):
    times = iter([10.0, 10.1, 10.9, 11.0, 11.1, 11.2, 11.3])
    monkeypatch.setattr(progress.time, "monotonic", lambda: next(times))
    monkeypatch.setattr(progress, "_last_printed", {"stage": "", "time_s": 0.0})
    for text in (
        "solve, step 1",
        "solve, step 2",
        "solve, step 3",
        "solve, step 4",
        "replay",
        "replay",
        "solve, step 5",
    ):
        sr.print_progress(text)
    assert capsys.readouterr().out.splitlines() == [
        "solve, step 1",
        "solve, step 4",
        "replay",
        "solve, step 5",
    ]
