"""Files and folders that several processes and Ctrl-C may disturb."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from spacerobot.common.errors import ResultError
from spacerobot.common.files import locked, staged, write_text
from spacerobot.common.interrupts import uninterrupted

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
        "import sys; from pathlib import Path; from spacerobot.common.files import locked\n"
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


KILLED = """
import os, signal, sys
from pathlib import Path
from spacerobot.common.files import staged
with staged(Path(sys.argv[1])) as stage:
    (stage / "page.html").write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(os.name == "nt", reason="no locks on folders there")
def test_what_a_killed_writer_left_goes_with_the_next_one(tmp_path):
    subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], cwd=ROOT, check=False)
    assert len(names(tmp_path)) == 1
    with staged(tmp_path) as mine:
        write_text(tmp_path / "page.html", "whole")  # another writer, beside one who is not done
        assert names(tmp_path) == [mine.name, "page.html"]
    assert names(tmp_path) == ["page.html"]


def test_a_link_stays_and_what_it_names_is_written(tmp_path):
    (tmp_path / "link.html").symlink_to("real/page.html")
    write_text(tmp_path / "link.html", "text")
    assert (tmp_path / "link.html").is_symlink()
    assert (tmp_path / "real" / "page.html").read_text() == "text"


@pytest.mark.skipif(os.name == "nt", reason="no devices among files there")
def test_a_device_takes_the_bytes_and_stays(tmp_path):
    if not Path("/dev/full").exists():
        pytest.skip("no such device here")
    for name in ("full", "null"):
        (tmp_path / name).symlink_to(f"/dev/{name}")
    write_text(tmp_path / "null", "text")
    with pytest.raises(ResultError, match="cannot be written: No space left on device"):
        write_text(tmp_path / "full", "text")
    os.mkfifo(tmp_path / "pipe")
    reader = threading.Thread(target=lambda: read.append((tmp_path / "pipe").read_text()))
    read: list[str] = []
    reader.start()
    write_text(tmp_path / "pipe", "text")
    reader.join()
    assert read == ["text"]
    assert names(tmp_path) == ["full", "null", "pipe"]


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="no such names of open files there")
def test_standard_output_goes_on_where_it_is(tmp_path):
    code = (
        "from pathlib import Path; from spacerobot.common.files import write_text\n"
        "print('before', flush=True); write_text(Path('/dev/stdout'), 'page\\n'); print('after')"
    )
    with (tmp_path / "out").open("w") as out:
        subprocess.run([sys.executable, "-c", code], cwd=ROOT, stdout=out, check=True)
    assert (tmp_path / "out").read_text() == "before\npage\nafter\n"
    assert names(tmp_path) == ["out"]
