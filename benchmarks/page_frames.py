"""Frame rate of the servicer's page, and processor time of a frame at each level of quality."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from benchmarks.process_tree import tree_s
from benchmarks.table_row import Row
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.page.page import write_animation
from viz.recording.browser import Browser, chromium

SIZE = {"width": 1400, "height": 900, "deviceScaleFactor": 1, "mobile": False}
LEVELS, PICTURES, WARM, CORES = 6, 20, 5, 2
FRAME_MS = 1000 / 20  # 20 pictures a second
DRAW = """(async (level, count) => {
  spacerobotFilm.level(level);
  for (let k = 0; k < count; k++) {
    spacerobotFilm.draw(5 + 0.05 * k);
    await new Promise(requestAnimationFrame); // until the page is put together too
  }
})(LEVEL, COUNT)"""
SETTLE_S, LASTS_S = 6, 8
PLAY = """(async (settle, lasts) => {
  const frame = () => new Promise(requestAnimationFrame), wait = async (seconds) => {
    const begin = performance.now();
    let count = 0, last = "";
    while (performance.now() - begin < 1000 * seconds) {
      await frame();
      if (document.body.dataset.time !== last) count++; // another moment is shown
      last = document.body.dataset.time;
    }
    return (1000 * count) / (performance.now() - begin);
  };
  await wait(settle);
  return [await wait(lasts), spacerobotFilm.shown()];
})(SETTLE, LASTS)"""


def rows() -> list[Row]:
    """Row of the frame rate, and rows of the processor time of a frame at 1400 x 900 at each level."""
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        if browser is None:
            return [Row("pictures of the servicer's page", "", "", note="not measured: no Chromium here")]
        file = Path(folder) / "page.html"
        write_animation(simulate(load_scene("servicer")), file)
        browser.call("Page.enable")
        browser.call("Emulation.setDeviceMetricsOverride", **SIZE)
        _open(browser, file, "play=0")
        spent = []
        for level in range(LEVELS):
            text = DRAW.replace("LEVEL", str(level))
            browser.evaluate(text.replace("COUNT", str(WARM)))
            begin = _browser_ms()
            browser.evaluate(text.replace("COUNT", str(PICTURES)))
            spent.append((_browser_ms() - begin) / PICTURES)
        playing = _playing(browser, file)
    levels = [
        Row(
            f"a picture of the servicer's page in software, level {level} of quality",
            f"{CORES} cores, 20 pictures a second",
            f"{ms:.0f} ms of processor time",
            f"{CORES * FRAME_MS:.0f} ms",
            ms / (CORES * FRAME_MS),
            "at most 1 at the coarsest",
            ms <= CORES * FRAME_MS if level == LEVELS - 1 else None,
            "the page goes to the next level where pictures take more than 45 ms",
            {"processor_ms": ms},
        )
        for level, ms in enumerate(spent)
    ]
    return [playing, *levels]


def _open(browser: Browser, file: Path, state: str) -> None:
    browser.call("Page.navigate", url="about:blank")
    browser.call("Page.navigate", url=f"{file.as_uri()}#t=0&{state}")
    browser.wait_for("document.body?.dataset.ready === 'true'")


def _playing(browser: Browser, file: Path) -> Row:
    """Row of the frame rate after the page has chosen its level of quality."""
    _open(browser, file, "play=1")
    begin_ms = _browser_ms()
    pictures, level = browser.evaluate(PLAY.replace("SETTLE", str(SETTLE_S)).replace("LASTS", str(LASTS_S)))
    busy = (_browser_ms() - begin_ms) / 1000 / (SETTLE_S + LASTS_S)
    return Row(
        "pictures a second of the servicer's page while it plays, 1400 x 900, drawn in software",
        f"{CORES} cores",
        f"{pictures:.0f}",
        "20",
        pictures / 20,
        "at least 1",
        pictures >= 20,
        f"at level {level} of quality, chosen by the page; {busy:.1f} processors busy of {os.cpu_count()}, "
        f"load {os.getloadavg()[0]:.0f}",
        {"pictures_a_second": pictures, "level": level},
    )


def _browser_ms() -> float:
    return 1000 * sum(tree_s().values())
