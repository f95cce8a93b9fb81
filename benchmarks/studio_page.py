"""Time from a moved slider to the painted frame, and motions per second of a drag, in headless Chromium."""

from __future__ import annotations

import os
import statistics
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.table_row import Row, hand_row
from spacerobot.scene import load_scene
from viz.recording.browser import NO_3D, Browser, chromium
from viz.studio.prepared_design import Origin
from viz.studio.server import Studio

WARM, COUNT = 10, 100
DRAG_S = 4.0
SLIDER = "document.querySelector('.slider input[type=range]')"
PAINTED = """(async (count) => {
  const bar = SLIDER, times = [], pause = (ms) => new Promise((ok) => setTimeout(ok, ms));
  const painted = () => new Promise((ok) => requestAnimationFrame(() => {
    const after = new MessageChannel(); // its turn comes when the frame is done
    after.port1.onmessage = ok;
    after.port2.postMessage(0);
  }));
  const view = document.querySelector("#pane canvas")?.getContext("webgl2");
  const pixel = new Uint8Array(4); // to read one waits for all that is drawn before it
  const finished = () => view?.readPixels(0, 0, 1, 1, view.RGBA, view.UNSIGNED_BYTE, pixel);
  for (let k = 0; k < count; k++) {
    const { drawn } = document.body.dataset, begin = performance.now();
    bar.value = 100 + (7 * k) % 200;
    bar.dispatchEvent(new Event("input"));
    while (document.body.dataset.drawn === drawn) await pause(0);
    await painted();
    const frame = performance.now();
    finished();
    times.push([(frame - begin) / 1000, (performance.now() - begin) / 1000]);
    bar.dispatchEvent(new Event("change"));
    await pause(30);
  }
  return times;
})(COUNT)"""
DRAGGED = """(async (lasts) => {
  const bar = SLIDER, begin = performance.now(), first = Number(document.body.dataset.drawn);
  for (let k = 0; performance.now() - begin < 1000 * lasts; k++) {
    bar.value = 100 + k % 250;
    bar.dispatchEvent(new Event("input"));
    await new Promise((ok) => requestAnimationFrame(ok));
  }
  const drawn = Number(document.body.dataset.drawn) - first, lasted = (performance.now() - begin) / 1000;
  bar.dispatchEvent(new Event("change"));
  return drawn / lasted;
})(LASTS)"""


def rows() -> list[Row]:
    """Rows of the studio of `paper` with its three-dimensional view, drawn by the processor, and without."""
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        if browser is None:
            return [Row("the paper's studio in a browser", "", "", note="not measured: no Chromium here")]
        with Studio(Origin(load_scene("paper"), "paper"), Path(folder)) as studio:
            latencies = _measured(browser, studio)
            browser.call("Page.enable")
            browser.call("Page.addScriptToEvaluateOnNewDocument", source=NO_3D)
            flat = _measured(browser, studio)
    view = "three-dimensional view drawn in software, without a graphics processor"
    return [_row(view, latencies), _row("without the three-dimensional view", flat)]


def _measured(browser: Browser, studio: Studio) -> dict[str, Any]:
    """Times from a slider's event to the frame and to the drawn view [s]; motions per second of a drag."""
    browser.call("Page.navigate", url="about:blank")
    browser.call("Page.navigate", url=f"{studio.url}#t=5&play=0")
    browser.wait_for("document.querySelector('.slider .gradient')?.textContent.includes('+10 %')")
    browser.wait_for("document.getElementById('slopes-notice').hidden")  # nothing is compiled any more
    both = browser.evaluate(PAINTED.replace("SLIDER", SLIDER).replace("COUNT", str(WARM + COUNT)))[WARM:]
    times, finished = zip(*both, strict=True)
    drag = browser.evaluate(DRAGGED.replace("SLIDER", SLIDER).replace("LASTS", str(DRAG_S)))
    return {"times_s": times, "finished_s": finished, "drag": drag, "load": os.getloadavg()[0]}


def _row(how: str, measured: dict[str, Any]) -> Row:
    finished = measured["finished_s"]
    quantiles = statistics.median(finished), statistics.quantiles(finished, n=20)[-1]
    note = (
        f"until the view's last pixel is drawn {quantiles[0] * 1e3:.0f} and {quantiles[1] * 1e3:.0f} ms; "
        f"dragging {measured['drag']:.0f} motions a second drawn; "
        f"load {measured['load']:.0f} on {os.cpu_count()} cores"
    )
    return hand_row(
        f"the paper's studio: a slider moved to the frame painted, {how}", measured["times_s"], note, measured
    )
