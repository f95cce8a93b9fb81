"""Header for processor-in-the-loop tests: functions and sizes that their main function uses."""

from __future__ import annotations

from spacerobot.flightcode.onboard import OnboardSoftware


def processor_table(software: OnboardSoftware) -> str:
    """Header with sizes, functions and transitions of the software.

    Args:
        software: The software.
    """
    name = software.name
    sizes = {
        "STATES": sum(one.size for one in software.states),
        "INPUTS": sum(one.size for one in software.inputs),
        "OUTPUTS": sum(one.size for one in software.commands),
    }
    cases = [
        line
        for index, task in enumerate(software.entries)
        for line in (f"    case {index}u:", f"        {name}_{task.name}(s, in, time);", "        return 1;")
    ]
    body = ["    switch (transition) {", *cases, "    default:", "        return 0;", "    }"]
    if not cases:
        unused = [f"    (void){one};" for one in ("transition", "s", "in", "time")]
        body = [*unused, "    return 0;"]
    return "\n".join(
        [
            "/* Software that processor_in_the_loop.c runs; its structs are arrays of real numbers. */",
            f'#include "{name}.h"',
            "",
            f"typedef {name}_real real;",
            f"typedef {name}_state state_struct;",
            f"typedef {name}_inputs inputs_struct;",
            f"typedef {name}_outputs outputs_struct;",
            *(f"#define {key} {value}u" for key, value in sizes.items()),
            f"#define SIGNATURE {name}_signature",
            f"#define INIT {name}_init",
            f"#define STEP {name}_step",
            "",
            "/* Begin a phase; 0 for a transition that there is not. */",
            "static int enter(uint8_t transition, state_struct *s, const inputs_struct *in, real time)",
            "{",
            *body,
            "}",
            "",
        ]
    )
