"""First answers with an empty cache: `run` of shipped scenarios, and a gradient, as whole processes."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile

from benchmarks.process import children_s
from benchmarks.table_row import Row
from benchmarks.timing import time_of
from spacerobot.scenario.catalogue import shipped

BARE = [sys.executable, "-c", "import numpy, casadi, pinocchio"]
GRADIENT = (
    "import spacerobot as sr; "
    "sr.gradient(sr.load_scene('servicer'), 'tip_error_rms', ['target.links.body.mass'])"
)
LIMITS_S, GRADIENT_LIMIT_S = {"paper": 3.0, "docking": 3.0}, 7.0
"""Wall times that the first answer of scenarios, and of the gradient, may take on a quiet machine [s]."""


def rows() -> list[Row]:
    """One row for each shipped scenario without model predictive control, and one for a gradient."""
    bare_s = min(_cold(BARE)[0] for _ in range(3))
    table = []
    names = [name for name in shipped() if not name.endswith("as-flown")]
    for name in names:
        with tempfile.TemporaryDirectory() as out:
            run = [sys.executable, "-m", "spacerobot", "run", name, "--out", f"{out}/result"]
            table.append(_row(f"`run {name}`, nothing cached", run, bare_s, LIMITS_S.get(name)))
    gradient = [sys.executable, "-c", GRADIENT]
    return [*table, _row("`sr.gradient` of the servicer, nothing cached", gradient, bare_s, GRADIENT_LIMIT_S)]


def _row(what: str, command: list[str], bare_s: float, limit_s: float | None) -> Row:
    cpu_s, wall_s = _cold(command)
    target = "stated" if limit_s is None else f"at most {limit_s:g} s on the clock"
    return Row(
        what,
        "import numpy, casadi, pinocchio",
        f"{cpu_s:.2f} s",
        f"{bare_s:.2f} s",
        cpu_s / bare_s,
        target,
        None if limit_s is None else wall_s <= limit_s,
        note=f"processor time; {wall_s:.1f} s on the clock",
        numbers={"wall_s": wall_s},
    )


def _cold(command: list[str]) -> tuple[float, float]:
    """Processor time and wall time of a command with an empty cache [s]."""
    with tempfile.TemporaryDirectory() as cache:
        environment = {**os.environ, "SPACEROBOT_CACHE_DIR": cache}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)
        before = children_s()
        wall_s = time_of(lambda: subprocess.run(command, check=True, capture_output=True, env=environment))
        return children_s() - before, wall_s
