"""Design variables from the command line: a dotted path, or the end of one, and a range."""

from __future__ import annotations

import re
from collections.abc import Sequence

from spacerobot.common.errors import ScenarioError, near_names
from spacerobot.common.files import StrPath
from spacerobot.common.section import numbers
from spacerobot.scenario.load import to_document
from spacerobot.scenario.paths import expand
from spacerobot.scene import Scene, build_scene, to_scene

PLACES = ("robots", "target", "grasps", "gravity", "environment")
"""Parts of a scenario whose numbers may vary."""
LARGE_RATIO = 10.0
"""Ratio of upper to lower bound from which a variable is scaled logarithmically."""
RANGE = re.compile(r"(?P<path>[^=]+)=(?P<lower>[^=]+)\.\.(?P<upper>[^=]+)")


def vary(scene: Scene | StrPath, ranges: Sequence[str]) -> Scene:
    """The scene with other variables in its tuning section, whose other entries stay.

    Args:
        scene: A scene, the path of a YAML file, or the name of a shipped scenario.
        ranges: Ranges ``path=lower..upper``. A path may be the end of dotted paths: ``pid.kp`` matches all
            paths that end in it; ``kp`` too, with one variable per kind of section (``pid.kp``,
            ``joint_pd.kp``).

    Raises:
        ScenarioError: If a text is no range, or its path matches no number.
    """
    scene = to_scene(scene)
    if not ranges:
        return scene
    variables: dict[str, dict[str, object]] = {}
    for text in ranges:
        match = RANGE.fullmatch(text.strip())
        try:
            if match is None:
                raise ValueError
            path, lower, upper = match["path"].strip(), float(match["lower"]), float(match["upper"])
        except ValueError:
            message = f"found {text!r}, allowed: PATH=LOWER..UPPER, for example kp=20..2000"
            raise ScenarioError(message, where="--vary") from None
        if not lower < upper:
            raise ScenarioError(
                f"lower must be below upper, found {lower:g} and {upper:g}", where=f"--vary {path}"
            )
        for name, paths in _named(scene, path).items():
            if name in variables:
                raise ScenarioError(f"{name} is given a range already", where=f"--vary {text}")
            scale = "log" if lower > 0 and upper / lower >= LARGE_RATIO else "linear"
            variables[name] = {"paths": paths, "lower": lower, "upper": upper, "scale": scale}
    changes: dict[str, object] = {"tuning": {"variables": variables}}
    if scene.scenario.tuning is not None:
        changes = {"tuning.sets": {}, "tuning.variables": variables}
    elif scene.scenario.simulation.step is not None:
        changes["tuning.step"] = min(0.004, scene.scenario.simulation.step)
    return build_scene(scene.scenario, changes, source=scene.source)


def _named(scene: Scene, path: str) -> dict[str, list[str]]:
    """Paths of a scenario's numbers by the name of the variable that sets them."""
    document = to_document(scene.scenario)
    if path.partition(".")[0] in PLACES:
        try:
            expand(document, path)
        except ScenarioError as fault:
            raise scene.error(fault.message, f"--vary {path}") from None
        return {_name(path.split(".")[-2:]): [path]}
    number_paths = [p for p, _ in numbers({place: document[place] for place in PLACES if document[place]})]
    ending = [p for p in number_paths if p.endswith(f".{path}")]
    if not ending:
        hint = near_names(
            path, {p.rpartition(".")[2] for p in number_paths if not p.rpartition(".")[2].isdecimal()}
        )
        message = f"no number's path ends in {path!r}; {hint}"
        raise scene.error(message, "--vary")
    paths_by_name: dict[str, list[str]] = {}
    for number in ending if "." not in path else ():
        paths_by_name.setdefault(_name(number.split(".")[-2:]), []).append(number)
    return paths_by_name if len(paths_by_name) > 1 else {_name(path.split(".")): ending}


def _name(segments: Sequence[str]) -> str:
    name = re.sub(r"[^\w-]", "_", "_".join(segments), flags=re.ASCII)
    return name if name[0].isalpha() else f"_{name}"
