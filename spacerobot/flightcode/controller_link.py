"""Processor in the loop: a controller that answers over a socket or a serial line."""

from __future__ import annotations

import binascii
import os
import select
import socket
import struct
from pathlib import Path
from typing import Protocol

import numpy as np

from spacerobot.common.arrays import Array
from spacerobot.common.errors import SpaceRobotError
from spacerobot.flightcode.c_source import interface_signature
from spacerobot.flightcode.onboard import OnboardSoftware, Task

TIMEOUT_S = 10.0
"""Time within which a processor must answer [s]."""

PREFIXES = ("tcp:", "serial:")
"""Beginnings of addresses of processors."""


MAX_PAYLOAD = 0xFFFF
"""Largest payload of a frame [bytes]: its length is a number of 16 bits."""


class ByteStream(Protocol):
    """Two-way stream of bytes.

    Both methods raise ``TimeoutError`` after :data:`TIMEOUT_S`, and ``OSError`` if the connection fails.
    """

    def send(self, data: bytes) -> None:
        """Send all bytes."""

    def receive(self, size: int) -> bytes:
        """Receive from one to ``size`` bytes; empty if the other side closed the stream."""


class SocketStream:
    """Stream over a connected socket."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        connection.settimeout(TIMEOUT_S)

    def send(self, data: bytes) -> None:
        """See :class:`ByteStream`."""
        self._socket.sendall(data)

    def receive(self, size: int) -> bytes:
        """See :class:`ByteStream`."""
        return self._socket.recv(size)


class SerialStream:
    """Stream over a serial line or a pseudo-terminal.

    Args:
        device: Path of the device.
        baud: Baud rate of the line [1/s]; unchanged if None.
    """

    def __init__(self, device: Path, baud: int | None = None) -> None:
        import termios
        import tty

        # non-blocking: a line whose other side does not read must not block a write
        self._file = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self._file)
        if baud is not None:
            speed = getattr(termios, f"B{baud}", None)
            if speed is None:
                raise SpaceRobotError(
                    f"found {baud} baud, allowed: a standard rate such as 115200", source=device
                )
            settings = termios.tcgetattr(self._file)
            settings[4] = settings[5] = speed
            termios.tcsetattr(self._file, termios.TCSANOW, settings)
        termios.tcflush(self._file, termios.TCIFLUSH)  # answers to an earlier simulation

    def send(self, data: bytes) -> None:
        """See :class:`ByteStream`."""
        while data:
            _, ready, _ = select.select([], [self._file], [], TIMEOUT_S)
            if not ready:
                raise TimeoutError
            data = data[os.write(self._file, data) :]

    def receive(self, size: int) -> bytes:
        """See :class:`ByteStream`."""
        ready, _, _ = select.select([self._file], [], [], TIMEOUT_S)
        if not ready:
            raise TimeoutError
        return os.read(self._file, size)


def open_stream(address: str) -> ByteStream:
    """Open the stream of an address, ``tcp:HOST:PORT``, ``serial:DEVICE`` or ``serial:DEVICE@BAUD``.

    Raises:
        SpaceRobotError: If the address is not valid, or the connection fails.
    """
    kind, _, place = address.partition(":")
    try:
        if kind == "tcp":
            host, _, port = place.rpartition(":")
            return SocketStream(socket.create_connection((host or "localhost", int(port)), TIMEOUT_S))
        device, _, baud = place.partition("@")
        return SerialStream(Path(device), int(baud) if baud else None)
    except (OSError, ValueError) as error:
        raise SpaceRobotError(
            f"{error}; allowed: tcp:HOST:PORT, serial:DEVICE, serial:DEVICE@BAUD", where=address
        ) from None


class ControllerLink:
    """Controller on a processor behind a stream; see :class:`ControllerLibrary`.

    Args:
        stream: The stream.
        software: Software exported from the scenario that it is to control.
        address: Address of the processor for messages.

    Raises:
        SpaceRobotError: If the software needs frames that are too long, or the processor does not answer,
            ends the connection, or runs other software.
    """

    def __init__(self, stream: ByteStream, software: OnboardSoftware, address: str = "processor") -> None:
        self.software, self._stream, self._address = software, stream, address
        self.tick = 0
        self.longest_step_s = 0.0
        inputs, states, commands = (
            sum(one.size for one in fields)
            for fields in (software.inputs, software.states, software.commands)
        )
        longest = 8 * (max(inputs, states + commands) + 1)
        if longest > MAX_PAYLOAD:
            raise SpaceRobotError(
                f"found a frame of {longest} bytes, allowed over a link: {MAX_PAYLOAD}; a library has no "
                "limit",
                where=address,
            )
        signature = self._request(b"H", 65)[:64].decode("ascii", "replace")
        if signature != interface_signature(software):
            raise SpaceRobotError(
                f"the processor has other fields or rates than those of the scenario {software.title!r}; "
                "export it again",
                where=address,
            )
        self._request(b"I", 0)
        self._states, self._commands = states, commands
        self._transitions = [task.name for task in software.entries]

    def step(self, inputs: Array) -> tuple[Array, Array]:
        """Run one step on the processor; see :class:`ControllerLibrary`."""
        size = 8 * (self._states + self._commands + 1)
        numbers = np.frombuffer(self._request(b"S", size, np.asarray(inputs, "<f8").tobytes()), "<f8")
        self.tick += 1
        self.longest_step_s = max(self.longest_step_s, float(numbers[-1]))
        return numbers[: self._states].copy(), numbers[self._states : -1].copy()

    def enter(self, transition: Task, inputs: Array, time: float) -> Array:
        """Begin a phase on the processor; see :class:`ControllerLibrary`."""
        content = np.concatenate([[time], inputs]).astype("<f8").tobytes()
        index = self._transitions.index(transition.name)
        return np.frombuffer(self._request(b"E", 8 * self._states, content, index), "<f8").copy()

    def _request(self, kind: bytes, size: int, content: bytes = b"", transition: int = 0) -> bytes:
        """Send a frame and return the payload of the answer, which has ``size`` bytes."""
        body = kind + struct.pack("<BH", transition, len(content)) + content
        try:
            self._stream.send(b"SR" + body + struct.pack("<H", checksum(body)))
            head = self._receive(6)
            payload = self._receive(struct.unpack("<H", head[4:])[0])
            check = struct.unpack("<H", self._receive(2))[0]
        except TimeoutError:
            raise SpaceRobotError(
                f"the processor gave no answer for {TIMEOUT_S:g} s; is it running?", where=self._address
            ) from None
        except OSError as error:
            raise SpaceRobotError(
                f"the connection to the processor ended ({error.strerror or error}); is it running?",
                where=self._address,
            ) from None
        if head[:2] != b"SR" or check != checksum(head[2:] + payload):
            raise SpaceRobotError(
                "found a damaged answer of the processor; check the line", where=self._address
            )
        if head[2:3] != kind or len(payload) != size:
            raise SpaceRobotError(
                f"the processor refused request {kind.decode()}: it runs software of another interface",
                where=self._address,
            )
        return payload

    def _receive(self, size: int) -> bytes:
        """Receive exactly ``size`` bytes."""
        received = b""
        while len(received) < size:
            part = self._stream.receive(size - len(received))
            if not part:
                raise ConnectionError("closed by the processor")
            received += part
        return received


def checksum(content: bytes) -> int:
    """CRC-16/CCITT-FALSE of some bytes: polynomial 0x1021, beginning with 0xFFFF."""
    return binascii.crc_hqx(content, 0xFFFF)
