"""Cost of a picture of the servicer's page at each level of quality, drawn in software by Chromium."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from benchmarks.table_row import Row
from spacerobot.scene import load_scene
from spacerobot.simulation import simulate
from viz.browser import chromium
from viz.page.page import write_animation

SIZE = {"width": 1400, "height": 900, "deviceScaleFactor": 1, "mobile": False}
LEVELS, PICTURES, WARM, CORES = 6, 20, 5, 2
WANTED_MS = 1000 / 20  # 20 pictures a second
DRAW = """(async (level, count) => {
  spacerobotFilm.level(level);
  for (let k = 0; k < count; k++) {
    spacerobotFilm.draw(5 + 0.05 * k);
    await new Promise(requestAnimationFrame); // until the page is put together too
  }
})(LEVEL, COUNT)"""


def rows() -> list[Row]:
    """A row for each level: processor time of a picture of the page at 1400 x 900, all processes together."""
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        if browser is None:
            return [Row("pictures of the servicer's page", "", "", note="not measured: no Chromium here")]
        file = Path(folder) / "page.html"
        write_animation(simulate(load_scene("servicer")), file)
        browser.call("Page.enable")
        browser.call("Emulation.setDeviceMetricsOverride", **SIZE)
        browser.call("Page.navigate", url=f"{file.as_uri()}#t=5&play=0")
        browser.wait_for("document.body?.dataset.ready === 'true'")
        spent = []
        for level in range(LEVELS):
            text = DRAW.replace("LEVEL", str(level))
            browser.evaluate(text.replace("COUNT", str(WARM)))
            begin = processor_ms()
            browser.evaluate(text.replace("COUNT", str(PICTURES)))
            spent.append((processor_ms() - begin) / PICTURES)
    return [
        Row(
            f"a picture of the servicer's page in software, level {level} of quality",
            f"{CORES} cores, 20 pictures a second",
            f"{ms:.0f} ms of processor time",
            f"{CORES * WANTED_MS:.0f} ms",
            ms / (CORES * WANTED_MS),
            "at most 1 at the coarsest",
            ms <= CORES * WANTED_MS if level == LEVELS - 1 else None,
            "the page goes to the next level where pictures take more than 45 ms",
            {"processor_ms": ms},
        )
        for level, ms in enumerate(spent)
    ]


def processor_ms() -> float:
    """Processor time of all processes that this one has started, and theirs [ms] (Linux)."""
    children: dict[int, list[tuple[int, int]]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                fields = (entry / "stat").read_text().rsplit(")", 1)[1].split()
            except OSError:
                continue
            spent = int(fields[11]) + int(fields[12])
            children.setdefault(int(fields[1]), []).append((int(entry.name), spent))
    total, open_ = 0, [os.getpid()]
    while open_:
        for process, spent in children.get(open_.pop(), []):
            total += spent
            open_.append(process)
    return 1000 * total / os.sysconf("SC_CLK_TCK")
