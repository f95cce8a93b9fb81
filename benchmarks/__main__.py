"""``python -m benchmarks [JOB...] [--keep]``: measure, print the table, write ``out/bench.json``.

With ``--keep`` the ratios are appended to ``history.jsonl`` with date, machine and commit. Ratios that are
worse than those kept for the same kind of machine are printed.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks import (
    aba,
    campaign,
    compilation,
    contact_gradient,
    ddp,
    dockings,
    events,
    filters,
    first_answers,
    history,
    methods,
    page_frames,
    plan_following,
    planning,
    process,
    recording,
    rollouts,
    sampled,
    soft_capture,
    soft_capture_receding,
    studio,
    studio_page,
    throughput,
    wheels,
)
from benchmarks.table_row import Row
from spacerobot.common.files import write_text

JOBS: dict[str, Callable[[], list[Row]]] = {
    "single": lambda: [rollouts.single()],
    "methods": methods.rows,
    "batch": rollouts.batch,
    "gradient": rollouts.gradient,
    "throughput": lambda: [throughput.row()],
    "limited": lambda: [rollouts.limited()],
    "events": events.rows,
    "sampled": sampled.rows,
    "filters": filters.rows,
    "wheels": wheels.rows,
    "follow": plan_following.rows,
    "campaign": lambda: [campaign.row()],
    "aba": aba.rows,
    "contact": contact_gradient.rows,
    "compilation": compilation.rows,
    "first": first_answers.rows,
    "process": process.rows,
    "planning": planning.rows,
    "dockings": dockings.rows,
    "reach": lambda: [ddp.measured()],
    "soft": soft_capture.row,
    "receding": soft_capture_receding.rows,
    "page": page_frames.rows,
    "recording": recording.rows,
    "studio": lambda: [*studio.rows(), *studio_page.rows()],
}


def main() -> None:
    """Measure the jobs named on the command line, or all."""
    words = [word for word in sys.argv[1:] if word != "--keep"]
    names = words or list(JOBS)
    unknown = [name for name in names if name not in JOBS]
    if unknown:
        sys.exit(f"error: no benchmark {', '.join(unknown)}; allowed: {', '.join(JOBS)}")
    console, rows = Console(width=None if sys.stdout.isatty() else 150, highlight=False), []
    for name in names:
        with Console(stderr=True).status(f"measuring {name}"):
            rows += JOBS[name]()
    table = Table(header_style="bold")
    for heading in ("what", "against", "ours", "theirs", "ratio", "target", "met", "note"):
        table.add_column(heading, overflow="fold")
    for row in rows:
        ratio = f"{row.ratio:.3g}" if row.ratio is not None else ""
        met = {True: "yes", False: "no", None: ""}[row.met]
        table.add_row(row.what, row.against, row.ours, row.theirs, ratio, row.target, met, row.note)
    console.print(table)
    machine = history.machine()
    report = {"machine": machine, "rows": [dataclasses.asdict(row) for row in rows]}
    write_text(Path("out/bench.json"), json.dumps(report, indent=2) + "\n")
    console.print("medians; each ratio within one run; also in out/bench.json")
    for line in history.regressions(rows, history.previous(machine)):
        console.print(f"worse than kept: {line}", style="yellow")
    if "--keep" in sys.argv[1:]:
        history.keep(rows, machine)


if __name__ == "__main__":
    main()
