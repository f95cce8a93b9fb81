"""Recordings without a display: GIF, PNG, and MP4 where ffmpeg is installed.

They show the page's scene, rendered by a headless Chromium if one is installed, otherwise by the built-in
renderer.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image, ImageChops

from spacerobot.common.arrays import Array
from spacerobot.common.errors import ResultError, near_names
from spacerobot.common.files import StrPath, write_bytes
from spacerobot.result import Result, note_derived
from viz.drawing.motion import BodyMotion, greatest_force, pick_rows, sample_motion
from viz.drawing.projection import fit
from viz.drawing.view import View, view_of
from viz.figures.base_actuation import draw_plumes
from viz.figures.docking import draw_forces, draw_frame, draw_names, seen_points
from viz.figures.style import COLOURS, Drawing, styled
from viz.page.animation import animation
from viz.recording.browser import program as browser_program
from viz.recording.page_pictures import FINE, page_pictures

USUAL: dict[str, tuple[float, tuple[int, int]]] = {
    ".gif": (12.5, (640, 400)),
    ".mp4": (30.0, (1280, 720)),
}
"""Frames per second, and width and height in pixels, of each format where nothing else is said."""

POSTER = 2560, 1440
"""Width and height of one picture, in pixels."""

WIDTH_IN = 6.4
"""Width of a picture to which the sizes of its texts and lines relate."""

Progress = Callable[[str], None]
T = TypeVar("T")
GIF_COLOURS = {Image.Quantize.MEDIANCUT: 48, Image.Quantize.MAXCOVERAGE: 32}
"""Colours of a GIF by how they are chosen: frequent ones for surfaces, ones far apart for thin lines."""

_UNSEEN = 12  # of 255, in each channel
COARSE_MM = 0.5
"""Maximum tip error of a recording [mm] from which on errors have two decimals; below, two digits."""
_LONGEST_S = 20
_MP4_FILTERS = "pad=ceil(iw/2)*2:ceil(ih/2)*2,tpad=stop_mode=clone:stop_duration=1"
_LONGEST_ARROW = 0.06  # as a share of the scene's size


def write_recording(
    result: Result,
    path: StrPath,
    *,
    frames_per_s: float | None = None,
    speed: float | None = None,
    size_px: tuple[int, int] | None = None,
    progress: Progress | None = None,
) -> None:
    """Write a recording of a result.

    Args:
        result: Result to record; a diverged one up to its end.
        path: File with the suffix ``.gif``, or ``.mp4``, which needs ffmpeg.
        frames_per_s, size_px: Frame rate [1/s], and width and height [pixels]; None takes those of
            :data:`USUAL`.
        speed: Simulated seconds per second; None chooses it such that the recording lasts at most 20 s.
        progress: Callback that receives the progress as text.

    Raises:
        ResultError: If the format is not known, ffmpeg is missing or fails, or the file cannot be written.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in USUAL:
        raise ResultError(f"no recording {path.suffix!r}; {near_names(kind, USUAL)}", source=path)
    program = shutil.which("ffmpeg") if kind == ".mp4" else ""
    if program is None:
        raise ResultError("MP4 needs ffmpeg, which is not installed; record a .gif", source=path)
    per_s, size = frames_per_s or USUAL[kind][0], size_px or USUAL[kind][1]
    duration = float(result.data.time.values[-1])
    pace = speed or max(1.0, duration / _LONGEST_S)
    encoded: Iterable[bytes]
    pictures: Iterator[Image.Image]
    if browser_program() is None:
        film_frames = frames(result, rate_hz=per_s / pace, size_px=size, speed=pace)
        pictures = _counted(film_frames, len(film_frames), progress)
        encoded = (picture.tobytes() for picture in pictures)
        form = ["-f", "rawvideo", "-pixel_format", "rgb24", "-video_size", f"{size[0]}x{size[1]}"]
    else:
        times = [*np.arange(0, duration, pace / per_s), duration]
        encoded = _counted(page_pictures(animation(result), times, size), len(times), progress)
        pictures = (Image.open(io.BytesIO(picture)).convert("RGB") for picture in encoded)
        form = ["-f", "image2pipe", "-c:v", "mjpeg"]
    content = _mp4(program, encoded, form, per_s, path) if kind == ".mp4" else _gif(pictures, per_s)
    write_bytes(path, content)
    note_derived([result.folder], [path])


def write_poster(
    result: Result,
    path: StrPath,
    *,
    at: float | None = None,
    size_px: tuple[int, int] = POSTER,
    pixel_ratio: float = 1.0,
) -> None:
    """Write one picture of a result as PNG, with the finest level of detail.

    Args:
        result: Result to show.
        path: File with the suffix ``.png``.
        at: Time [s]; None takes the first capture, or the middle if there is none.
        size_px: Width and height [pixels].
        pixel_ratio: Factor by which Chromium enlarges texts, for pictures that are shown small.

    Raises:
        ResultError: If the result has no such time, or the file cannot be written.
    """
    duration = float(result.data.time.values[-1])
    if at is not None and not 0 <= at <= duration:
        message = f"found {at:g} s, allowed: 0 to {duration:g} s, the times of the result"
        raise ResultError(message, source=result.folder, where="at")
    captures = [e["time_s"] for e in result.summary.get("events", ()) if e["kind"] == "captured"]
    time = at if at is not None else float(min(captures, default=duration / 2))
    if browser_program() is not None:
        (content,) = page_pictures(
            animation(result), [time], size_px, level=FINE, kind="png", pixel_ratio=pixel_ratio
        )
    else:
        pictures, buffer = frames(result, rate_hz=1e6, size_px=size_px), io.BytesIO()
        pictures.picture(int(np.abs(pictures.motion.time - time).argmin())).save(buffer, "PNG")
        content = buffer.getvalue()
    write_bytes(path, content)
    note_derived([result.folder], [Path(path)])


def _counted(pictures: Iterable[T], count: int, progress: Progress | None) -> Iterator[T]:
    """Iterator over pictures that reports the progress after every tenth."""
    for k, picture in enumerate(pictures):
        if progress is not None and k % 10 == 0:
            progress(f"recording: {100 * k // count} %")
        yield picture


def frames(
    result: Result, *, rate_hz: float, size_px: tuple[int, int] = (640, 400), speed: float = 1.0
) -> Frames:
    """Pictures of a result at evenly spaced times; each shows ``speed`` if it is not 1."""
    scene = result.scene()
    motion = sample_motion(result, scene, pick_rows(result.data.time.values, rate_hz=rate_hz, most=2000))
    return Frames(result, motion, view_of(result, scene), seen_points(result, motion), size_px, speed)


@dataclass(frozen=True, eq=False)
class Frames:
    """Pictures of a result, each drawn on request.

    Attributes:
        result, motion, view: Result, its sampled motion, and the direction of view.
        points: Points that all pictures include (k, 3) [m].
        size_px: Width and height [pixels].
        speed: Simulated seconds per second.
    """

    result: Result
    motion: BodyMotion
    view: View
    points: Array
    size_px: tuple[int, int]
    speed: float

    def __len__(self) -> int:
        return len(self.motion.time)

    def __iter__(self) -> Iterator[Image.Image]:
        return map(self.picture, range(len(self)))

    @styled
    def picture(self, index: int) -> Image.Image:
        """The picture of a frame."""
        width, height = self.size_px
        figure = Drawing(figsize=(WIDTH_IN, WIDTH_IN * height / width), dpi=width / WIDTH_IN)
        canvas: Any = FigureCanvasAgg(figure)
        panel = figure.add_axes((0, 0, 1, 1))
        fit(panel, self.points, self.view, shape=height / width)
        # what room there is beside the scene is at the left, where the texts are
        right = float(self.view.flat(self.points)[:, 0].max())
        low, high = panel.get_xlim()
        spare = max(0.0, high - right - 0.04 * (high - low))
        panel.set_xlim(low - spare, high - spare)
        draw_frame(panel, self.result, self.motion, index, self.view, width / WIDTH_IN)
        longest = _LONGEST_ARROW * float(np.linalg.norm(np.ptp(self.points, axis=0)))
        draw_plumes(panel, self.result, self.motion, index, self.view, longest)
        if self.newtons > 0:
            draw_forces(panel, self.result, self.motion, index, self.view, longest / self.newtons)
        draw_names(panel, self.motion, index, self.view)
        panel.set_axis_off()
        # Time, tip errors, what is drawn, and whether it ended here.
        at: dict[str, Any] = {"transform": panel.transAxes, "va": "top", "zorder": 10}
        at["bbox"] = {"facecolor": "white", "alpha": 0.75, "linewidth": 0, "pad": 1.5}
        pace = "" if self.speed == 1 else f"   {self.speed:g} × real time"
        panel.text(0.015, 0.97, f"t = {self.motion.time[index]:.1f} s{pace}", fontsize=12, **at)
        row, data = int(self.motion.rows[index]), self.result.data
        for k, tip in enumerate(self.result.led_tips):
            error = np.linalg.norm(data.tip_error.sel(tip=tip).values[row]) * 1e3
            number = f"{error:.2f}" if self.largest_error_mm >= COARSE_MM else f"{error:.2g}"
            text = f"{tip} error {number} mm"
            panel.text(0.015, 0.89 - 0.055 * k, text, fontsize=9, color=COLOURS[k % 2], **at)
        legend = "dashed: where bodies began" + (" and references of tips" if self.result.led_tips else "")
        kinds = [kind for kind in ("grasp", "contact") if data.sizes.get(kind)]
        what = " and ".join(kinds).replace("grasp", "grip")
        arrows = f"; arrows: {what} forces, at most {self.newtons:.3g} N" if self.newtons > 0 else ""
        plumes = "; cones: plumes of thrusters" if "thruster" in data.dims else ""
        panel.text(0.015, 0.045, legend + arrows + plumes, fontsize=7.5, color="0.35", **at)
        if not self.result.completed and index == len(self) - 1:
            end: dict[str, Any] = {"ha": "center", "color": "#B00020", "fontsize": 20}
            panel.text(0.5, 0.5, "diverged", transform=panel.transAxes, **end)
        canvas.draw()
        return Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")

    @cached_property
    def largest_error_mm(self) -> float:
        """Largest tip error of the result [mm]; 0 without controlled tips."""
        errors = self.result.data.tip_error.sel(tip=list(self.result.led_tips)).values
        return float(np.nanmax(np.linalg.norm(errors, axis=-1), initial=0.0)) * 1e3

    @cached_property
    def newtons(self) -> float:
        """Force of the longest arrow, N."""
        return greatest_force(self.result)


def _gif(pictures: Iterator[Image.Image], frames_per_s: float) -> bytes:
    """One palette for all frames, so that what stands still costs nothing."""
    all_pictures = list(steady(pictures))
    palette = palette_of(all_pictures[len(all_pictures) // 2], GIF_COLOURS)
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


def palette_of(picture: Image.Image, counts: Mapping[Image.Quantize, int]) -> Image.Image:
    """Image with a palette of a picture's colours.

    Args:
        picture: The picture.
        counts: Number of colours to choose, by method of quantisation.
    """
    palette, colours = Image.new("P", (1, 1)), list[int]()
    for method, count in counts.items():
        entries = picture.quantize(count, method=method).getpalette() or []
        colours += (entries + 3 * count * [0])[: 3 * count]
    palette.putpalette(colours)
    return palette


def steady(pictures: Iterable[Image.Image]) -> Iterator[Image.Image]:
    """Pictures in which pixels with only small changes, as from compression, keep their previous colour."""
    previous: Image.Image | None = None
    for picture in pictures:
        if previous is None:
            previous = picture
        else:
            red, green, blue = ImageChops.difference(picture, previous).split()
            most = ImageChops.lighter(ImageChops.lighter(red, green), blue)
            previous = Image.composite(
                picture, previous, most.point([255 * (v > _UNSEEN) for v in range(256)])
            )
        yield previous


def _mp4(program: str, pictures: Iterable[bytes], form: list[str], frames_per_s: float, path: Path) -> bytes:
    """Bytes of an MP4 (H.264) that browsers can play and that shows the last picture for a second.

    Args:
        program: Path of ffmpeg.
        pictures: Encoded or raw pictures.
        form: Options of ffmpeg for the format of the pictures.
        frames_per_s: Frame rate [1/s].
        path: File of the recording, for errors.
    """
    with tempfile.TemporaryDirectory() as folder:
        film, errors = Path(folder) / "made.mp4", Path(folder) / "errors.txt"
        command = [program, "-loglevel", "error", *form, "-framerate", f"{frames_per_s:g}"]
        command += ["-i", "pipe:0", "-vf", _MP4_FILTERS, "-preset", "veryfast"]
        command += ["-crf", "20", "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(film)]
        with errors.open("wb") as stderr:
            process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=stderr
            )
            # until it closes its input, or ends
            try:
                if process.stdin is not None:
                    with suppress(BrokenPipeError), process.stdin as sink:
                        for picture in pictures:
                            sink.write(picture)
                process.wait()
            finally:
                if process.poll() is None:
                    process.kill()
                    process.wait()
        if process.returncode:
            message = errors.read_text(encoding="utf-8", errors="replace").strip()
            raise ResultError(f"ffmpeg failed: {message[-300:]}", source=path)
        return film.read_bytes()
