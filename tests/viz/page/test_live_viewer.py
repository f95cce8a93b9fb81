"""The live viewer: on loopback only, past busy ports, for nobody but this computer's own page."""

import http.client
import re
import signal
import socket
import threading
import webbrowser
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from spacerobot.common.registry import COMMANDS
from spacerobot.scene import load_scene
from viz.page.live import LiveViewer
from viz.page.loopback import ADDRESS
from viz.page.notebook import embed


@pytest.fixture
def viewer():
    with LiveViewer(7400) as made:
        yield made


def _get(viewer, path="/", headers=None, **more):
    connection = http.client.HTTPConnection(ADDRESS, viewer.port, timeout=5)
    connection.request("GET", path, headers=headers or {}, **more)
    return connection.getresponse()


def _listeners(port):
    """Local addresses (hexadecimal, as the kernel writes them) that listen on a port."""
    found = []
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text().splitlines()[1:]:
            local, state = line.split()[1], line.split()[3]
            if state == "0A" and int(local.rpartition(":")[2], 16) == port:
                found.append(local.rpartition(":")[0])
    return found


def test_it_listens_on_loopback_only(viewer):
    assert _get(viewer).status == 200
    assert _listeners(viewer.port) == ["0100007F"]
    outward = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    for address in outward - {ADDRESS}:
        if address.startswith("127."):
            continue
        with pytest.raises((ConnectionRefusedError, TimeoutError)):
            socket.create_connection((address, viewer.port), timeout=1)


UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA==",
}


def test_it_answers_no_foreign_page(viewer):
    assert _get(viewer, "/stream", UPGRADE | {"Origin": "http://evil.example"}).status == 403
    own = UPGRADE | {"Origin": f"http://{ADDRESS}:{viewer.port}"}
    assert _get(viewer, "/stream", own).status == 101


@pytest.mark.parametrize(
    "host", ["evil.example:{}", "evil.example", "127.0.0.1", "127.0.0.1:{}.evil.example"]
)
def test_it_answers_under_its_own_name_alone(viewer, host):
    """A foreign name that leads here makes its page one origin with this server: Origin equals Host."""
    named = {"Host": host.format(viewer.port)}
    for path in ("/", "/favicon.ico", "/stream"):
        assert _get(viewer, path, named).status == 403, path
        assert _get(viewer, path, named | UPGRADE).status == 403, path
    assert _get(viewer, "/stream", named | UPGRADE | {"Origin": f"http://{named['Host']}"}).status == 403
    assert _get(viewer, "/favicon.ico").status == 404


def test_a_busy_port_is_stepped_over(viewer):
    with LiveViewer(viewer.port) as second:
        assert second.port > viewer.port
        assert _get(second).status == 200


def test_nothing_listens_once_it_is_closed():
    viewer = LiveViewer(7400)
    viewer.close()
    assert _listeners(viewer.port) == []


def test_a_page_follows_a_run(browser, viewer, paper):
    viewer.show_scene(load_scene("paper"))
    browser.open(viewer.url)
    browser.wait_for("document.body?.dataset.shown === '1'")
    assert browser.evaluate("document.getElementById('play').disabled")
    viewer.tell("rolling out: 40 %")
    browser.wait_for("document.getElementById('busy').innerText.startsWith('rolling out: 40 %')")
    assert browser.evaluate("document.querySelector('#busy progress').value") == 40
    viewer.show(paper)
    browser.wait_for("document.body.dataset.shown === '2' && Number(document.body.dataset.time) > 0.2")
    assert "rpr1 tip error" in browser.evaluate("document.getElementById('readout').innerText")
    assert browser.evaluate("document.getElementById('busy').hidden")
    assert viewer.wait_for_page(0)
    assert browser.errors == []
    assert {url.split("/")[2] for url in browser.requests if "://" in url} == {f"{ADDRESS}:{viewer.port}"}


def test_a_page_that_opens_late_misses_nothing(browser, viewer):
    viewer.show_scene(load_scene("paper"))
    viewer.tell("compiling")
    browser.open(viewer.url)
    browser.wait_for("document.body?.dataset.shown === '1'")
    browser.wait_for("document.getElementById('busy').innerText.startsWith('compiling')")
    names = browser.evaluate("[...document.querySelectorAll('#labels .name')].map((e) => e.textContent)")
    assert names == ["rpr1", "rpr2", "rectangle"]


def test_waiting_ends_with_an_interrupt_and_without_a_fault(viewer):
    threading.Timer(0.2, signal.raise_signal, [signal.SIGINT]).start()
    viewer.wait()
    assert _get(viewer).status == 200


def test_any_port_is_the_one_it_says():
    with LiveViewer(0) as viewer:
        assert viewer.port > 0
        assert _get(viewer).status == 200


def test_a_browser_in_the_terminal_is_not_opened(viewer, monkeypatch):
    monkeypatch.delenv("BROWSER", raising=False)
    monkeypatch.setattr(webbrowser, "get", lambda: webbrowser.GenericBrowser("w3m"))
    monkeypatch.setattr(webbrowser.GenericBrowser, "open", lambda *_, **__: pytest.fail("was opened"))
    assert not viewer.open()


def test_commands_serve_at_the_port_given_and_print_the_address_alone(paper, monkeypatch):
    """A terminal takes what follows an address at once for a part of it."""
    monkeypatch.setattr(LiveViewer, "open", lambda _: False)
    monkeypatch.setattr(LiveViewer, "wait", lambda _: None)
    app = typer.Typer()
    for name in ("animate", "run"):
        COMMANDS.find(name).join(app)
    short = ["--set", "simulation.duration=0.02", "--backend", "interpreted"]
    for words in (["animate", str(paper.folder), "--no-browser"], ["run", "paper", "--view", *short]):
        done = CliRunner().invoke(app, [*words, "--port", "7430"])
        assert done.exit_code == 0
        assert re.search(r"http://127\.0\.0\.1:74[3-9]\d/(\s|$)", done.output), done.output


def test_notebooks_embed_the_page_whole(paper):
    text = embed(paper)._repr_html_()
    assert text.startswith('<iframe loading="lazy" sandbox="allow-scripts allow-downloads"')
    assert text.count("<") == 2  # its own opening and closing tag: all else is escaped
