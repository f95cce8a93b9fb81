"""Folder of exported flight code: sources, test vectors, build file, README with measurements."""

from __future__ import annotations

import os
import shutil
import subprocess
from importlib import resources
from pathlib import Path

from spacerobot.common.errors import CompileError
from spacerobot.flightcode.c_functions import (
    Precision,
    function_name,
    functions_header,
    functions_source,
)
from spacerobot.flightcode.c_source import cmake_file, public_header, schedule_source
from spacerobot.flightcode.onboard import OnboardSoftware
from spacerobot.flightcode.processor_table import processor_table
from spacerobot.flightcode.readme import FunctionReport, readme
from spacerobot.flightcode.vectors import record_vectors, vector_table, write_vectors

WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic")
FLAGS = (*WARNINGS, "-O2", "-ffp-contract=off")
PROGRAMS = ("test_vectors.c", "processor_in_the_loop.c")
LIBRARY = "libcontroller.so"
SEED = 39
"""Seed of the test vectors."""


def write_package(software: OnboardSoftware, folder: Path, precision: Precision, steps: int) -> None:
    """Write flight code with its test vectors; with a C compiler, also build and measure it.

    Args:
        software: The software.
        folder: Folder to create and write.
        precision: Type of real numbers.
        steps: Number of steps of the test vectors.

    Raises:
        CompileError: If the C compiler refuses a source.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / LIBRARY).unlink(missing_ok=True)  # of an earlier export: it would not fit the new sources
    name = software.name
    texts = {
        f"{name}.h": public_header(software, precision),
        f"{name}.c": schedule_source(software),
        f"{name}_functions.h": functions_header(software),
        f"{name}_functions.c": functions_source(software, precision),
        "vector_table.h": vector_table(software, precision),
        "processor_table.h": processor_table(software),
        "CMakeLists.txt": cmake_file(software),
    }
    sources = resources.files("spacerobot.flightcode") / "c"
    texts |= {program: (sources / program).read_text(encoding="utf-8") for program in PROGRAMS}
    for file, text in texts.items():
        (folder / file).write_text(text, encoding="utf-8")
    write_vectors(record_vectors(software, steps, SEED, precision), folder / "vectors", precision)
    compiler = c_compiler()
    measured = {} if compiler is None else build_and_measure(software, folder, compiler)
    (folder / "README.md").write_text(
        readme(software, precision, steps, compiler, measured), encoding="utf-8"
    )


def c_compiler() -> str | None:
    """C compiler from ``CC``, cc, gcc or clang; None without one, or with ``SPACEROBOT_COMPILER=none``."""
    if os.environ.get("SPACEROBOT_COMPILER", "").strip().lower() == "none":
        return None
    return next(
        (path for one in (os.environ.get("CC"), "cc", "gcc", "clang") if one and (path := shutil.which(one))),
        None,
    )


def build_and_measure(software: OnboardSoftware, folder: Path, compiler: str) -> dict[str, FunctionReport]:
    """Build the shared library and the test program, and run the test.

    Args:
        software, folder: The software, and the folder of its sources.
        compiler: C compiler.

    Raises:
        CompileError: If the compiler rejects a source, or the test fails.
    """
    name = software.name
    build = folder / "build"
    build.mkdir(exist_ok=True)
    sources = [f"{name}.c", f"{name}_functions.c"]
    objects = [str(build / f"{source}.o") for source in sources]
    for source, target in zip(sources, objects, strict=True):
        _run([compiler, *FLAGS, "-fPIC", "-fstack-usage", "-c", source, "-o", target], folder)
    _run([compiler, "-shared", *objects, "-o", LIBRARY, "-lm"], folder)
    program = str(build / "test_vectors")
    _run([compiler, *FLAGS, "test_vectors.c", objects[1], "-o", program, "-lm"], folder)
    test_run = subprocess.run([program, "vectors"], cwd=folder, capture_output=True, text=True, check=False)
    stacks = dict[str, int]()
    for report in build.glob("*.su"):
        for line in report.read_text(encoding="utf-8").splitlines():
            place, size, *_ = line.split("\t")
            stacks[place.rpartition(":")[2]] = int(size)
    measured = {}
    names = {task.name: function_name(software, task) for task in software.functions}
    for line in test_run.stdout.splitlines():
        task, values, differing, distance, _, mean, worst = line.split()
        measured[task] = FunctionReport(
            int(differing), int(values), float(distance), float(mean), float(worst), stacks.get(names[task])
        )
    shutil.rmtree(build)
    if test_run.returncode:
        raise CompileError(f"the compiled functions differ from their vectors: {test_run.stderr.strip()}")
    return measured


def _run(command: list[str], folder: Path) -> None:
    compilation = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if compilation.returncode:
        lines = compilation.stderr.strip().splitlines() or ["no message"]
        first = next((line for line in lines if "error:" in line), lines[0])
        raise CompileError(f"{Path(command[0]).name} refuses the exported code: {first}")
