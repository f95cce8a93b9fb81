"""Compile time of the servicer's closed loop and adjoint, in compilations of a fixed C++ file."""

from __future__ import annotations

import os
import resource
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import casadi as ca

from benchmarks.table_row import Row
from spacerobot.closedloop import build_closed_loop
from spacerobot.compiled import find_toolchain
from spacerobot.rollout import Measures, Signals, build_rollout, integral
from spacerobot.scene import load_scene

REFERENCE = '#include <regex>\nbool f(const char* s) { return std::regex_match(s, std::regex("a+b")); }\n'


def rows() -> list[Row]:
    """One row for the loop that `run` compiles, one for the loop with a cost and its adjoint."""
    toolchain = find_toolchain()
    if toolchain is None:
        return [Row("compilation of the servicer", "a fixed C++ file", "", note="not measured: no compiler")]
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "reference.cpp"
        source.write_text(REFERENCE, encoding="utf-8")
        command = [*toolchain.command, *toolchain.flags, "-c", "-o", f"{folder}/reference.o", str(source)]
        reference_s = min(_time_of(lambda: subprocess.run(command, check=True))[0] for _ in range(3))
        before = os.environ.get("SPACEROBOT_CACHE_DIR")
        os.environ["SPACEROBOT_CACHE_DIR"] = folder
        try:
            loop = build_closed_loop(load_scene("servicer"))
            signals = Signals.of(loop)
            squared = {"squared": integral(ca.sumsqr(signals["tip_error"]))}
            measures = Measures(signals, squared, costs=lambda r, _: {"cost": r["squared"]})
            gains = tuple(path for path in loop.parameter_paths if path.endswith(".kp"))

            def gradient() -> None:
                rollout = build_rollout(loop, duration_s=0.01, step_s=0.005, measures=measures)
                rollout.value_and_gradient(wrt=gains, accuracy=False)

            jobs = {
                "what `run servicer` compiles": lambda: build_rollout(loop, duration_s=0.01, step_s=0.005),
                "the servicer's loop with a cost, and its adjoint": gradient,
            }
            table = []
            for what, job in jobs.items():
                cpu_s, wall_s = _time_of(job)
                table.append(
                    Row(
                        what,
                        "a fixed C++ file of 2 lines over <regex>",
                        f"{cpu_s:.1f} s",
                        f"{reference_s:.2f} s",
                        cpu_s / reference_s,
                        note=f"processor time of the compilers; {wall_s:.1f} s on the clock",
                        numbers={"wall_s": wall_s},
                    )
                )
            return table
        finally:
            os.environ.pop("SPACEROBOT_CACHE_DIR")
            if before is not None:
                os.environ["SPACEROBOT_CACHE_DIR"] = before


def _time_of(job: Callable[[], object]) -> tuple[float, float]:
    """Processor time of a job's child processes that have ended, and wall time of the job [s]."""

    def children_s() -> float:
        usage = resource.getrusage(resource.RUSAGE_CHILDREN)
        return usage.ru_utime + usage.ru_stime

    begin, used = time.perf_counter(), children_s()
    job()
    return children_s() - used, time.perf_counter() - begin
