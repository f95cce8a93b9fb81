"""The studio's server: for this computer, and for who knows the token, alone."""

import asyncio
import http.client
import json

import pytest
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect

import spacerobot as sr
from spacerobot.common.errors import SpaceRobotError
from tests.viz.page.test_live_viewer import UPGRADE
from viz.page.loopback import ADDRESS
from viz.studio.messages import MOST_BYTES, MOST_VALUES, read


@pytest.fixture(scope="module")
def studio(arm):
    with sr.studio(sr.load_scene(arm), folder=str(arm.parent / "kept"), port=7700) as served:
        yield served


def test_a_named_scenario_starts_with_changes_at_the_address_of_the_waiting_page(arm, tmp_path):
    addresses, steps = [], []
    started = {"on_start": lambda page: addresses.append(page.url), "progress": steps.append}
    with sr.studio(arm, {"simulation.duration": 0.5}, folder=tmp_path, port=7720, **started) as studio:
        assert addresses == [studio.url]
        assert studio.scene.scenario.simulation.duration == 0.5
        changed = studio.session.origin.build({"target.links.body.mass": 30})
    assert changed.scenario.simulation.duration == 0.5
    assert changed.scenario.target.links["body"].mass == 30
    assert "building the closed loop" in steps
    with sr.studio(sr.load_scene(arm), {"simulation.duration": 0.4}, folder=tmp_path, port=7720) as studio:
        assert studio.scene.scenario.simulation.duration == 0.4


def _get(studio, path, headers=None):
    connection = http.client.HTTPConnection(ADDRESS, studio.port, timeout=10)
    connection.request("GET", path, headers=headers or {})
    return connection.getresponse()


def test_who_does_not_know_the_token_gets_nothing(studio):
    own = {"Origin": f"http://{ADDRESS}:{studio.port}"}
    for query in ("", "?token=", "?token=%C3%A4", f"?token={studio.token[:-1]}", f"?token={studio.token}x"):
        assert _get(studio, f"/{query}").status == 403
        assert _get(studio, f"/studio{query}", UPGRADE | own).status == 403
    assert _get(studio, f"/?token={studio.token}").status == 200
    assert _get(studio, f"/studio?token={studio.token}", UPGRADE | own).status == 101


def test_who_knows_it_must_be_this_computer_and_this_page(studio):
    known = f"token={studio.token}"
    for host in ("evil.example", f"evil.example:{studio.port}", f"{ADDRESS}:{studio.port}.evil.example"):
        named = {"Host": host, "Origin": f"http://{host}"}
        assert _get(studio, f"/?{known}", named).status == 403
        assert _get(studio, f"/studio?{known}", UPGRADE | named).status == 403
    for origin in ("http://evil.example", f"http://{ADDRESS}:{studio.port + 1}", "null"):
        assert _get(studio, f"/studio?{known}", UPGRADE | {"Origin": origin}).status == 403
    assert _get(studio, f"/../../etc/passwd?{known}").status == 404


def test_a_page_goes_on_after_nonsense_and_ends_with_what_is_too_large(studio):
    async def talk():
        address = f"ws://{ADDRESS}:{studio.port}/studio?token={studio.token}"
        page = await websocket_connect(address, max_message_size=10**8)
        told = []
        for text in ("{", '{"type": "eval"}', '{"type": "set", "values": [1]}', "[" * 5000):
            await page.write_message(text)
        while len(told) < 4:
            message = await asyncio.wait_for(page.read_message(), 60)
            if isinstance(message, str) and json.loads(message)["type"] == "failed":
                told.append(json.loads(message)["message"])
        await page.write_message('{"type": "command"}')
        while isinstance(message, bytes) or json.loads(message)["type"] != "command":
            message = await asyncio.wait_for(page.read_message(), 60)
        await page.write_message("x" * (MOST_BYTES + 1))
        while message is not None:
            message = await asyncio.wait_for(page.read_message(), 60)
        return told

    told = asyncio.run(talk())
    assert "no JSON" in told[0]
    assert "no known type" in told[1]
    assert _get(studio, f"/?token={studio.token}").status == 200


def test_a_foreign_page_cannot_connect(studio):
    async def connect():
        request = HTTPRequest(
            f"ws://{ADDRESS}:{studio.port}/studio?token={studio.token}",
            headers={"Origin": "http://evil.example"},
        )
        await websocket_connect(request)

    with pytest.raises(HTTPClientError, match="403"):
        asyncio.run(connect())


def test_messages_hold_no_more_than_is_sane():
    with pytest.raises(SpaceRobotError, match="at most"):
        read(json.dumps({"type": "set", "values": dict.fromkeys(map(str, range(MOST_VALUES + 1)), 1)}))
    with pytest.raises(SpaceRobotError, match="seq"):
        read('{"type": "set", "seq": true}')


@pytest.mark.parametrize("kind", ["set", "gradient", "improve", "tune", "campaign", "save", "command"])
@pytest.mark.parametrize(
    ("written", "told"),
    [
        ("[" * 900 + "1" + "]" * 900, "nested too deeply, allowed: 16 levels"),
        ("[" * 100_000 + "]" * 100_000, "nested too deeply"),
        ("1" + "0" * 400, "found inf, allowed: a finite number smaller than 1e\\+300"),
        ("-1" + "0" * 300, r"found -1e\+300"),
        ("9" * 5000, "found inf"),
        ("1e999", "found inf"),
        ("NaN", "found nan"),
    ],
)
def test_messages_are_neither_deep_nor_infinite(kind, written, told):
    for text in (
        f'{{"type": "{kind}", "values": {{"robots.a.b": {written}}}}}',
        f'{{"type": "{kind}", "spreads": {{"robots.a.b": {{"kind": "uniform", "upper": {written}}}}}}}',
    ):
        with pytest.raises(SpaceRobotError, match=told) as found:
            read(text).check()
        assert len(str(found.value)) < 200
    assert read('{"type": "set", "values": {"a": 12345678901234567890}}').values == {
        "a": 12345678901234567890
    }


def test_a_notebook_shows_it_in_a_cell(studio):
    assert f'<iframe src="{studio.url}"' in studio._repr_html_()
