"""Scripts and commands in a process of their own that has loaded its libraries already: a fork of this one.

What they register, load and change stays out of other tests, as in a fresh Python, which would take 1.5 s to
load everything first. Promises about starting itself are tested with fresh ones.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import textwrap
import traceback
import types
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from subprocess import CompletedProcess
from typing import IO

ROOT = Path(__file__).parents[1]


@dataclass
class Fork:
    """A process that runs."""

    pid: int
    _said: tuple[IO[str], IO[str]]
    returncode: int | None = None

    def poll(self) -> int | None:
        """Exit code, or minus the signal that ended it; None while it runs."""
        return self._wait(os.WNOHANG)

    def kill(self) -> None:
        """End it at once, unless it has ended."""
        if self.returncode is None:
            os.kill(self.pid, signal.SIGKILL)

    def wait(self) -> CompletedProcess[str]:
        """Its exit code and what it printed, once it has ended."""
        self._wait(0)
        texts = []
        for file in self._said:
            file.seek(0)
            texts.append(file.read())
            file.close()
        return CompletedProcess([], self.returncode, *texts)

    def _wait(self, options: int) -> int | None:
        if self.returncode is None:
            ended, status = os.waitpid(self.pid, options)
            if ended:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode


def start(
    work: Callable[[], object], *, folder: Path = ROOT, environment: Mapping[str, str] | None = None
) -> Fork:
    """Begin to run a function in a fork of this process.

    Args:
        work: What to run; its exceptions, ``SystemExit`` among them, end the process as they end Python's.
        folder: Its working directory.
        environment: Variables to add to this process's own.
    """
    out, err = (tempfile.TemporaryFile("w+", encoding="utf-8") for _ in range(2))  # noqa: SIM115 (till read)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # that other threads do not go along
        pid = os.fork()
    if pid:
        return Fork(pid, (out, err))
    code = 1
    try:
        for number, name, file in ((1, "stdout", out), (2, "stderr", err)):
            os.dup2(file.fileno(), number)
            setattr(sys, name, file)
        sys.stdin = Path(os.devnull).open(encoding="utf-8")  # noqa: SIM115 (it is the process's own)
        os.chdir(folder)
        os.environ.update(environment or {})
        code = _run(work)
    finally:
        with suppress(Exception):
            out.flush()
            err.flush()
        os._exit(code)
    raise AssertionError  # never reached


def _run(work: Callable[[], object]) -> int:
    try:
        work()
    except SystemExit as end:
        if isinstance(end.code, str):
            print(end.code, file=sys.stderr)
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:  # as Python ends
        traceback.print_exc()
        return 1
    return 0


def command(*words: object, folder: Path = ROOT, **environment: str) -> CompletedProcess[str]:
    """What ``spacerobot`` with these words returns and prints."""

    def work() -> None:
        from spacerobot.cli.app import main

        sys.argv = ["spacerobot", *map(str, words)]
        main()

    return start(work, folder=folder, environment=environment).wait()


def begin(script: str, *words: object) -> Fork:
    """Begin to run the text of a script with arguments."""

    def work() -> None:
        sys.argv = ["-c", *map(str, words)]
        sys.modules["__main__"] = types.ModuleType("__main__")
        code = compile(textwrap.dedent(script), "<script>", "exec", dont_inherit=True)
        exec(code, sys.modules["__main__"].__dict__)

    return start(work)


def run(script: str, *words: object) -> CompletedProcess[str]:
    """What a script with arguments returns and prints."""
    return begin(script, *words).wait()
