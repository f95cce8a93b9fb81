"""The cache of compiled libraries: found again, rebuilt when broken, refused when unsafe, safe for many."""

from __future__ import annotations

import ctypes
import hashlib
import os
import signal
import stat
import subprocess
import sys
import time
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from rich.status import Status

from spacerobot.cli.output import progress
from spacerobot.common.errors import CompileError, SpaceRobotWarning
from spacerobot.compiled import cache as cache_module
from spacerobot.compiled import compile_functions, find_toolchain
from spacerobot.compiled.toolchain import SUFFIX

X = ca.SX.sym("x")


def square(plus=0.0):
    return {"f": ca.Function("f", [X], [X**2 + plus], ["x"], ["y"])}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("SPACEROBOT_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache" / "compiled"


def entries(folder):
    return sorted(folder.glob(f"*{SUFFIX}"))


def test_second_time_comes_from_the_cache(folder):
    first, second = compile_functions(square()), compile_functions(square())
    assert (first.cached, second.cached) == (False, True)
    assert first.path == second.path == entries(folder)[0]
    assert second("f", [3.0])[0][0] == 9.0
    assert list(folder.iterdir()) == [first.path]  # nothing temporary stays
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert stat.S_IMODE(first.path.stat().st_mode) == 0o600


@pytest.mark.compiler
def test_a_process_finds_a_library_without_its_sources(folder, monkeypatch):
    x = ca.SX.sym("x")
    function = ca.Function("f", [x], [ca.sin(x) + 0.125])
    first = compile_functions({"f": function})

    def refuse(*_, **__):
        raise AssertionError("sources are generated again")

    monkeypatch.setattr("spacerobot.compiled.library.source_units", refuse)
    second = compile_functions({"f": ca.Function("f", [x], [ca.sin(x) + 0.125])})
    assert second.cached
    assert second.path == first.path
    assert second("f", 1.0)[0] == first("f", 1.0)[0]
    with pytest.raises(AssertionError, match="again"):
        compile_functions({"f": ca.Function("f", [x], [ca.sin(x) + 0.25])})


@pytest.mark.compiler
@pytest.mark.parametrize("count", [1, 7, 8, 19])
def test_columns_are_those_of_single_evaluations(folder, count):
    x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 2)
    function = ca.Function("f", [x, y], [ca.vertcat(ca.sin(x) * y[0], y[1])])
    library = compile_functions({"f": function}, lanes=find_toolchain().lanes)
    rng = np.random.default_rng(0)
    one, other = rng.normal(size=(3, count)), rng.normal(size=(2, count))
    np.testing.assert_allclose(library.columns("f", one, other), function(one, other).full(), rtol=1e-12)


def test_another_source_width_or_compiler_flag_is_another_entry(folder):
    from dataclasses import replace

    toolchain = find_toolchain()
    other = replace(toolchain, flags=(*toolchain.flags, "-fno-builtin"))
    elsewhere = replace(toolchain, processor="another processor")
    compile_functions(square())
    compile_functions(square(1.0))
    compile_functions(square(), lanes=2)
    compile_functions(square(), toolchain=other)
    compile_functions(square(), toolchain=elsewhere)
    assert len(entries(folder)) == 5


@pytest.mark.parametrize("damage", [b"", b"not a library", None])
def test_a_broken_entry_is_rebuilt_never_loaded(folder, damage):
    # In a process of its own, since a library that is loaded cannot be damaged without harm.
    path = Path(_compile_elsewhere(folder))
    path.write_bytes(path.read_bytes()[:-1000] if damage is None else damage)
    again = compile_functions(square())
    assert not again.cached
    assert again("f", [3.0])[0][0] == 9.0
    assert compile_functions(square()).cached


def test_an_entry_that_is_no_library_under_the_right_digest_is_rebuilt(folder):
    path, content = Path(_compile_elsewhere(folder)), b"not a library"
    path.unlink()
    digest = hashlib.sha256(content).hexdigest()[:32]
    path.with_name(f"{path.name.partition('-')[0]}-{digest}{SUFFIX}").write_bytes(content)
    again = compile_functions(square())
    assert not again.cached
    assert again("f", [3.0])[0][0] == 9.0
    assert entries(folder) == [again.path]


@pytest.mark.parametrize("variable", ["SPACEROBOT_COMPILER", "CXX", "SPACEROBOT_COMPILER_FLAGS"])
@pytest.mark.parametrize("text", ["'", "\\", 'g++ "-O1'])
def test_a_variable_without_words_is_one_line(variable, text, monkeypatch):
    monkeypatch.delenv("SPACEROBOT_COMPILER", raising=False)  # which has precedence over CXX
    monkeypatch.setenv(variable, text)
    with pytest.raises(CompileError, match=f"{variable} is .*, which has no words: No ") as caught:
        find_toolchain()
    assert "\n" not in str(caught.value)


def test_a_folder_that_others_may_write_is_refused(folder):
    compile_functions(square())
    folder.chmod(0o777)
    with pytest.warns(SpaceRobotWarning, match=f"{folder} can be written by others; .*SPACEROBOT_CACHE_DIR"):
        library = compile_functions(square())
    assert not library.path.is_relative_to(folder)
    assert stat.S_IMODE(library.path.parent.stat().st_mode) == 0o700
    folder.chmod(0o700)
    folder.parent.chmod(0o770)
    with pytest.warns(SpaceRobotWarning, match=f"{folder.parent} can be written by others"):
        assert not compile_functions(square()).path.is_relative_to(folder)
    folder.parent.chmod(0o700)
    assert compile_functions(square()).path.is_relative_to(folder)


def test_a_link_instead_of_the_folder_is_refused(folder, tmp_path):
    target = tmp_path / "elsewhere"
    target.mkdir(mode=0o700)
    folder.parent.mkdir(mode=0o700)
    folder.symlink_to(target)
    with pytest.warns(SpaceRobotWarning, match="is a link"):
        assert not compile_functions(square()).path.is_relative_to(target)


def test_an_entry_that_others_may_write_is_rebuilt(folder):
    compile_functions(square()).path.chmod(0o666)
    assert not compile_functions(square()).cached


def test_several_processes_at_once(folder):
    running = [_start_elsewhere(folder) for _ in range(4)]
    results = [process.communicate(timeout=120) for process in running]
    assert all(process.returncode == 0 for process in running), results
    assert compile_functions(square()).cached
    assert not [path for path in folder.iterdir() if path.suffix != SUFFIX]


def test_the_oldest_entries_go(folder, monkeypatch):
    monkeypatch.setattr(cache_module, "KEPT", 2)
    for i in range(3):
        path = compile_functions(square(i + 0.5)).path
        os.utime(path, (1000 + i, 1000 + i))
    compile_functions(square(9.5))
    assert len(entries(folder)) == 2
    assert compile_functions(square(2.5)).cached
    assert not compile_functions(square(0.5)).cached


def test_no_compiler_and_a_failing_one_are_told(folder, monkeypatch, tmp_path):
    monkeypatch.setenv("SPACEROBOT_COMPILER", "none")
    assert find_toolchain() is None
    with pytest.raises(CompileError, match="no C\\+\\+ compiler was found"):
        compile_functions(square())
    broken = tmp_path / "broken-compiler"
    broken.write_text(
        "#!/bin/sh\n[ \"$1\" = --version ] && echo broken 1.0 && exit 0\necho 'error: tired' >&2\nexit 3\n"
    )
    broken.chmod(0o755)
    monkeypatch.setenv("SPACEROBOT_COMPILER", str(broken))
    with pytest.raises(CompileError, match="broken-compiler failed with 3: error: tired"):
        compile_functions(square())
    assert entries(folder) == []


def test_what_killed_processes_left_behind_goes_in_time(folder):
    compile_functions(square())
    old, young = folder / "build-old", folder / "build-young"
    for work in (old, young):
        work.mkdir()
        (work / "generated.cpp").touch()
    (folder / "built-old.tmp").touch()
    for path in (old, folder / "built-old.tmp"):
        os.utime(path, (1000, 1000))
    compile_functions(square(1.0))
    assert {path.name for path in folder.iterdir() if path.suffix != SUFFIX} == {"build-young"}


def test_an_entry_that_cannot_be_read_just_now_is_left_alone(folder, monkeypatch):
    path = compile_functions(square()).path

    def busy(path):
        raise OSError("too many open files")

    monkeypatch.setattr(cache_module, "_digest", busy)
    assert cache_module.find(folder, path.stem.partition("-")[0]) is None
    assert path.exists()
    with pytest.raises(CompileError, match="too many open files"):
        compile_functions(square(1.0))  # what a full disk would do, too


def test_threads_do_not_share_an_entry_point(folder):
    library = compile_functions(square())
    mine = library.entry("call_f")
    mine.restype = ctypes.c_int64
    assert library.entry("call_f").restype is None
    assert mine.restype is ctypes.c_int64


_SCRIPT = """
import casadi as ca
from spacerobot.compiled import compile_functions
x = ca.SX.sym("x")
library = compile_functions({"f": ca.Function("f", [x], [x**2 + 0.0], ["x"], ["y"])})
assert library("f", [3.0])[0][0] == 9.0
print(library.path)
"""


def _start_elsewhere(folder, given=None):
    environment = {**(given or os.environ), "SPACEROBOT_CACHE_DIR": str(folder.parent)}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    return subprocess.Popen(
        [sys.executable, "-c", _SCRIPT],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def _compile_elsewhere(folder):
    out, errors = _start_elsewhere(folder).communicate(timeout=120)
    assert out, errors
    return out.strip()


def compiler(tmp_path, script):
    """A compiler that tells its version and then does what a shell script says."""
    path = tmp_path / "some-compiler"
    path.write_text(f'#!/bin/sh\n[ "$1" = --version ] && echo some 1.0 && exit 0\n{script}\n')
    path.chmod(0o755)
    return path


def is_running(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def ends(pid, patience_s=30.0):
    """Whether a process that was killed is gone; a busy system takes a moment."""
    until = time.monotonic() + patience_s
    while is_running(pid) and time.monotonic() < until:
        time.sleep(0.01)
    return not is_running(pid)


@pytest.mark.parametrize("variable", ["SPACEROBOT_COMPILER", "CXX"])
def test_a_compiler_that_the_environment_names_in_vain_is_told(folder, monkeypatch, variable):
    monkeypatch.delenv("SPACEROBOT_COMPILER", raising=False)
    monkeypatch.setenv(variable, "/nowhere/g++-99")
    with pytest.raises(CompileError, match=f"{variable} names the compiler '/nowhere/g\\+\\+-99'"):
        find_toolchain()


def test_a_compiler_may_be_named_with_arguments(folder, monkeypatch):
    found = find_toolchain()
    monkeypatch.setenv("SPACEROBOT_COMPILER", f"env {' '.join(found.command)}")
    assert find_toolchain().command[1:] == found.command
    assert compile_functions(square())("f", [3.0])[0][0] == 9.0


def test_a_compiler_that_hangs_is_ended_with_what_it_started(folder, monkeypatch, tmp_path):
    monkeypatch.setenv(
        "SPACEROBOT_COMPILER", str(compiler(tmp_path, f"sleep 600 & echo $! > {tmp_path}/pid; wait"))
    )
    monkeypatch.setenv("SPACEROBOT_COMPILE_TIMEOUT", "1")
    with pytest.raises(CompileError, match="some-compiler was ended after 1 s; SPACEROBOT_COMPILE_TIMEOUT"):
        compile_functions(square())
    assert ends(int((tmp_path / "pid").read_text()))
    assert list(folder.iterdir()) == []
    monkeypatch.setenv("SPACEROBOT_COMPILE_TIMEOUT", "soon")
    with pytest.raises(
        CompileError, match="SPACEROBOT_COMPILE_TIMEOUT is 'soon', allowed: a positive number"
    ):
        compile_functions(square())


def test_ctrl_c_ends_the_compilers_and_leaves_nothing(folder, tmp_path):
    script = f"sleep 600 & echo $! > {tmp_path}/part; mv {tmp_path}/part {tmp_path}/pid; wait"
    environment = {**os.environ, "SPACEROBOT_COMPILER": str(compiler(tmp_path, script))}
    process = _start_elsewhere(folder, environment)
    for _ in range(6000):
        if (tmp_path / "pid").exists() or process.poll() is not None:
            break
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert "KeyboardInterrupt" in errors
    assert ends(int((tmp_path / "pid").read_text()))
    assert list(folder.glob("*")) == []


@pytest.mark.parametrize("flags", ["", "-march=x86-64"], ids=["compiles", "is asked for its macros"])
def test_ctrl_c_while_a_compiler_starts_ends_it(folder, tmp_path, monkeypatch, flags):
    monkeypatch.setenv("SPACEROBOT_COMPILER_FLAGS", flags)
    script = f"sleep 600 & echo $! > {tmp_path}/part; mv {tmp_path}/part {tmp_path}/pid; wait"
    monkeypatch.setenv("SPACEROBOT_COMPILER", str(compiler(tmp_path, script)))
    start = subprocess.Popen

    def interrupted(command, **options):
        """Start a process; Ctrl-C comes before its caller has it."""
        process = start(command, **options)
        if "--version" not in command:
            while not (tmp_path / "pid").exists():
                time.sleep(0.01)
            signal.raise_signal(signal.SIGINT)
        return process

    monkeypatch.setattr(subprocess, "Popen", interrupted)
    with pytest.raises(KeyboardInterrupt):
        compile_functions(square())
    assert ends(int((tmp_path / "pid").read_text()))
    assert list(folder.glob("*")) == []


def test_progress_is_told(folder):
    told = []
    compile_functions(square(), progress=lambda done, total: told.append((done, total)))
    assert told == [(0, 1), (1, 1)]
    compile_functions(square(), progress=lambda done, total: told.append((done, total)))
    assert len(told) == 2  # nothing is compiled


def test_a_command_hears_of_whatever_is_compiled(folder, monkeypatch):
    shown = []
    monkeypatch.setattr(Status, "update", lambda _, words: shown.append(words))
    with progress("reading") as say:
        say("building")
        compile_functions(square())
        compile_functions(square())
    compile_functions(square(1.0))  # nobody listens any more
    assert shown == ["building", "building (compiling: 0 of 1 pieces done)", "building"]
