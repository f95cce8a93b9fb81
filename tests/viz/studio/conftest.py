"""A small arm's studio, and pages that ask it, without a browser."""

import json
import threading

import numpy as np
import pytest

from spacerobot.scene import load_scene
from tests.oracles import one_arm
from viz.studio.prepared_design import Origin
from viz.studio.session import StudioSession


class Asker:
    """A page: what it was sent, decoded."""

    def __init__(self, session):
        self.session, self.heard, self.behind = session, [], False
        self._change = threading.Condition()

    def send(self, parts):
        """Keep a message; its arrays stand at their names."""
        message = json.loads(parts[0])
        flat = np.frombuffer(parts[1], "<f4") if len(parts) > 1 else np.empty(0)
        begin, message["arrays"] = 0, {}
        for entry in message.get("binary", ()):
            count = int(np.prod(entry["shape"]))
            message["arrays"][entry["name"]] = flat[begin : begin + count].reshape(entry["shape"])
            begin += count
        assert begin == len(flat)
        with self._change:
            self.heard.append(message)
            self._change.notify_all()

    def ask(self, kind, **more):
        """Ask the session."""
        self.session.ask(self, json.dumps({"type": kind, **more}))

    def take(self, *kinds, until=lambda _: True):
        """The next message of some kinds that fits; what came before it is dropped."""

        def place():
            return next((k for k, m in enumerate(self.heard) if m["type"] in kinds and until(m)), None)

        with self._change:
            assert self._change.wait_for(lambda: place() is not None, 60), [m["type"] for m in self.heard]
            found = self.heard[place()]
            del self.heard[: place() + 1]
            return found


@pytest.fixture(scope="package")
def arm(tmp_path_factory):
    """A scenario's file with a comment, to which nothing is written."""
    file = one_arm.write(tmp_path_factory.mktemp("studio"))
    file.write_text(f"# an arm of ours\n{file.read_text()}")
    return file


@pytest.fixture(scope="package")
def session(arm):
    """A session about that arm."""
    made = StudioSession(Origin(load_scene(arm), str(arm)), arm.parent / "kept")
    yield made
    made.close()


@pytest.fixture
def page(session):
    """A page that has been greeted."""
    asker = Asker(session)
    session.greet(asker)
    asker.hello = asker.take("hello")
    asker.first = asker.take("rollout")
    yield asker
    session.leave(asker)
