"""Test vectors of flight code: seeded steps of its functions, evaluated by CasADi."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
import numpy.typing as npt

from spacerobot.common.arrays import Array
from spacerobot.flightcode.c_functions import Precision, function_name
from spacerobot.flightcode.c_text import comment_text
from spacerobot.flightcode.evaluation import evaluate_rows, library_bounds
from spacerobot.flightcode.onboard import Field, OnboardSoftware, Task

MAGIC = b"SRV2"
RESTART = 50
"""Number of steps after which the states restart at their initial values."""


@dataclass(frozen=True)
class TestVectors:
    """Rows of arguments and results of one function.

    Attributes:
        task: Task of the function.
        arguments, results: Numbers of all arguments, and of all results, one row a step (n, ...).
        bounds: Largest difference by another mathematical library, relative to the rounding of the row's
            largest result (n,); zero for rows that must agree to the bit.
    """

    task: Task
    arguments: Array
    results: Array
    bounds: Array

    @property
    def columns(self) -> list[str]:
        """Name of each number of a row."""
        reads = [name for one in self.task.reads for name in _components(one)]
        writes = [f"{name}+" for one in self.task.writes for name in _components(one)]
        return ["time", *reads, *writes, "bound"]


def record_vectors(
    software: OnboardSoftware, steps: int, seed: int, precision: Precision
) -> list[TestVectors]:
    """Test vectors of every function from random inputs near the initial ones.

    A step starts with the states that the last step produced, so that delays fill and estimates converge. The
    states restart every 50 steps and when a value is not finite.

    Args:
        software: The software.
        steps, seed: Number of steps, and seed of the inputs.
        precision: Precision of the arithmetic.
    """
    generator = np.random.default_rng(seed)
    rows: dict[str, list[tuple[Array, Array]]] = {task.name: [] for task in software.functions}
    evaluators = {task.name: _evaluator(task.function) for task in software.functions}
    values: dict[str, Array] = {}
    for step in range(steps):
        if step % RESTART == 0:
            values = {one.name: np.array(one.initial, dtype=float) for one in software.states}
        time = software.time(step * max(1, software.cycle // 50)) % 100.0
        values |= dict(_random_inputs(software.inputs, time, step, generator))
        for task in software.functions:
            arguments = np.concatenate([[time], *(values[one.name] for one in task.reads)])
            if precision == "float":
                arguments = arguments.astype(np.float32).astype(float)
            results = evaluators[task.name](arguments)
            rows[task.name].append((arguments, results))
            if np.isfinite(results).all() and (
                task not in software.entries or step % RESTART == RESTART // 2
            ):
                ends = np.cumsum([one.size for one in task.writes])[:-1]
                parts = np.split(results, ends)
                values |= {one.name: part for one, part in zip(task.writes, parts, strict=True)}
    vectors = []
    for task in software.functions:
        arguments, results = (np.array(each) for each in zip(*rows[task.name], strict=True))
        if precision == "float":
            results = evaluate_rows(task.function, arguments, np.float32).astype(float)
        kind = np.float64 if precision == "double" else np.float32
        vectors.append(TestVectors(task, arguments, results, library_bounds(task.function, arguments, kind)))
    return vectors


def write_vectors(vectors: Sequence[TestVectors], folder: Path, precision: Precision) -> None:
    """Write a binary and a text file for each function; the text has enough digits to restore each number."""
    folder.mkdir(parents=True, exist_ok=True)
    number: npt.DTypeLike = "<f8" if precision == "double" else "<f4"
    digits = "%.17g" if precision == "double" else "%.9g"
    for one in vectors:
        rows = np.hstack([one.arguments, one.results, one.bounds[:, None]])
        width = 8 if precision == "double" else 4
        sizes = (width, len(rows), one.arguments.shape[1], one.results.shape[1])
        with (folder / f"{one.task.name}.bin").open("wb") as file:
            file.write(MAGIC + struct.pack("<4I", *sizes))
            file.write(rows.astype(number).tobytes())
        with (folder / f"{one.task.name}.txt").open("w", encoding="utf-8") as text:
            subject = comment_text(f"{one.task.text}: {one.task.path}")
            text.write(f"# {subject}; results end in +, bound in roundings\n")
            text.write(f"# {' '.join(one.columns)}\n")
            np.savetxt(text, rows, fmt=digits)


def vector_table(software: OnboardSoftware, precision: Precision) -> str:
    """Header of the test program: the functions with the sizes of their arguments."""
    largest = max(1 + max(len(task.reads), len(task.writes)) for task in software.functions)
    sizes, entries = [], []
    for task in software.functions:
        numbers = [1, *(one.size for one in task.reads), *(one.size for one in task.writes)]
        sizes.append(
            f"static const uint32_t sizes_{task.name}[{len(numbers)}] = "
            f"{{{', '.join(f'{n}u' for n in numbers)}}};"
        )
        entries.append(
            f'    {{"{task.name}", {function_name(software, task)}, {1 + len(task.reads)}u, '
            f"{len(task.writes)}u, sizes_{task.name}}},"
        )
    integer, lowest = ("int64_t", "INT64_MIN") if precision == "double" else ("int32_t", "INT32_MIN")
    return "\n".join(
        [
            "/* Functions that test_vectors.c tests. */",
            f'#include "{software.name}_functions.h"',
            "",
            f"typedef {software.name}_real real;",
            f"typedef {integer} integer;",
            f"#define LOWEST {lowest}",
            f"#define EPSILON {'DBL' if precision == 'double' else 'FLT'}_EPSILON",
            f"#define MAX_FIELDS {largest}",
            "",
            "typedef struct {",
            "    const char *name;",
            "    void (*function)(const real *const *arg, real *const *res);",
            "    uint32_t reads, writes;",
            "    const uint32_t *sizes;",
            "} vector_entry;",
            "",
            *sizes,
            "",
            "static const vector_entry vector_table[] = {",
            *entries,
            "};",
            "",
        ]
    )


def _evaluator(function: ca.Function) -> Callable[[Array], Array]:
    """Function of all arguments (m,) that returns all results (k,), by CasADi's virtual machine."""
    buffer, call = function.buffer()
    keep = (function, buffer)  # the call holds neither of them
    arguments = [np.zeros(function.numel_in(i)) for i in range(function.n_in())]
    results = [np.zeros(function.numel_out(i)) for i in range(function.n_out())]
    for i, argument in enumerate(arguments):
        buffer.set_arg(i, memoryview(argument))  # type: ignore[call-arg,arg-type]
    for i, result in enumerate(results):
        buffer.set_res(i, memoryview(result))  # type: ignore[call-arg,arg-type]
    ends = np.cumsum([argument.size for argument in arguments])[:-1]

    def evaluate(numbers: Array) -> Array:
        for argument, part in zip(arguments, np.split(numbers, ends), strict=True):
            argument[:] = part
        assert keep
        call()
        return np.concatenate(results)

    return evaluate


def _random_inputs(
    fields: Sequence[Field], time: float, step: int, generator: np.random.Generator
) -> Iterator[tuple[str, Array]]:
    """Random inputs near the initial ones; quaternions and directions are normalised."""
    for one in fields:
        value = np.array(one.initial, dtype=float)
        if one.role == "mode":
            value[:] = generator.integers(2, size=one.size)
        elif one.role == "count":
            value[:] = step
        elif one.path.endswith(".begin") and one.role == "plan":
            value[:] = time - generator.uniform(0, 1)
        else:
            value += 0.05 * generator.normal(size=one.size)
        end = one.size - ("time of the sample" in one.text)
        for word, size in (("quaternion", 4), ("cosine", 2)):
            if word in one.text:
                value[end - size : end] /= np.linalg.norm(value[end - size : end])
        value[end:] = time
        yield one.name, value


def _components(one: Field) -> list[str]:
    """Name of each number of a field."""
    return [f"{one.name}[{i}]" for i in range(one.size)] if one.size > 1 else [one.name]
