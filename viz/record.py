"""Recordings without a display: GIF, and MP4 where ffmpeg is installed."""

from __future__ import annotations

import io
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from spacerobot.errors import ResultError, near_names
from spacerobot.files import write_bytes
from spacerobot.result import Result
from viz.figures.docking import draw_frame
from viz.figures.style import COLOURS, Drawing, styled
from viz.motion import Motion, bounds, pick_rows, sample_motion
from viz.projection import fit, view_of

FORMATS = (".gif", ".mp4")
DPI = 100
_GIF_COLOURS = 96


def write_recording(
    path: Path,
    result: Result,
    *,
    frames_per_s: float = 12.5,
    speed: float | None = None,
    size_px: tuple[int, int] = (640, 400),
) -> None:
    """Write a recording of a result.

    Parameters
    ----------
    path
        ``.gif``, or ``.mp4``, which needs ffmpeg.
    result
        What to record; an unfinished one up to where it went.
    frames_per_s
        Of the recording.
    speed
        Simulated seconds per second; so that it lasts at most 10 s if not given.
    size_px
        Width and height.

    Raises
    ------
    ResultError
        If the format is not known, ffmpeg is missing, or the file cannot be written.
    """
    if path.suffix not in FORMATS:
        raise ResultError(f"no recording {path.suffix!r}; {near_names(path.suffix, FORMATS)}", source=path)
    duration = float(result.data.time.values[-1])
    rate = frames_per_s / (speed or max(1.0, duration / 10))
    pictures = frames(result, rate_hz=rate, size_px=size_px)
    content = _gif(pictures, frames_per_s) if path.suffix == ".gif" else _mp4(pictures, frames_per_s, path)
    write_bytes(path, content)


@styled
def frames(result: Result, *, rate_hz: float, size_px: tuple[int, int] = (640, 400)) -> Iterator[Image.Image]:
    """Pictures of a result at evenly spaced times."""
    scene = result.scene()
    view = view_of(scene.planar)
    motion = sample_motion(result, scene, pick_rows(result.data.time.values, rate_hz=rate_hz, most=2000))
    figure, (low, high) = Drawing(figsize=(size_px[0] / DPI, size_px[1] / DPI), dpi=DPI), bounds(motion)
    canvas: Any = FigureCanvasAgg(figure)
    panel = figure.add_axes((0, 0, 1, 1))

    def picture(index: int) -> Image.Image:
        panel.clear()
        draw_frame(panel, result, motion, index, view)
        fit(panel, low, high, view, shape=size_px[1] / size_px[0])
        panel.set_axis_off()
        _say(panel, result, motion, index)
        canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")

    return (picture(index) for index in range(len(motion.time)))


def _say(panel: Axes, result: Result, motion: Motion, index: int) -> None:
    """Time, tip errors, and whether it ended here."""
    at: dict[str, Any] = {"transform": panel.transAxes, "va": "top"}
    panel.text(0.015, 0.97, f"t = {motion.time[index]:.1f} s", fontsize=12, **at)
    row = int(motion.rows[index])
    for k, tip in enumerate(result.data.tip.values):
        error = np.linalg.norm(result.data.tip_error.sel(tip=tip).values[row]) * 1e3
        text = f"{tip} error {error:.2f} mm"
        panel.text(0.015, 0.89 - 0.055 * k, text, fontsize=9, color=COLOURS[k % 2], **at)
    if not result.completed and index == len(motion.time) - 1:
        panel.text(0.5, 0.5, "diverged", transform=panel.transAxes, ha="center", color="#B00020", fontsize=20)


def _gif(pictures: Iterator[Image.Image], frames_per_s: float) -> bytes:
    """One palette for all frames, so that what stands still costs nothing."""
    all_pictures = list(pictures)
    palette = all_pictures[len(all_pictures) // 2].quantize(_GIF_COLOURS, method=Image.Quantize.MEDIANCUT)
    white = [255 if value >= 248 else value for value in palette.getpalette() or []]
    palette.putpalette(white)  # the background stays what the page around it is
    flat = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in all_pictures]
    buffer = io.BytesIO()
    each_ms = round(1000 / frames_per_s / 10) * 10  # the format counts hundredths
    durations = [each_ms] * (len(flat) - 1) + [1500]
    flat[0].save(
        buffer, "GIF", save_all=True, append_images=flat[1:], duration=durations, loop=0, optimize=True
    )
    return buffer.getvalue()


def _mp4(pictures: Iterator[Image.Image], frames_per_s: float, path: Path) -> bytes:
    program = shutil.which("ffmpeg")
    if program is None:
        raise ResultError("MP4 needs ffmpeg, which is not installed; record a .gif", source=path)
    with tempfile.TemporaryDirectory() as folder:
        for k, picture in enumerate(pictures):
            picture.save(Path(folder) / f"{k:05d}.png")
        made = Path(folder) / "made.mp4"
        command = [
            program,
            "-loglevel",
            "error",
            "-framerate",
            f"{frames_per_s:g}",
            "-i",
            f"{folder}/%05d.png",
        ]
        command += ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", str(made)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise ResultError(f"ffmpeg failed: {done.stderr.strip()[-300:]}", source=path)
        return made.read_bytes()
