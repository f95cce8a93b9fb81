"""Elements of your own: a reference and a controller that live in files of yours (``examples/plugins``)."""

from pathlib import Path

import spacerobot as sr
from spacerobot import rollout

PLUGINS = Path(__file__).parent / "plugins"


def main(duration_s: float = 10.0, backend: rollout.Backend = "auto") -> None:
    """Both robots fly a lemniscate; a soft impedance helps the first."""
    for name in ("lemniscate", "impedance"):
        sr.load_plugin(PLUGINS / f"{name}.py")  # on the command line: --plugin FILE
    scene = sr.load_scene(
        "paper",
        {
            "robots.*.tips.tip.reference": {"kind": "lemniscate", "size": 0.05},
            "robots.rpr1.tips.tip.controllers": {"soft": {"kind": "impedance", "stiffness": 80}},
            "simulation.duration": duration_s,
        },
    )
    result = sr.simulate(scene, backend=backend)
    force = result.data.impedance_force.sel(tip="rpr1/tip")  # the element's own output, with its unit
    print(f"impedance force at most {float(abs(force).max()):.3f} {force.attrs['units']}")

    # its numbers are parameters like any other: they can be varied, tuned and differentiated
    loop = sr.build_closed_loop(scene)
    print([path for path in loop.parameter_paths if "soft" in path or path.endswith("reference.size")])


if __name__ == "__main__":
    main()
