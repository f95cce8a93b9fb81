"""Time from a changed number on the studio's page to its motion, and rollouts per second while dragging."""

from __future__ import annotations

import asyncio
import json
import tempfile
import time
from pathlib import Path
from typing import Any

from tornado.websocket import WebSocketClientConnection, websocket_connect

from benchmarks.table_row import Row, hand_row
from spacerobot.scene import load_scene
from viz.studio.prepared_design import Origin
from viz.studio.server import Studio

WARM, COUNT = 20, 200
DRAG_S, EVERY_S = 4.0, 1 / 120
PATH = "robots.rpr1.tips.tip.pid.kp"


def rows() -> list[Row]:
    """Rows of single changes and of a continuous drag of `paper`, both through the page's connection."""
    with tempfile.TemporaryDirectory() as folder:
        origin = Origin(load_scene("paper"), "paper")
        with Studio(origin, Path(folder)) as studio:
            values = asyncio.run(_measured(studio))
    times, cpu_s, sent = values["times"], values["cpu_s"], values["bytes"]
    what = "the paper's studio: a number changed to its motion, curves and metrics received"
    cost = f"{cpu_s * 1e3:.0f} ms of processor time; {sent / 1e3:.0f} kB, without the browser's drawing"
    return [
        hand_row(what, times, cost, {"times_s": times, "cpu_s": cpu_s}),
        Row(
            "rollouts a second while a slider is dragged",
            "",
            f"{values['drag']:.0f}",
            note=f"{1 / EVERY_S:.0f} changes a second sent for {DRAG_S:g} s; the last one answered last",
        ),
    ]


async def _measured(studio: Studio) -> dict[str, Any]:
    """Times of single changes [s], processor time [s] and bytes of one, and rollouts per second of a drag."""
    base, _, token = studio.url.partition("?")
    address = f"{base.replace('http', 'ws')}studio?{token}"
    page = await websocket_connect(address, max_message_size=2**30)
    await _rollout(page)
    times, used, size = [], 0.0, 0
    for k in range(WARM + COUNT):
        begin, cpu = time.perf_counter(), time.process_time()
        await page.write_message(_change(k))
        size = (await _rollout(page))[1]
        times.append(time.perf_counter() - begin)
        used += (time.process_time() - cpu) * (k >= WARM)
    return {"times": times[WARM:], "cpu_s": used / COUNT, "bytes": size, "drag": await _drag(page)}


async def _drag(page: WebSocketClientConnection) -> float:
    """Rollouts a second while changes come faster than they can be rolled out."""
    count, last = int(DRAG_S / EVERY_S), 0

    async def send() -> None:
        for k in range(count):
            await page.write_message(_change(k))
            await asyncio.sleep(EVERY_S)

    begin, answered, hand = time.perf_counter(), 0, asyncio.create_task(send())
    while last < count - 1:
        last, answered = (await _rollout(page))[0], answered + 1
    await hand
    return answered / (time.perf_counter() - begin)


def _change(k: int) -> str:
    return json.dumps({"type": "set", "seq": k, "values": {PATH: 300.0 + 0.5 * k}})


async def _rollout(page: WebSocketClientConnection) -> tuple[int, int]:
    """Number and size [bytes] of the next received rollout, including its arrays."""
    while True:
        text = await page.read_message()
        assert isinstance(text, str)
        message = json.loads(text)
        arrays = await page.read_message() if "binary" in message else b""
        if message["type"] == "rollout":
            return message["seq"], len(text) + len(arrays or b"")
