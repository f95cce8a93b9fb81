"""README of exported flight code: usage, assumptions and measurements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from string import Template

from spacerobot.common.version import __version__
from spacerobot.flightcode.c_functions import Precision, count_operations
from spacerobot.flightcode.c_source import work_size
from spacerobot.flightcode.onboard import OnboardSoftware

TEXT = Template("""\
# On-board software of the scenario $title

Written by spacerobot $version: the periodic controllers, estimators, plan followers and detections of the
scenario, and the allocation of its wheels and thrusters, as C99 with numbers of type `$precision`. No memory
is allocated, no function calls itself, all loops have constant bounds.

## Use

```c
${name}_init(&state);
${name}_step(&state, &inputs, &outputs);  /* every $tick s; the first one at the start */
$entries```

`$name.h` states unit, frame and period of each input. The caller owns the memory: $sizes.
The code has no other memory that it writes, apart from the stack.

    cmake -B build && cmake --build build && ctest --test-dir build
    spacerobot run SCENARIO --controller libcontroller.so

## What it relies on

$assumptions

## What stays in the plant

$plant_side

## Functions

$functions

$times

## Test vectors

`vectors/NAME.bin` and `.txt`: $steps seeded steps of each function; `test_vectors vectors` compares. Rows on
which no call of the mathematical library acts agree to the bit, with `-ffp-contract=off`. Values of others
may differ by the bound of their row, the last number in it, in roundings of its largest value. It is one and
4 times the larger of two numbers: the sum over all calls of their derivative times 2 units in the last place,
by which two libraries differ that err by one unit each; and the largest difference in 8 evaluations whose
calls are changed by one unit, up or down at random.

$agreement

## MISRA C:2012

`cppcheck --std=c99 --addon=misra *.c` (2.10) reports nothing about the code that flies: `$name.c`,
`${name}_functions.c` and their headers. The addon does not see that truth values are kept in real
numbers (10.1: operands of `!`, `&&`, `||`), as CasADi writes them. The two programs of the test bench,
`test_vectors.c` (t) and `processor_in_the_loop.c` (p), which do not fly, keep:

| rule | t | p | why it stays |
|---|---|---|---|
| 5.6, 8.9 | 3 | 2 | types and tables of the generated headers, which each program includes once |
| 7.2, 8.6 | 3 | 1 | numbers that C declares (`INT64_MIN`); each program has its own `main` |
| 10.1, 10.3, 10.4 | 1 | 8 | characters of the protocol are numbers of one byte |
| 11.3 | - | 4 | the structs are real numbers one after the other, sent as such |
| 12.1 | 11 | 3 | precedence as usual in C |
| 12.3, 15.5, 17.8 | 13 | 11 | short: several declarations a line, several returns, parameters reused |
| 14.4, 17.7 | 9 | 3 | results of printing and closing are not needed |
| 21.1, 21.6, 21.10 | 3 | 2 | files, standard input and output and clocks are the purpose of these programs |
""")


@dataclass(frozen=True)
class FunctionReport:
    """Measured properties of a function.

    Attributes:
        differing, values: Values that differ from the vectors, and all values.
        distance_ulp: Largest distance of a value [units in the last place].
        mean_ns, worst_ns: Mean and worst time of a call [ns].
        stack_bytes: Stack of the function; None where the compiler does not report it.
    """

    differing: int
    values: int
    distance_ulp: float
    mean_ns: float
    worst_ns: float
    stack_bytes: int | None


def static_bytes(software: OnboardSoftware, precision: Precision) -> dict[str, int]:
    """Sizes of the structs [bytes]."""
    size = 8 if precision == "double" else 4
    groups = {"inputs": software.inputs, "state": software.states, "outputs": software.commands}
    counts = {name: size * max(sum(one.size for one in fields), 1) for name, fields in groups.items()}
    counts["state"] += size * work_size(software) + size
    return counts


def readme(
    software: OnboardSoftware,
    precision: Precision,
    steps: int,
    compiler: str | None,
    measured: Mapping[str, FunctionReport],
) -> str:
    """README of the folder.

    Args:
        software, precision, steps: The software, the type of its numbers, and the steps of its test vectors.
        compiler: C compiler that built it; None if it was not built.
        measured: FunctionReports by the name of the function.
    """
    times = "Not measured: there was no C compiler."
    if measured:
        times = (
            "Stack by `-fstack-usage`, of the function alone. Times on the computer of the export with "
            f"`{Path(compiler or '').name} -O2`,\nmean and worst over the rows of the vectors, of three "
            f"calls each the shortest.\n{_longest_step(software, measured)}"
        )
    entries = [
        f"{software.name}_{task.name}(&state, &inputs, time);  /* {task.text} */\n"
        for task in software.entries
    ]
    return TEXT.substitute(
        title=software.title,
        version=__version__,
        precision=precision,
        name=software.name,
        tick=f"{float(software.tick):.12g}",
        entries="".join(entries),
        sizes=", ".join(f"{key} {value} bytes" for key, value in static_bytes(software, precision).items()),
        assumptions="\n".join(_assumptions(software)),
        plant_side="\n".join(_plant_side(software)),
        functions="\n".join(_function_table(software, measured)),
        times=times,
        steps=steps,
        agreement="\n".join(_agreement(precision, measured)),
    )


def _assumptions(software: OnboardSoftware) -> list[str]:
    """Inputs that the caller must provide in addition to samples of sensors."""
    lines = ["- Samples are those of the scenario's sensors with `errors`: held values, with their latency."]
    truth = software.of_role("truth")
    if truth:
        readers: dict[str, list[str]] = {}
        for task in software.functions:
            if any(one.role == "truth" for one in task.reads):
                readers[task.path] = [one.name for one in task.reads if one.role == "truth"]
        lines.append(
            "- Values whose names begin with `true_`, and states of the plant, are read where the scenario "
            "has an ideal\n  sensor, or where a law solves the model (`derivative: ideal`): on board, "
            "navigation provides them. A sensor\n  with `errors`, or `derivative: filtered`, needs none. "
            "They are read by:"
        )
        lines += [f"    - {path}: {', '.join(names)}" for path, names in readers.items()]
    if software.of_role("plan"):
        lines.append(
            "- Plans are made elsewhere: model predictive control solves a nonlinear program, which is not "
            "exported.\n  The code follows the plan in the inputs."
        )
    if software.entries:
        lines.append("- A mode manager decides when a phase begins, and calls `*_enter_*`.")
    lines.append(
        "- Initial estimates are those of the scenario's start; overwrite them in the state after `init` or "
        "the first step."
    )
    return lines


def _plant_side(software: OnboardSoftware) -> list[str]:
    """Laws of actuators that are not in the code, with reasons."""
    lines = ["- Limits of motors and valves, failures and their consequences, brakes: they are hardware."]
    return [*lines, *(f"- {one}: {reason}." for one, reason in software.plant_side.items())]


def _function_table(software: OnboardSoftware, measured: Mapping[str, FunctionReport]) -> list[str]:
    """Table of all functions."""
    lines = [
        "| function | period [s] | operations | libm | stack [bytes] | mean [us] | worst [us] |",
        "|---|---|---|---|---|---|---|",
    ]
    always = {task.name for task in (*software.conditions, *software.detections, software.output)}
    always |= {"flow", "allocate"}
    tick = float(software.tick)
    for task in software.functions:
        count = count_operations(task.function)
        period = f"{task.period * tick:.12g}" if task.period else "event"
        period = f"{tick:.12g}" if task.name in always else period
        one = measured.get(task.name)
        libm = ", ".join(f"{calls} {key}" for key, calls in sorted(count.libm.items())) or "-"
        numbers = ["-"] * 3
        if one is not None:
            stack = "-" if one.stack_bytes is None else str(one.stack_bytes)
            numbers = [stack, f"{one.mean_ns / 1e3:.3g}", f"{one.worst_ns / 1e3:.3g}"]
        lines.append(f"| {task.name} | {period} | {count.total} | {libm} | {' | '.join(numbers)} |")
    return lines


def _longest_step(software: OnboardSoftware, measured: Mapping[str, FunctionReport]) -> str:
    """Sentence on the duration of a step in which all tasks run, and on the period of steps."""
    steps = [task for task in software.functions if task not in software.entries and task.name in measured]
    worst = sum(measured[task.name].worst_ns for task in steps) / 1e3
    tick = float(software.tick) * 1e6
    return (
        f"The worst times of all functions of a step add up to {worst:.3g} us; "
        f"a step is due every {tick:.6g} us."
    )


def _agreement(precision: Precision, measured: Mapping[str, FunctionReport]) -> list[str]:
    """Agreement of the functions with their vectors on the exporting machine."""
    if not measured:
        return []
    values = sum(one.values for one in measured.values())
    differing = sum(one.differing for one in measured.values())
    worst = max(one.distance_ulp for one in measured.values())
    return [
        f"On the computer of the export {differing} of {values} values differed, by at most {worst:g} ulp of "
        f"type `{precision}`."
    ]
