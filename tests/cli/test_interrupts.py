"""Ctrl-C ends a command with one line and exit code 130, wherever it comes."""

import contextlib
import os
import signal
import subprocess
import sys
import time
import tomllib
from pathlib import Path

import pytest

from spacerobot.cli.app import main
from spacerobot.cli.interrupts import heed, remembered
from spacerobot.result import Result

ROOT = Path(__file__).parents[2]


def test_an_interrupt_that_was_swallowed_is_heeded_later():
    with remembered():
        heed()
        with contextlib.suppress(BaseException):  # as a library in C does
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            heed()
    heed()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_job_that_ignores_interrupts_goes_on_doing_so():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with remembered():
            signal.raise_signal(signal.SIGINT)
            heed()
    finally:
        signal.signal(signal.SIGINT, before)


def run(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["spacerobot", *map(str, arguments)])
    with pytest.raises(SystemExit) as left:
        main()
    return left.value.code


def test_an_interrupt_lost_while_simulating_still_ends_the_run(monkeypatch, capsys, tmp_path):
    import spacerobot.simulation as job

    simulate = job.simulate

    def swallowing(scene, **options) -> Result:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return simulate(scene, backend="interpreted")

    monkeypatch.setattr(job, "simulate", swallowing)
    short = ("--set", "simulation.duration=0.02", "--set", "simulation.step=0.02")
    assert run(monkeypatch, "run", "paper", *short, "--out", tmp_path / "r") == 130
    assert capsys.readouterr().err == "error: interrupted\n"
    assert not (tmp_path / "r").exists()


@pytest.mark.skipif(os.name == "nt", reason="no SIGINT for processes there")
def test_a_process_that_is_interrupted_says_so_and_leaves_nothing(tmp_path):
    code = "import sys; from spacerobot.cli.app import main; sys.argv = ['spacerobot', *sys.argv[1:]]; main()"
    long = ("--set", "simulation.engine=pinocchio", "--set", "simulation.duration=1000")
    process = subprocess.Popen(
        [sys.executable, "-c", code, "run", "paper", *long, "--out", str(tmp_path / "r")],
        cwd=ROOT,
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(3.0)
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
    assert loaded <= {"spacerobot", "__future__"}


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
