"""Your own elements: a reference and a controller, each defined in a plugin file (``examples/plugins``)."""

from pathlib import Path

import spacerobot as sr
import viz
from spacerobot import rollout

PLUGINS = Path(__file__).parent / "plugins"


def main(
    folder: Path = Path("out/examples/own_element"),
    duration_s: float = 10.0,
    backend: rollout.Backend = "auto",
) -> None:
    """Both tips follow a lemniscate; a bounded spring assists the first robot."""
    for name in ("lemniscate", "bounded_spring"):
        sr.load_plugin(PLUGINS / f"{name}.py")  # on the command line: --plugin FILE
    scene = sr.load_scene(
        "paper",
        {
            "robots.*.tips.tip.reference": {"kind": "lemniscate", "size": 0.05},
            "robots.rpr1.tips.tip.controllers": {"soft": {"kind": "bounded_spring", "stiffness": 80}},
            "simulation.duration": duration_s,
        },
    )
    result = sr.simulate(scene, backend=backend, progress=sr.print_progress)
    force = result.data.spring_force.sel(tip="rpr1/tip")  # output of the plugin, with its unit
    print(f"peak force of the spring: {float(abs(force).max()):.3f} {force.attrs['units']}")

    viz.save_figures(result, folder / "figures", formats=("png",), names=["tip_paths"])
    viz.write_recording(result, folder / "film.gif", frames_per_s=5, speed=2, size_px=(480, 300))

    # numbers of plugins are parameters like any other: they can be varied, tuned and differentiated
    loop = sr.build_closed_loop(scene)
    paths = [path for path in loop.parameter_paths if "soft" in path or path.endswith("reference.size")]
    print("parameters of the plugins:", *paths, sep="\n  ")
    print(f"files in {folder}:", ", ".join(sorted(path.name for path in folder.iterdir())))


if __name__ == "__main__":
    main()
