"""C sources of on-board software: header, schedule, build file."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator

from spacerobot.flightcode.c_functions import Precision, function_name
from spacerobot.flightcode.c_text import comment_text, number_literal
from spacerobot.flightcode.onboard import Field, OnboardSoftware, Task

HEADINGS = {
    "sample": "samples of sensors: the last one that is available, held until the next",
    "count": "numbers of samples that sensors have taken, also those that are not available yet",
    "truth": "values of the present instant that ideal sensors read, or that laws need for the model",
    "mode": "switches of the plant, 1 or 0",
    "plan": "plan from outside, replaced as a whole between two steps",
    "draw": "errors of initial estimates",
}
"""Groups of the inputs."""


def interface_signature(software: OnboardSoftware) -> str:
    """Hash of everything that a caller of the software relies on: fields, schedule, transitions.

    Gains and other numbers do not enter it, so that flight code may be flown against another plant.
    """
    lines = [software.name, str(software.tick)]
    lines += [f"{one.role} {one.name} {one.size}" for one in _ordered(software)]
    lines += [f"{task.name} {task.period} {task.offset}" for task in software.functions]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def public_header(software: OnboardSoftware, precision: Precision) -> str:
    """Header with every input, state and command, its unit, frame and rate."""
    name, guard = software.name, f"{software.name.upper()}_H"
    tick = f"{float(software.tick):.12g}"
    lines = [
        f"/* On-board software of the scenario {software.title}.",
        f" * Call {name}_init once, then {name}_step every {tick} s; {name}_enter_* when a phase begins.",
        *(
            f" * In the plant, not here: {comment_text(f'{one}: {reason}')}."
            for one, reason in software.plant_side.items()
        ),
        " */",
        f"#ifndef {guard}",
        f"#define {guard}",
        "",
        "#include <stdint.h>",
        "",
        f"typedef {precision} {name}_real;",
        "",
        "/* Inputs: SI units; axes and periods as stated. */",
        "typedef struct {",
    ]
    group = ""
    for one in software.inputs:
        if one.role != group:
            group = one.role
            lines.append(f"    /* -- {HEADINGS[group]} */")
        lines.append(_member(software, one))
    if not software.inputs:
        lines.append(f"    {name}_real unused;")
    lines += [
        f"}} {name}_inputs;",
        "",
        "/* State: all that is kept between two steps. */",
        "typedef struct {",
    ]
    lines += [_member(software, one) for one in software.states]
    work = work_size(software)
    lines += [
        f"    {name}_real work[{work}]; /* values between two assignments */",
        "    uint32_t tick; /* number of the next step */",
        f"}} {name}_state;",
        "",
        "/* Commands, held until the next step. */",
        "typedef struct {",
        *(_member(software, one) for one in software.commands),
        f"}} {name}_outputs;",
        "",
        "/* Hash of this interface, and size of a real number in bytes. */",
        f"extern const char {name}_signature[65];",
        f"extern const uint32_t {name}_real_size;",
        "",
        "/* Set the state to that of the start. */",
        f"void {name}_init({name}_state *state);",
        "",
        "/* Run the tasks of the present tick, and go to the next one. */",
        f"void {name}_step({name}_state *state, const {name}_inputs *inputs, {name}_outputs *outputs);",
    ]
    for task in software.entries:
        lines += [
            "",
            f"/* {comment_text(f'{task.path}: {task.text}')} at a time [s]. */",
            f"void {name}_{task.name}({name}_state *state, const {name}_inputs *inputs, {name}_real time);",
        ]
    return "\n".join([*lines, "", "#endif", ""])


def schedule_source(software: OnboardSoftware) -> str:
    """Start, step and transitions."""
    name = software.name
    lines = [
        f"/* Schedule of the scenario {software.title}: no allocation, no recursion, bounded loops. */",
        f'#include "{name}.h"',
        f'#include "{name}_functions.h"',
        "",
        f'const char {name}_signature[65] = "{interface_signature(software)}";',
        f"const uint32_t {name}_real_size = (uint32_t)sizeof({name}_real);",
        "",
        f"static void copy({name}_real *target, const {name}_real *source, uint32_t size)",
        "{",
        "    uint32_t i;",
        "    for (i = 0u; i < size; ++i) {",
        "        target[i] = source[i];",
        "    }",
        "}",
        "",
    ]
    for task in software.functions:
        lines += _call(software, task)
    lines += [f"void {name}_init({name}_state *state)", "{"]
    starts = software.states
    for one in starts:
        values = ", ".join(number_literal(value) for value in one.initial)
        lines.append(f"    static const {name}_real {one.name}[{one.size}] = {{{values}}};")
    lines += [f"    copy({_address('state', one)}, {one.name}, {one.size}u);" for one in starts]
    lines += ["    state->tick = 0u;", "}", ""]
    lines += [
        f"void {name}_step({name}_state *state, const {name}_inputs *inputs, {name}_outputs *outputs)",
        "{",
        "    const uint32_t tick = state->tick;",
        f"    const {name}_real time = {_time(software, 'tick')};",
    ]
    if software.flow is not None:
        lines += [
            "    if (tick > 0u) {",
            "        const uint32_t last = tick - 1u;",
            f"        {_run(software.flow, _time(software, 'last'))}",
            "    }",
        ]
    for task in software.conditions:
        lines.append(f"    {_run(task)}")
    for task in software.tasks:
        if task.continual:
            lines.append(f"    {_run(task)}")
            continue
        lines += [
            f"    if ({_due(task)}) {{",
            f"        {_run(task)}",
            "    }",
        ]
    allocation = [] if software.allocation is None else [f"    {_run(software.allocation)}"]
    lines += [*allocation, f"    {_run(software.output)}", "    state->tick = tick + 1u;", "}", ""]
    for task in software.entries:
        lines += [
            f"void {name}_{task.name}({name}_state *state, const {name}_inputs *inputs, {name}_real time)",
            "{",
            f"    {_run(task)}",
            *allocation,
            "}",
            "",
        ]
    return "\n".join(lines)


def cmake_file(software: OnboardSoftware) -> str:
    """Build file: library, shared library for our loop, test program, processor in the loop."""
    name = software.name
    return f"""# On-board software of {software.title}: libraries, test program, processor in the loop
cmake_minimum_required(VERSION 3.10)
project({name} C)

set(CMAKE_C_STANDARD 99)
set(CMAKE_C_STANDARD_REQUIRED ON)
set(CMAKE_C_EXTENSIONS OFF)
if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE Release)
endif()
set(CMAKE_C_FLAGS_RELEASE "-O2")
add_compile_options(-Wall -Wextra -Werror -pedantic -ffp-contract=off)

add_library({name} STATIC {name}.c {name}_functions.c)
add_library(controller SHARED {name}.c {name}_functions.c)
set_target_properties(controller PROPERTIES LIBRARY_OUTPUT_DIRECTORY ${{CMAKE_CURRENT_SOURCE_DIR}})
target_link_libraries(controller m)

add_executable(test_vectors test_vectors.c {name}_functions.c)
target_link_libraries(test_vectors m)
add_executable(processor_in_the_loop processor_in_the_loop.c {name}.c {name}_functions.c)
target_link_libraries(processor_in_the_loop m)

enable_testing()
add_test(NAME vectors COMMAND test_vectors ${{CMAKE_CURRENT_SOURCE_DIR}}/vectors)
"""


def work_size(software: OnboardSoftware) -> int:
    """Largest number of values that a task writes."""
    return max(sum(one.size for one in task.writes) for task in software.functions)


def _ordered(software: OnboardSoftware) -> Iterator[Field]:
    yield from software.inputs
    yield from software.states
    yield from software.commands


def _member(software: OnboardSoftware, one: Field) -> str:
    """Member of a struct with its description."""
    size = f"[{one.size}]" if one.size > 1 else ""
    words = [one.text, "" if one.role == "state" else f"[{one.unit}]"]
    words += [one.frame] if one.frame != "-" else []
    words += [f"every {one.period_s:.12g} s"] if one.period_s else []
    text = "; ".join([" ".join(words[:2]).strip(), *words[2:]])
    return f"    {software.name}_real {one.name}{size}; /* {comment_text(text)} */"


def _address(struct: str, one: Field) -> str:
    """Pointer to the first number of a member."""
    return f"{struct}->{one.name}" if one.size > 1 else f"&{struct}->{one.name}"


def _struct(one: Field) -> str:
    """Name of the struct of a field."""
    return {"state": "state", "command": "outputs"}.get(one.role, "inputs")


def _call(software: OnboardSoftware, task: Task) -> list[str]:
    """Function that calls that of a task on members of the structs."""
    name = software.name
    lines = [
        f"/* {comment_text(f'{task.text}: {task.path}')} */",
        f"static void run_{task.name}({_parameters(software, task)})",
        "{",
        f"    const {name}_real *arg[{1 + len(task.reads)}];",
        f"    {name}_real *res[{len(task.writes)}];",
    ]
    lines.append("    arg[0] = &time;")
    lines += [f"    arg[{i}] = {_address(_struct(one), one)};" for i, one in enumerate(task.reads, 1)]
    begin = 0
    for i, one in enumerate(task.writes):
        lines.append(f"    res[{i}] = &state->work[{begin}];")
        begin += one.size
    lines.append(f"    {function_name(software, task)}(arg, res);")
    lines += [
        f"    copy({_address(_struct(one), one)}, res[{i}], {one.size}u);"
        for i, one in enumerate(task.writes)
    ]
    return [*lines, "}", ""]


def _structs(task: Task) -> list[str]:
    """Structs that a task needs."""
    used = {"state", *(_struct(one) for one in (*task.reads, *task.writes))}
    return [name for name in ("state", "inputs", "outputs") if name in used]


def _parameters(software: OnboardSoftware, task: Task) -> str:
    """Parameters of the function that runs a task."""
    name = software.name
    words = [f"{'const ' if one == 'inputs' else ''}{name}_{one} *{one}" for one in _structs(task)]
    return ", ".join([*words, f"{name}_real time"])


def _run(task: Task, time: str = "time") -> str:
    """Call of that function."""
    return f"run_{task.name}({', '.join([*_structs(task), time])});"


def _time(software: OnboardSoftware, tick: str) -> str:
    """Time of a tick as a C expression."""
    real = f"({software.name}_real)"
    return f"{real}{tick} * {real}{software.tick.numerator} / {real}{software.tick.denominator}"


def _due(task: Task) -> str:
    """Condition under which a task runs at a tick."""
    if not task.period:
        return f"tick == {task.offset}u"
    if not task.offset:
        return f"(tick % {task.period}u) == 0u"
    return f"(tick >= {task.offset}u) && (((tick - {task.offset}u) % {task.period}u) == 0u)"
