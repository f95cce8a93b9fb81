"""A compiled controller: a shared library of exported flight code, called in this process."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from spacerobot.closedloop import ClosedLoop
from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.common.files import StrPath
from spacerobot.flightcode.c_source import interface_signature, work_size
from spacerobot.flightcode.controller_link import PREFIXES, ControllerLink, open_stream
from spacerobot.flightcode.extract import onboard_software
from spacerobot.flightcode.onboard import Field, OnboardSoftware, Task
from spacerobot.scene import Scene


class OnboardController(Protocol):
    """Software that is stepped from outside: a library in this process, or a processor behind a link.

    Attributes:
        software: The software that it was exported from.
    """

    software: OnboardSoftware

    @property
    def tick(self) -> int:
        """Number of the next step."""
        ...

    def step(self, inputs: Array) -> tuple[Array, Array]:
        """Run one step; all inputs (n,) in, all states and commands out."""
        ...

    def enter(self, transition: Task, inputs: Array, time: float) -> Array:
        """Begin a phase at a time [s]; all states out."""
        ...


class ControllerLibrary:
    """Shared library of exported flight code.

    It runs with the rights of this process: load only what you built yourself.

    Args:
        path: The library.
        software: Software exported from the scenario that it is to control.

    Raises:
        SpaceRobotError: If it cannot be loaded, or was exported from another scenario.
    """

    def __init__(self, path: StrPath, software: OnboardSoftware) -> None:
        self.software, self.path = software, Path(path).resolve()
        if not self.path.is_file():
            raise SpaceRobotError("no such file; allowed: a library built from an export", source=Path(path))
        try:
            self._library = ctypes.CDLL(str(self.path))
        except OSError as error:
            raise SpaceRobotError(f"cannot be loaded: {error}", source=Path(path)) from None
        name = software.name
        try:
            signature = (ctypes.c_char * 65).in_dll(self._library, f"{name}_signature").value.decode()
            size = ctypes.c_uint32.in_dll(self._library, f"{name}_real_size").value
        except ValueError:
            raise SpaceRobotError(
                f"found no controller {name!r} in it, allowed: one that was exported from the scenario "
                f"{software.title!r}",
                source=self.path,
            ) from None
        if signature != interface_signature(software):
            raise SpaceRobotError(
                f"found other fields or rates than those of the scenario {software.title!r}; export it again",
                source=self.path,
            )
        self._real: Any = np.float64 if size == 8 else np.float32
        count = {kind: sum(one.size for one in fields) for kind, fields in self._structs.items()}
        self._inputs = np.zeros(max(count["inputs"], 1), self._real)
        self._outputs = np.zeros(count["outputs"], self._real)
        # the struct ends with the number of the tick, 4 bytes in the place of a real number
        self._states = count["state"]
        place = count["state"] + work_size(software)
        self._state = np.zeros(place + 2, self._real)
        self._tick = self._state[place:].view(np.uint32)[:1]
        self._call("init", self._state)

    @property
    def _structs(self) -> dict[str, Sequence[Field]]:
        software = self.software
        return {"inputs": software.inputs, "state": software.states, "outputs": software.commands}

    @property
    def tick(self) -> int:
        """Number of the next step."""
        return int(self._tick[0])

    def step(self, inputs: Array) -> tuple[Array, Array]:
        """Run one step.

        Args:
            inputs: All inputs in the order of the header (n,).

        Returns:
            tuple: All states, and all commands.
        """
        self._inputs[: len(inputs)] = inputs
        self._call("step", self._state, self._inputs, self._outputs)
        return self._state[: self._states].astype(float), self._outputs.astype(float)

    def enter(self, transition: Task, inputs: Array, time: float) -> Array:
        """Begin a phase.

        Args:
            transition: One of the software's entries.
            inputs: All inputs (n,) at that time.
            time: Time at which it begins [s].

        Returns:
            numpy.ndarray: All states.
        """
        self._inputs[: len(inputs)] = inputs
        real = ctypes.c_double if self._real is np.float64 else ctypes.c_float
        self._call(transition.name, self._state, self._inputs, time=real(time))
        return self._state[: self._states].astype(float)

    def _call(self, name: str, *arrays: npt.NDArray[Any], time: Any = None) -> None:
        function = getattr(self._library, f"{self.software.name}_{name}")
        function.restype = None
        pointers = [ctypes.c_void_p(array.ctypes.data) for array in arrays]
        function(*pointers, *([] if time is None else [time]))


def loaded_controller(
    controller: StrPath | OnboardController, scene: Scene, loop: ClosedLoop
) -> OnboardController:
    """Return the controller, loaded if it is the path of a library.

    Args:
        controller: Path of a library; address of a processor, ``tcp:HOST:PORT`` or ``serial:DEVICE``; or a
            controller.
        scene, loop: Prepared scene and its closed loop, as for
            :func:`spacerobot.flightcode.extract.onboard_software`.

    Raises:
        SpaceRobotError: As for :class:`ControllerLibrary`.
    """
    if isinstance(controller, str) and controller.startswith(PREFIXES):
        return ControllerLink(open_stream(controller), onboard_software(scene, loop), controller)
    if isinstance(controller, str | os.PathLike):
        return ControllerLibrary(controller, onboard_software(scene, loop))
    return controller
