"""``python -m benchmarks.studio_recording FILE``: the README's recording of the studio, made by Chromium."""

from __future__ import annotations

import base64
import io
import sys
import tempfile
import time
from pathlib import Path

from PIL import Image

from spacerobot.common.files import write_bytes
from spacerobot.scene import load_scene
from viz.recording.browser import Browser, chromium
from viz.recording.record import palette_of, steady
from viz.studio.prepared_design import Origin
from viz.studio.server import Studio

SIZE, WIDTH = (1180, 760), 760
MOST_OF_SEARCH = 10  # pictures
COLOURS = {Image.Quantize.MEDIANCUT: 96, Image.Quantize.MAXCOVERAGE: 48}
"""Numbers of colours of the recording: frequent ones, for the sky, and distant ones, for thin lines."""
BAR = "document.querySelector('.slider input[type=range]')"
WORDS = "document.querySelector('#jobs .words').textContent"
EXACT = "!/being computed|finite differences/.test(document.getElementById('slopes-notice').textContent)"
SETTLED = "!document.getElementById('status').classList.contains('busy')"


def record(browser: Browser, url: str) -> list[tuple[Image.Image, int]]:
    """Pictures and their durations [ms]: a slider is dragged, then the gradient is followed."""
    wide, high = SIZE
    browser.call("Page.enable")
    browser.call(
        "Emulation.setDeviceMetricsOverride", width=wide, height=high, deviceScaleFactor=1, mobile=False
    )
    dark = [{"name": "prefers-color-scheme", "value": "dark"}]
    browser.call("Emulation.setEmulatedMedia", features=dark)
    browser.call("Page.navigate", url=f"{url}#t=3.2&play=0")
    browser.wait_for("document.querySelector('.slider .gradient')?.textContent.includes('+10 %')")
    browser.wait_for(EXACT)
    browser.evaluate("document.getElementById('sort').click()")
    pictures = [(_picture(browser), 1500)]
    begin, end = (int(browser.evaluate(f"{BAR}.value")), 250)
    for k in range(1, 15):
        browser.evaluate(f"{BAR}.value = {begin + (end - begin) * k // 14}")
        browser.evaluate(f"{BAR}.dispatchEvent(new Event('input'))")
        browser.wait_for(SETTLED)
        pictures.append((_picture(browser), 120))
    browser.evaluate(f"{BAR}.dispatchEvent(new Event('change'))")
    time.sleep(0.5)
    pictures.append((_picture(browser), 1500))
    browser.evaluate("document.querySelector('#jobs .improve').click()")
    search = []
    while not browser.evaluate(f"{WORDS}.startsWith('done')"):
        search.append((_picture(browser), 160))
    pictures += search[:: -(-len(search) // MOST_OF_SEARCH) or 1]
    time.sleep(0.5)
    pictures.append((_picture(browser), 2500))
    return pictures


def _picture(browser: Browser) -> Image.Image:
    shot = browser.call("Page.captureScreenshot", format="png")["data"]
    picture = Image.open(io.BytesIO(base64.b64decode(shot))).convert("RGB")
    return picture.resize((WIDTH, WIDTH * SIZE[1] // SIZE[0]), Image.Resampling.LANCZOS)


def main() -> None:
    """Record, and write the file."""
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        if browser is None:
            sys.exit("error: no Chromium on this computer")
        with Studio(Origin(load_scene("paper"), "paper"), Path(folder)) as studio:
            shots = record(browser, studio.url)
    palette = palette_of(shots[-1][0], COLOURS)
    pictures = steady(picture for picture, _ in shots)
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    content = io.BytesIO()
    frames[0].save(
        content,
        "GIF",
        save_all=True,
        append_images=frames[1:],
        duration=[ms for _, ms in shots],
        loop=0,
        optimize=True,
    )
    write_bytes(Path(sys.argv[1]), content.getvalue())


if __name__ == "__main__":
    main()
