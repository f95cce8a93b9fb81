"""Exported code flies our plant as the simulated controllers do; a processor answers over a link."""

import os
import socket
import subprocess
import threading
import tty

import numpy as np
import pytest

import spacerobot as sr
from optim.planning.mpc.updates import MpcUpdates
from spacerobot.cli import app
from spacerobot.common.errors import SpaceRobotError
from spacerobot.flightcode.package import FLAGS
from tests.flightcode.conftest import FLOWN, SERVICER

SMALL = "examples/as-flown.yaml"
RENDEZVOUS = "examples/capture-rendezvous.yaml"


MOTION = ("q", "v", "joint_torque", "wheel_torque", "body_position", "measured_joint_position")
"""Motion and torques; statistics of filters are quotients of small numbers."""


def largest_difference(one, other, names=None):
    """Largest difference of two results, relative to the largest value of a variable if above 1."""
    assert set(one.data.data_vars) == set(other.data.data_vars)
    worst = 0.0
    for name, variable in one.data.data_vars.items():
        if names is not None and name not in names:
            continue
        a, b = variable.values, other.data[name].values
        assert a.shape == b.shape, name
        if a.dtype.kind != "f" or not np.isfinite(a).any():
            continue
        np.testing.assert_array_equal(np.isfinite(a), np.isfinite(b))
        good = np.isfinite(a)
        worst = max(worst, np.abs(a - b)[good].max() / max(1.0, np.abs(a[good]).max()))
    return worst


@pytest.mark.compiler
def test_a_trajectory_equals_that_of_the_simulated_controller(export):
    scene, _, folder = export(SMALL)
    flown = sr.simulate(scene, controller=folder / "libcontroller.so")
    assert largest_difference(sr.simulate(scene), flown) < 1e-12


@pytest.mark.compiler
def test_estimators_wheels_and_phases_fly_alike(export):
    scene, software, folder = export(RENDEZVOUS, SERVICER)
    assert software.flow is not None
    flown, simulated = (
        sr.simulate(scene, backend="interpreted", controller=one)
        for one in (folder / "libcontroller.so", None)
    )
    assert any(event["kind"] == "phase" for event in flown.summary["events"])
    assert largest_difference(simulated, flown, MOTION) < 1e-12


@pytest.mark.compiler
@pytest.mark.parametrize("name", FLOWN)
def test_the_capture_flies_to_its_end_under_the_same_plans(export, monkeypatch, name):
    """Plans are solved once: a solver amplifies the last bits of what it begins with."""
    scene, _, folder = export(name, FLOWN[name])
    plans = []
    show = MpcUpdates._show

    def recorded(self, rows, now):
        show(self, rows, now)
        if len(rows):
            plans.append(self.plant.parameters[:, self._computer.places].copy())

    monkeypatch.setattr(MpcUpdates, "_show", recorded)
    simulated = sr.simulate(scene, backend="interpreted")
    queue = iter(plans)

    def replayed(self, rows, now):
        if len(rows):
            self.plant.parameters[:, self._computer.places] = next(queue)

    monkeypatch.setattr(MpcUpdates, "_show", replayed)
    flown = sr.simulate(scene, backend="interpreted", controller=folder / "libcontroller.so")
    assert [event["name"] for event in flown.summary["events"]] == [
        event["name"] for event in simulated.summary["events"]
    ]
    assert any(event["kind"] == "captured" for event in flown.summary["events"])
    assert largest_difference(simulated, flown, ("q", "v", "body_position", "joint_position")) < 1e-12
    # the grip is stiff: its torques show the last bits of the motion magnified
    torques = {"joint_torque", "wheel_torque"} & {*simulated.data.data_vars}
    assert largest_difference(simulated, flown, torques) < 1e-10


@pytest.mark.compiler
def test_a_library_flies_another_plant(export):
    scene, _, folder = export(SMALL)
    heavier = sr.load_scene(SMALL, {"robots.arm.links.link_3.mass": 20.0})
    flown = sr.simulate(heavier, controller=folder / "libcontroller.so")
    assert largest_difference(sr.simulate(scene), flown) > 1e-3


@pytest.mark.compiler
def test_a_library_of_another_scenario_is_refused(export, tmp_path):
    _, _, folder = export(SMALL)
    library = folder / "libcontroller.so"
    with pytest.raises(SpaceRobotError, match="no controller 'capture_rendezvous' in it"):
        sr.simulate(sr.load_scene(RENDEZVOUS, SERVICER), controller=library)
    slower = sr.load_scene(SMALL, {"robots.arm.tips.tip.pid.sampled.period": 0.04})
    with pytest.raises(SpaceRobotError, match="other fields or rates"):
        sr.simulate(slower, controller=library)
    with pytest.raises(SpaceRobotError, match="no such file"):
        sr.simulate(SMALL, controller=tmp_path / "none.so")
    (tmp_path / "text.so").write_text("no library")
    with pytest.raises(SpaceRobotError, match="cannot be loaded"):
        sr.simulate(SMALL, controller=tmp_path / "text.so")


@pytest.mark.compiler
def test_the_command_line_flies_a_library(export, capsys):
    _, _, folder = export(SMALL)
    words = ["run", SMALL, "--set", "simulation.duration=0.5"]
    app.command_line()([*words, "--controller", str(folder / "libcontroller.so")], standalone_mode=False)
    assert "as-flown" in capsys.readouterr().out


@pytest.fixture
def processor(export, compiler):
    scene, software, folder = export(SMALL, {"simulation.duration": 0.5})
    target = folder / "processor"
    sources = ["processor_in_the_loop.c", f"{software.name}.c", f"{software.name}_functions.c"]
    subprocess.run([compiler, *FLAGS, *sources, "-o", target, "-lm"], cwd=folder, check=True)
    return scene, target


@pytest.mark.compiler
def test_a_processor_answers_over_a_socket(processor):
    scene, target = processor
    with socket.create_server(("localhost", 0)) as server:

        def serve():
            connection, _ = server.accept()
            with connection:
                subprocess.run([target], stdin=connection, stdout=connection, check=False)

        thread = threading.Thread(target=serve)
        thread.start()
        flown = sr.simulate(scene, controller=f"tcp:localhost:{server.getsockname()[1]}")
        thread.join(10)
    assert largest_difference(sr.simulate(scene), flown) < 1e-12


@pytest.mark.compiler
def test_a_processor_answers_over_a_serial_line(processor):
    scene, target = processor
    near, far = os.openpty()
    tty.setraw(near)
    tty.setraw(far)
    board = subprocess.Popen([target], stdin=near, stdout=near)
    try:
        flown = sr.simulate(scene, controller=f"serial:{os.ttyname(far)}")
    finally:
        board.terminate()
        board.wait()
        os.close(near)
        os.close(far)
    assert largest_difference(sr.simulate(scene), flown) < 1e-12


@pytest.mark.compiler
def test_a_damaged_frame_is_refused(processor):
    _, target = processor
    frame = b"SRH\x00\x00\x00\x00\x00"
    done = subprocess.run([target], input=frame, capture_output=True, check=False)
    assert done.stdout[:3] == b"SR?"


def test_an_address_where_nothing_answers_is_refused():
    with socket.create_server(("localhost", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(SpaceRobotError, match=f"tcp:localhost:{port}"):
        sr.simulate(SMALL, controller=f"tcp:localhost:{port}")
