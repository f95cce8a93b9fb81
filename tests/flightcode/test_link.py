"""Link to a processor: whatever the other side does ends in one line."""

import os
import socket
import struct
import threading
import tty

import pytest

import spacerobot as sr
from spacerobot.common.errors import SpaceRobotError
from spacerobot.flightcode import controller_link
from spacerobot.flightcode.c_source import interface_signature
from spacerobot.flightcode.controller_link import ControllerLink, checksum, open_stream
from tests.flightcode.conftest import software_of

SMALL = "examples/as-flown.yaml"


@pytest.fixture(scope="module")
def software():
    return software_of(sr.load_scene(SMALL))


def frame(kind, payload):
    body = kind + struct.pack("<BH", 0, len(payload)) + payload
    return b"SR" + body + struct.pack("<H", checksum(body))


def hello(software):
    return frame(b"H", interface_signature(software).encode() + b"\x08")


@pytest.fixture
def link(software):
    """Function from the answers of a processor, after which it closes the connection, to the link."""
    servers, threads = [], []

    def connect(*answers):
        server = socket.create_server(("localhost", 0))
        servers.append(server)

        def serve():
            connection, _ = server.accept()
            with connection:
                for answer in answers:
                    connection.recv(65536)
                    connection.sendall(answer)

        threads.append(threading.Thread(target=serve))
        threads[-1].start()
        address = f"tcp:localhost:{server.getsockname()[1]}"
        return ControllerLink(open_stream(address), software, address)

    yield connect
    for thread in threads:
        thread.join(10)
    for server in servers:
        server.close()


def test_a_closed_connection_is_named(link):
    with pytest.raises(SpaceRobotError, match=r"tcp:localhost:\d+: the connection to the processor ended"):
        link()


def test_a_frame_that_ends_early_is_named(link, software):
    with pytest.raises(SpaceRobotError, match=r"ended \(closed by the processor\)"):
        link(hello(software)[:20])


def test_another_signature_is_refused(link):
    with pytest.raises(SpaceRobotError, match="other fields or rates"):
        link(frame(b"H", b"0" * 64 + b"\x08"))


def test_a_damaged_answer_is_refused(link, software):
    damaged = bytearray(hello(software))
    damaged[12] ^= 1
    with pytest.raises(SpaceRobotError, match="damaged answer"):
        link(bytes(damaged))


def test_a_processor_that_ends_during_the_simulation_is_named(link, software):
    connected = link(hello(software), frame(b"I", b""))
    inputs = [0.0] * sum(one.size for one in software.inputs)
    for _ in range(2):  # the first request may still be accepted by the closed socket
        with pytest.raises(SpaceRobotError, match="the connection to the processor ended"):
            connected.step(inputs)


def test_an_answer_of_another_length_is_refused(link, software):
    connected = link(hello(software), frame(b"I", b""), frame(b"S", b"\x00" * 8))
    with pytest.raises(SpaceRobotError, match="refused request S"):
        connected.step([0.0])


def test_silence_ends_after_the_time_limit(monkeypatch, software):
    monkeypatch.setattr(controller_link, "TIMEOUT_S", 0.05)
    near, far = os.openpty()
    tty.setraw(near)
    try:
        with pytest.raises(SpaceRobotError, match=r"no answer for 0\.05 s"):
            ControllerLink(open_stream(f"serial:{os.ttyname(far)}"), software)
    finally:
        os.close(near)
        os.close(far)


def test_frames_that_are_too_long_are_refused(link, monkeypatch):
    monkeypatch.setattr(controller_link, "MAX_PAYLOAD", 80)
    with pytest.raises(SpaceRobotError, match="allowed over a link: 80"):
        link()
