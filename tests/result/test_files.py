"""Files and folders that several processes and Ctrl-C may disturb."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from spacerobot.errors import ResultError
from spacerobot.files import locked, write_text
from spacerobot.interrupts import uninterrupted

ROOT = Path(__file__).parents[2]


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_ctrl_c_waits_for_the_end_of_the_block():
    done = []
    with pytest.raises(KeyboardInterrupt):  # noqa: PT012 (the block itself is what is tested)
        with uninterrupted():
            signal.raise_signal(signal.SIGINT)
            done.append("first")
        done.append("never")
    assert done == ["first"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_another_thread_is_not_touched():
    before = signal.getsignal(signal.SIGINT)

    def work():
        with uninterrupted():
            assert signal.getsignal(signal.SIGINT) is before
        done.append(True)

    done = []
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert done


def test_an_interrupted_write_leaves_nothing(tmp_path, monkeypatch):
    (tmp_path / "page.html").write_text("before")

    def interrupted(self, target):
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_text(tmp_path / "page.html", "after")
    assert names(tmp_path) == ["page.html"]
    assert (tmp_path / "page.html").read_text() == "before"


def test_a_file_system_that_is_full_is_told_by_name(tmp_path, monkeypatch):
    def full(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(ResultError, match=r"page\.html: cannot be written: No space left"):
        write_text(tmp_path / "page.html", "x")
    assert names(tmp_path) == []


@pytest.mark.skipif(os.name == "nt", reason="no locks on folders there")
@pytest.mark.parametrize(("shared", "waits"), [(False, True), (True, False)])
def test_a_locked_folder_is_waited_for_by_other_processes(tmp_path, shared, waits):
    code = (
        "import sys; from pathlib import Path; from spacerobot.files import locked\n"
        f"with locked(Path(sys.argv[1]), shared={shared}): print('in')"
    )
    with locked(tmp_path, shared=True):
        other = subprocess.Popen(
            [sys.executable, "-c", code, str(tmp_path)], cwd=ROOT, stdout=subprocess.PIPE, text=True
        )
        if waits:
            with pytest.raises(subprocess.TimeoutExpired):
                other.wait(timeout=1.0)
        else:
            assert other.wait(timeout=30) == 0
    assert other.communicate(timeout=30)[0] == "in\n"
