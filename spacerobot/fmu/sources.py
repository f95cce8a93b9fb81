"""C++ sources of a functional mock-up unit: the scene's functions, the rollout loops, and FMI's functions."""

from __future__ import annotations

import hashlib
import json
import uuid
from collections.abc import Iterable, Mapping
from importlib import resources

import numpy as np

from spacerobot.closedloop import ClosedLoop
from spacerobot.compiled.build import SourceUnit
from spacerobot.compiled.library import source_units
from spacerobot.fmu.ports import PlantPorts
from spacerobot.rollout.engines import cold_functions, loops_source
from spacerobot.rollout.kernel import Kernel, sx_function
from spacerobot.rollout.time_grid import TimeGrid


def plant_sources(
    loop: ClosedLoop, kernel: Kernel, grid: TimeGrid, ports: PlantPorts, fmi: int
) -> tuple[str, Mapping[str, SourceUnit]]:
    """Identity of the unit, and its sources by file name, each compiled separately.

    Args:
        loop, kernel: The closed loop and the functions of its rollouts.
        grid: Steps of the rollout.
        ports: Variables; their signals replace the loop's outputs.
        fmi: Version of the standard, 2 or 3.
    """
    functions = dict(kernel.functions)
    symbols = [functions["outputs"].sx_in(i) for i in range(3)]
    functions["outputs"] = sx_function(
        "outputs", dict(zip("txc", symbols, strict=True)), {"y": ports.signals(*symbols)}
    )
    p = functions["setup"].sx_in(0)
    functions["gaps"] = sx_function("gaps", {"p": p}, {"gap": loop.gaps(p)})
    tables = _tables(loop, kernel, grid, ports)
    folder = resources.files("spacerobot.fmu")
    wrapper = [folder.joinpath(f"{name}.hpp").read_text(encoding="utf-8") for name in ("plant", f"fmi{fmi}")]
    names = json.dumps([(v.name, v.unit, v.text) for v in (*ports.parameters, *ports.inputs, *ports.outputs)])
    pieces = [
        *(function.serialize() for function in functions.values()),
        loops_source(kernel),
        tables,
        *wrapper,
    ]
    digest = hashlib.sha256("\0".join([*pieces, names]).encode()).hexdigest()
    token = f"{{{uuid.UUID(digest[:32])}}}"
    tail = "\n".join(
        [
            "#define COMMUNICATION",
            loops_source(kernel),
            f'static const char TOKEN[] = "{token}";',
            tables,
            *wrapper,
        ]
    )
    cold = cold_functions(kernel) | {"gaps"}
    units = source_units(functions, cold=cold, tail=tail)
    named_units = {f"functions_{k}.cpp": unit for k, unit in enumerate(units[:-1])}
    return token, named_units | {"plant.cpp": units[-1]}


def _tables(loop: ClosedLoop, kernel: Kernel, grid: TimeGrid, ports: PlantPorts) -> str:
    """Numbers of the plant as constants in C++."""
    noise = kernel.noise.drawn(np.array(loop.parameter_values)[None, :])[0]
    sizes = {
        "PARAMETERS": len(ports.parameters),
        "INPUTS": len(ports.inputs),
        "OUTPUTS": len(ports.outputs),
        "INTEGERS": len(ports.integers),
        "SHOWN_SWITCHES": len(ports.switches),
        "SHOWN_EVENTS": len(ports.counts),
        "NOISES": len(noise),
        "STEPS_IN_INTERVAL": grid.every,
    }
    lines = [f"enum {{ {', '.join(f'{name} = {size}' for name, size in sizes.items())} }};"]
    lines.append(f"static const double STEP = {grid.step_s!r};")
    integers = {
        "PARAMETER": [variable.place for variable in ports.parameters],
        "TUNABLE": [int(variable.tunable) for variable in ports.parameters],
        "INPUT_PARAMETER": [variable.place for variable in ports.inputs],
        "INPUT_CONSTANT": [variable.constant for variable in ports.inputs],
        "OUTPUT": [variable.place for variable in ports.outputs],
        "INTEGER": [variable.place for variable in ports.integers],
    }
    reals: Mapping[str, Iterable[float]] = {
        "NOMINAL": loop.parameter_values,
        "SCALE": kernel.scale,
        "NOISE": noise,
        "LARGEST_GAP": loop.max_gaps.values(),
    }
    # one more, since an array has at least one
    for name, row in integers.items():
        lines.append(f"static const int {name}[] = {{{', '.join(map(str, [*row, -1]))}}};")
    for name, numbers in reals.items():
        texts = ", ".join(repr(float(number)) for number in [*numbers, 0.0])
        lines.append(f"static const double {name}[] = {{{texts}}};")
    grasps = ", ".join(json.dumps(name) for name in [*loop.max_gaps, ""])
    lines.append(f"static const char* const GRASP[] = {{{grasps}}};")
    return "\n".join(lines)
