"""No compiler goes on when the process that started it ends, whichever thread started it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

BESIDE = """
import pathlib, signal, sys, threading, time
from spacerobot.compiled.build import SourceUnit, build
from spacerobot.compiled.toolchain import Toolchain
from spacerobot.common.interrupts import minded

folder = pathlib.Path(sys.argv[1])
compiler = folder / "compiler"
compiler.write_text(f"#!/bin/sh\\nsleep 1000 &\\necho $$ $! > {folder}/started\\nwait\\n")
compiler.chmod(0o700)
tools = Toolchain((str(compiler),), "", (), (), "", 2, {})
with minded():
    threading.Thread(target=build, args=([SourceUnit("")], tools, folder), daemon=True).start()
    while not (folder / "started").exists() or not (folder / "started").read_text().strip():
        time.sleep(0.01)
    print("compiling", flush=True)
    exec(sys.argv[2])
"""

MAIN_THREAD = {
    "ends by itself": "pass",
    "is interrupted": "time.sleep(1000)",
    "hears nothing": "signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT]); time.sleep(1000)",
}


def runs(process: int) -> bool:
    """Whether a process does something, other than waiting for someone to take note of its end."""
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc to look at")
@pytest.mark.parametrize("code", MAIN_THREAD.values(), ids=MAIN_THREAD)
def test_compilers_of_other_threads_end_with_the_process(code, tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", BESIDE, str(tmp_path), code],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "compiling\n"
    started = [int(word) for word in (tmp_path / "started").read_text().split()]
    if code != "pass":
        process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    until = time.monotonic() + 10
    while any(map(runs, started)) and time.monotonic() < until:
        time.sleep(0.01)
    left = [number for number in started if runs(number)]
    for number in left:
        os.kill(number, signal.SIGKILL)
    assert not left
    assert not list(tmp_path.glob("build-*"))
