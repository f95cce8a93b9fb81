"""Functional mock-up unit of a scene's plant, as bytes."""

from __future__ import annotations

import io
import platform
import re
import sys
import tempfile
import zipfile
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from spacerobot.closedloop import build_closed_loop, build_commanded_loop
from spacerobot.common.errors import CompileError, ScenarioError, SpaceRobotError
from spacerobot.common.progress import tell
from spacerobot.compiled import NO_COMPILER, Toolchain, find_toolchain
from spacerobot.compiled.build import SourceUnit, build
from spacerobot.fmu.model_description import Fmi, UnitDescription, build_description, model_description
from spacerobot.fmu.ports import find_ports
from spacerobot.fmu.sources import plant_sources
from spacerobot.rollout import time_grid
from spacerobot.rollout.kernel import build_kernel
from spacerobot.rollout.methods import METHODS
from spacerobot.scenario import Robot
from spacerobot.scene import Scene
from spacerobot.simulation import prepare_simulation, sampled_steps
from spacerobot.updates.scheme import UpdatedScene

PLATFORMS: Mapping[tuple[str, str], Mapping[int, str]] = {
    ("linux", "x86_64"): {2: "linux64", 3: "x86_64-linux"},
    ("linux", "aarch64"): {2: "linux-aarch64", 3: "aarch64-linux"},
}
"""Folder of binaries by operating system, processor and version of FMI."""

NO_DATE = (1980, 1, 1, 0, 0, 0)
"""Date of all files in the archive, fixed so that the same scene gives the same bytes."""


def build_fmu(
    scene: Scene,
    *,
    fmi: Fmi = 3,
    is_open: bool = False,
    vary: Collection[str] = (),
) -> bytes:
    """Functional mock-up unit for co-simulation of a scene, with binary and sources.

    Args:
        scene: The scene.
        fmi: Version of the standard: 2 or 3.
        is_open: Whether actuator commands replace all controllers. Robots without controllers always take
            commands.
        vary: Numbers to keep as parameters although they are exactly zero, by dotted path.

    Raises:
        ScenarioError: If Python updates a controller, as model predictive control does, or a name cannot be
            that of an FMU's variable.
        CompileError: If there is no compiler, compilation fails, or FMI names no binaries for this machine.
    """
    folders = PLATFORMS.get((sys.platform, platform.machine().lower()))
    if folders is None:
        raise CompileError(
            f"found {sys.platform} on {platform.machine()}, allowed for an FMU: Linux on x86_64 or aarch64"
        )
    toolchain = find_toolchain()
    if toolchain is None:
        raise CompileError(f"an FMU is compiled: {NO_COMPILER}")
    scene = _with_held_values(scene) if is_open else _without_updates(scene)
    robots = [body.name for body in scene.robots if is_open or not _is_controlled(scene, body.name)]
    loop, commands = (
        build_commanded_loop(scene, robots, vary) if robots else (build_closed_loop(scene, vary), ())
    )
    simulation = scene.scenario.simulation
    if simulation.step is None:
        grid = prepare_simulation(scene, loop, rollouts=1).rollout.grid
    else:
        grid = time_grid(simulation.duration, simulation.step, simulation.output_step)
    kernel = build_kernel(loop, method=METHODS[simulation.method])
    try:
        ports = find_ports(scene, loop, commands)
    except SpaceRobotError as error:
        raise scene.error(str(error)) from None
    token, sources = plant_sources(loop, kernel, sampled_steps(grid), ports, fmi)
    name = scene.scenario.name
    unit = UnitDescription(
        name,
        re.sub(r"\W|^(?=\d)", "_", name, flags=re.ASCII),
        " ".join((scene.scenario.description or "").split()),
        token,
        simulation.duration,
        grid.duration_s / grid.intervals,
        list(sources),
    )
    files = {"modelDescription.xml": model_description(unit, ports, fmi).encode()}
    files |= {f"sources/{file}": source.text.encode() for file, source in sources.items()}
    if fmi == 3:
        files["sources/buildDescription.xml"] = build_description(unit).encode()
    binary = _compile([*sources.values()], toolchain)
    return _archive(files | {f"binaries/{folders[fmi]}/{unit.identifier}.so": binary})


def _is_controlled(scene: Scene, robot: str) -> bool:
    """Whether a robot, or one of its tips, has a controller."""
    body = scene.body(robot)
    tips = [key for tip in scene.tips if tip.body.name == robot for key, _ in tip.config.elements()]
    return bool(tips) or (isinstance(body.config, Robot) and any(body.config.elements()))


def _with_held_values(scene: Scene) -> Scene:
    """Scene from which the controllers that Python updates can be built, so that their sensors measure."""
    updated = UpdatedScene.of(scene)
    return scene if updated is None else updated.scene


def _without_updates(scene: Scene) -> Scene:
    """The scene, if all its controllers are expressions; otherwise raise an error."""
    for body in scene.robots:
        assert isinstance(body.config, Robot)
        for key, controller in body.config.elements():
            if controller.update_scheme is not None:
                raise ScenarioError(
                    f"the controller ({controller.kind}) is updated by Python, which an FMU cannot contain; "
                    "with --open the FMU has the plant alone, and commands are its inputs",
                    source=scene.source,
                    where=f"{body.path}.{key}",
                )
    return scene


def _compile(units: Sequence[SourceUnit], toolchain: Toolchain) -> bytes:
    """Bytes of the shared library of some sources."""
    with tempfile.TemporaryDirectory(prefix="spacerobot-fmu-") as folder:
        return build(units, toolchain.portable, Path(folder), tell).read_bytes()


def _archive(files: Mapping[str, bytes]) -> bytes:
    """Zip file whose bytes depend only on its contents."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name in sorted(files, key=lambda name: (name != "modelDescription.xml", name)):
            entry = zipfile.ZipInfo(name, NO_DATE)
            entry.compress_type, entry.create_system, entry.external_attr = (
                zipfile.ZIP_DEFLATED,
                3,
                0o644 << 16,
            )
            archive.writestr(entry, files[name], compresslevel=6)
    return buffer.getvalue()
