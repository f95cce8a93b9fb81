"""Ctrl-C ends a command with one line and exit code 130, wherever it comes."""

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

from spacerobot.cli.app import main
from spacerobot.common import interrupts
from spacerobot.common.interrupts import keep, minded, uninterrupted
from spacerobot.result import Result

ROOT = Path(__file__).parents[2]


def test_an_interrupt_that_was_swallowed_ends_the_block():
    with pytest.raises(KeyboardInterrupt), minded(), contextlib.suppress(BaseException):  # as a library does
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_interrupt_that_a_library_renames_stays_one():
    with pytest.raises(KeyboardInterrupt), minded():  # noqa: PT012 (the block itself is what is tested)
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ImportError("failed") from None


def test_what_was_swallowed_begins_no_writing():
    with pytest.raises(KeyboardInterrupt), minded():  # noqa: PT012 (the block itself is what is tested)
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with uninterrupted():
            pytest.fail("begun")


def test_a_search_that_keeps_what_it_found_is_stopped_alone():
    with minded():
        keep()
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        keep(False)
        with uninterrupted():
            pass


def test_a_second_interrupt_ends_the_search_too():
    with pytest.raises(KeyboardInterrupt), minded():  # noqa: PT012 (the block itself is what is tested)
        keep()
        for _ in range(2):
            with contextlib.suppress(KeyboardInterrupt):
                signal.raise_signal(signal.SIGINT)


def test_a_job_that_ignores_interrupts_goes_on_doing_so():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with minded():
            signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)


IN_A_LIBRARY = """
import os, signal, threading, time
from spacerobot.common.interrupts import minded
with minded():
    threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
    {}
"""
DEAF = (
    "signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT]); time.sleep(1000)",
    "while True:\n        try: signal.pause()\n        except BaseException: pass",
)


@pytest.mark.skipif(os.name == "nt", reason="no SIGINT for processes there")
@pytest.mark.parametrize("code", DEAF)
def test_a_library_that_hears_nothing_is_ended(code):
    command = [sys.executable, "-c", IN_A_LIBRARY.format(code)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "error: interrupted\n")


@pytest.mark.skipif(os.name == "nt", reason="no SIGINT for processes there")
def test_a_command_is_ended_wherever_the_interrupt_comes(tmp_path):
    """While it loads libraries, builds, and prints; at random times of a fixed seed."""
    drawn, ended, delay = random.Random(1), [], 0.6
    command = [sys.executable, "-m", "spacerobot", "check", "servicer"]
    interrupted, not_begun = ("error: interrupted\n", 130), ("", -signal.SIGINT)
    while ended.count(interrupted) < 3 and len(ended) < 16:
        process = subprocess.Popen(
            command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        time.sleep(delay * drawn.uniform(0.5, 2.0))
        process.send_signal(signal.SIGINT)
        ended.append((process.communicate()[1], process.returncode))
        # a process that has not begun when it comes, or has ended, is none of ours: it depends on the load
        delay *= {not_begun: 2.0, ("", 0): 0.5}.get(ended[-1], 1.0)
    assert set(ended) <= {interrupted, ("", 0), not_begun}
    assert interrupted in ended


def run(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["spacerobot", *map(str, arguments)])
    with pytest.raises(SystemExit) as left:
        main()
    return left.value.code


def test_an_interrupt_lost_while_simulating_still_ends_the_run(monkeypatch, capsys, tmp_path):
    import spacerobot.api.functions as job

    simulate = job.simulate

    def swallowing(scene, **options) -> Result:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return simulate(scene, backend="interpreted")

    monkeypatch.setattr(job, "simulate", swallowing)
    monkeypatch.setattr(interrupts, "GRACE_S", 1e6)  # the process is that of the tests
    short = ("--set", "simulation.duration=0.02", "--set", "simulation.step=0.02")
    assert run(monkeypatch, "run", "paper", *short, "--out", tmp_path / "r") == 130
    assert capsys.readouterr().err == "error: interrupted\n"
    assert not (tmp_path / "r").exists()


@pytest.mark.parametrize("place", ["load", "search", "swallowed", "twice", "written"])
@pytest.mark.parametrize("kept", [False, True], ids=["without a folder", "with a folder"])
def test_an_interrupted_plan_ends_in_the_same_line_wherever_it_is(kept, place, monkeypatch, capsys, tmp_path):
    """One error line and exit code 130; with a folder it says how to resume, once the scene is loaded."""
    import optim.planning.search.make_plan as planning
    import spacerobot.scene as scenes
    from spacerobot.api.results import PlanResult

    def interrupting(*_, **__):
        signal.raise_signal(signal.SIGINT)

    def swallowing(*_, progress, **__):
        progress("mesh of 10 intervals")
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        progress("mesh of 20 intervals")

    def twice(*_, progress, **__):
        progress("mesh of 10 intervals")
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(interrupts, "GRACE_S", 1e6)  # the process is that of the tests
    target, name, replacement = {
        "load": (scenes, "load_scene", interrupting),
        "search": (planning, "make_plan", interrupting),
        "swallowed": (planning, "make_plan", swallowing),
        "twice": (planning, "make_plan", twice),
        "written": (PlanResult, "of", lambda *_: SimpleNamespace(save=interrupting)),
    }[place]
    if place == "written":
        monkeypatch.setattr(planning, "make_plan", lambda *_, **__: None)
        monkeypatch.setattr("spacerobot.cli.commands.plan.show", interrupting)
    monkeypatch.setattr(target, name, replacement)
    folder = ("--out", tmp_path / "plan") if kept else ()
    assert run(monkeypatch, "plan", "docking", *folder) == 130
    advice = ": the same command resumes the search" if kept and place != "load" else ""
    assert capsys.readouterr() == ("", f"error: interrupted{advice}\n")


REPORTING = """
import sys
import spacerobot.api.functions as job
from spacerobot.cli.app import main

def reporting(*arguments, own=job.simulate, **options):
    print("simulating", flush=True)
    return own(*arguments, **options)

job.simulate = reporting
sys.argv = ["spacerobot", *sys.argv[1:]]
main()
"""


@pytest.mark.skipif(os.name == "nt", reason="no SIGINT for processes there")
def test_a_process_that_is_interrupted_says_so_and_leaves_nothing(tmp_path):
    long = ("--set", "simulation.engine=pinocchio", "--set", "simulation.duration=1000")
    process = subprocess.Popen(
        [sys.executable, "-c", REPORTING, "run", "paper", *long, "--out", str(tmp_path / "r")],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "simulating\n"
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=60)[1] == "error: interrupted\n"
    assert process.returncode == 130
    assert list(tmp_path.iterdir()) == []


WHILE_LOADING = """
import signal, sys

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            signal.raise_signal(signal.SIGINT)

sys.meta_path.insert(0, Interrupting())
from spacerobot.cli.start import main
main()
"""


def test_an_interrupt_while_libraries_load_is_told_in_one_line():
    command = [sys.executable, "-c", WHILE_LOADING]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "error: interrupted\n")


def test_the_command_begins_where_interrupts_are_minded():
    """Before it there is nothing to load but the package's own empty rooms."""
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"]
    assert scripts == {"spacerobot": "spacerobot.cli.start:main"}
    code = (
        "import sys; before = set(sys.modules); import spacerobot.cli.start; print(set(sys.modules) - before)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    loaded = {name.partition(".")[0] for name in eval(done.stdout)}
    assert loaded <= {"spacerobot", *sys.stdlib_module_names}


@pytest.mark.skipif(os.name == "nt", reason="no pipes of that kind there")
def test_a_reader_that_leaves_is_no_fault():
    code = (
        "import sys; from spacerobot.cli.app import main; sys.argv = ['spacerobot', 'check', 'paper']; main()"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    process.stdout.close()
    assert process.stderr.read() == ""
    assert process.wait(timeout=60) == 0
