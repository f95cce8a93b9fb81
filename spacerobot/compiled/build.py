"""Parallel compilation of several C++ sources into one shared library."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from spacerobot.common.errors import CompileError
from spacerobot.common.interrupts import at_end, uninterrupted
from spacerobot.compiled.toolchain import PROCESS_GROUP, SUFFIX, Toolchain, end_process

TIMEOUT_S = 900.0
"""Time after which a compiler is ended [s]; ``SPACEROBOT_COMPILE_TIMEOUT`` replaces it."""

LOOK_S = 0.005
"""Interval at which running compilers are polled [s]."""

Progress = Callable[[int, int], None]
"""Callback that receives the number of finished sources and the number of all sources."""


@dataclass(frozen=True)
class SourceUnit:
    """A C++ source of a library.

    Attributes:
        text: C++ code.
        cold: Whether the code runs seldom, so that compilation time matters more than speed.
    """

    text: str
    cold: bool = False


def build(
    units: Sequence[SourceUnit], toolchain: Toolchain, folder: Path, progress: Progress | None = None
) -> Path:
    """Compile and link sources into a shared library.

    One compiler runs on each usable core. Each compiler has its own process group, which is ended when the
    compiler exceeds the time limit, when another one fails, at Ctrl-C, and when this process ends.

    Args:
        units: Sources, those that take longest first.
        toolchain: Compiler and its options.
        folder: Folder of the library. A temporary folder inside it holds the intermediate files, so that the
            library can be moved atomically.
        progress: Callback after each finished source.

    Returns:
        Path: File of the library, with a temporary name in ``folder``.

    Raises:
        CompileError: The compiler rejects a source, or exceeds the time limit.
        OSError: No compiler could be started, or nothing can be written.
    """
    with tempfile.TemporaryDirectory(prefix="build-", dir=folder) as work:
        objects, commands = [], []
        for k, unit in enumerate(units):
            source, target = Path(work) / f"unit_{k}.cpp", Path(work) / f"unit_{k}.o"
            source.write_text(unit.text, encoding="utf-8")
            flags = toolchain.cold_flags if unit.cold else toolchain.flags
            commands.append([*toolchain.command, *flags, "-c", "-o", str(target), str(source)])
            objects.append(str(target))
        environment = {**os.environ, "TMPDIR": work, "TEMP": work, "TMP": work}
        if toolchain.is_zig:
            environment |= {"ZIG_LOCAL_CACHE_DIR": work, "ZIG_GLOBAL_CACHE_DIR": str(folder / "zig")}
        report = progress or (lambda _done, _total: None)
        _run_all(toolchain.name, commands, environment, report)
        built = Path(work) / f"generated{SUFFIX}"
        link = [*toolchain.command, "-shared", "-o", str(built), *objects, *toolchain.libraries]
        _run_all(toolchain.name, [link], environment, lambda _done, _total: None)
        if not built.exists():
            raise CompileError(f"{toolchain.name} made no library")
        handle, place = tempfile.mkstemp(prefix="built-", suffix=".tmp", dir=folder)
        os.close(handle)
        return built.replace(place)


def usable_cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def timeout_s() -> float:
    """Time limit of one compiler [s].

    Raises:
        CompileError: ``SPACEROBOT_COMPILE_TIMEOUT`` is not a positive number.
    """
    wish = os.environ.get("SPACEROBOT_COMPILE_TIMEOUT", "").strip()
    try:
        limit = float(wish or TIMEOUT_S)
    except ValueError:
        limit = 0.0
    if not limit > 0:
        raise CompileError(f"SPACEROBOT_COMPILE_TIMEOUT is '{wish}', allowed: a positive number of seconds")
    return limit


class _Running:
    """Compilers that this process has started and that are still running.

    When the process ends, its daemon threads, such as those of the studio, stop without running their
    ``finally`` clauses. Their compilers, which have process groups of their own, would keep running.
    """

    def __init__(self) -> None:
        self._jobs, self._lock, self._closed = set[_Job](), threading.Lock(), False
        at_end(self.close)

    def start(self, name: str, command: Sequence[str], log: Path, environment: dict[str, str]) -> _Job:
        """Start a compiler.

        Raises:
            CompileError: This process is ending.
        """
        with self._lock:
            if self._closed:
                raise CompileError("not compiled: the process is ending")
            job = _Job(name, command, log, environment)
            self._jobs.add(job)
        return job

    def end(self, job: _Job) -> None:
        """End a compiler that is still running."""
        with self._lock:
            job.end()
            self._jobs.discard(job)

    def close(self) -> None:
        """End all compilers, remove their folders, and refuse to start further ones."""
        with self._lock:
            self._closed = True
            for job in self._jobs:
                job.end()
                shutil.rmtree(job.log.parent, ignore_errors=True)


class _Job:
    """A running compiler."""

    def __init__(self, name: str, command: Sequence[str], log: Path, environment: dict[str, str]) -> None:
        self.begin, self.log, self.name = time.monotonic(), log, name
        with log.open("wb") as output:
            self.process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                env=environment,
                process_group=PROCESS_GROUP,
            )

    def is_done(self, limit_s: float) -> bool:
        """Whether the compiler has ended with exit code 0.

        Raises:
            CompileError: It ended with another exit code, or exceeds the time limit.
        """
        code = self.process.poll()
        if code is None and time.monotonic() - self.begin > limit_s:
            raise CompileError(
                f"{self.name} was ended after {limit_s:g} s; SPACEROBOT_COMPILE_TIMEOUT allows more"
            )
        if code:
            lines = self.log.read_text(encoding="utf-8", errors="replace").splitlines()
            message = next((line for line in lines if "error" in line), " ".join(lines)[:300])
            raise CompileError(f"{self.name} failed with {code}: {message}")
        return code == 0

    def end(self) -> None:
        """End the compiler and its child processes, if it is still running."""
        end_process(self.process)


RUNNING = _Running()


def _run_all(
    name: str, commands: Sequence[Sequence[str]], environment: dict[str, str], report: Progress
) -> None:
    """Run commands, at most one on each core; all have ended when this function returns or raises."""
    work = Path(environment["TMPDIR"])
    limit_s, waiting, started, done = timeout_s(), list(enumerate(commands)), list[_Job](), 0
    cores = usable_cores()
    report(done, len(commands))
    try:
        while waiting or started:
            while waiting and len(started) < cores:
                k, command = waiting.pop(0)
                # Ctrl-C between the start of a compiler and its record would leave it running
                with uninterrupted():
                    started.append(RUNNING.start(name, command, work / f"log_{k}.txt", environment))
            ended = [job for job in started if job.is_done(limit_s)]
            for job in ended:
                started.remove(job)
                RUNNING.end(job)
                done += 1
                report(done, len(commands))
            if not ended:
                time.sleep(LOOK_S)
    finally:
        for job in started:
            RUNNING.end(job)
