"""Recordings: they move, and need no display."""

import io
import json
import shutil
import stat
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from spacerobot.common.errors import ResultError
from viz.page.animation import animation
from viz.recording import record
from viz.recording.browser import program as browser_program
from viz.recording.page_pictures import page_pictures
from viz.recording.record import frames, write_recording


@pytest.fixture(autouse=True)
def _no_browser(monkeypatch):
    monkeypatch.setattr(record, "browser_program", lambda: None)


def test_a_gif_moves_at_the_wanted_pace(paper, tmp_path):
    path = tmp_path / "docking.gif"
    write_recording(paper, path, frames_per_s=2, speed=2, size_px=(320, 200))
    with Image.open(path) as gif:
        assert gif.size == (320, 200)
        assert gif.n_frames == 11
        assert gif.info["duration"] == 500
        first = np.asarray(gif.convert("RGB")).astype(int)
        gif.seek(5)
        assert (np.abs(np.asarray(gif.convert("RGB")) - first).sum(axis=2) > 60).mean() > 0.02


@pytest.mark.skipif(
    not (shutil.which("ffmpeg") and shutil.which("ffprobe")),
    reason="no ffmpeg on this computer: no MP4 was recorded",
)
def test_an_mp4_is_what_browsers_play_and_moves(paper, tmp_path):
    path, heard = tmp_path / "docking.MP4", []
    write_recording(paper, path, frames_per_s=2, speed=2, size_px=(321, 201), progress=heard.append)
    wanted = ["-show_entries", "stream=codec_name,pix_fmt,width,height,nb_frames", "-of", "json"]
    found = subprocess.run(["ffprobe", "-v", "error", *wanted, path], capture_output=True, check=True)
    video = json.loads(found.stdout)["streams"][0]
    assert (video["codec_name"], video["pix_fmt"]) == ("h264", "yuv420p")
    assert (video["width"], video["height"]) == (322, 202)  # even, as the codec wants
    assert int(video["nb_frames"]) == 11 + 2  # the last one held for a second
    assert heard == ["recording: 0 %", "recording: 90 %"]
    decode = ["ffmpeg", "-v", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(decode, capture_output=True, check=True).stdout
    shown = np.frombuffer(raw, dtype=np.uint8).reshape(-1, 202, 322, 3).astype(int)
    drawn = np.asarray(frames(paper, rate_hz=1, size_px=(321, 201), speed=2).picture(5)).astype(int)
    # colours are quartered in number and compressed: bodies stay where they were drawn
    assert (np.abs(shown[5, :201, :321] - drawn).sum(axis=2) > 120).mean() < 0.01
    assert (np.abs(shown[5] - shown[0]).sum(axis=2) > 120).mean() > 0.02


def test_what_ffmpeg_reports_is_told(paper, tmp_path, monkeypatch):
    program = tmp_path / "ffmpeg"
    program.write_text("#!/bin/sh\necho 'no such codec' >&2\nexit 1\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setattr(record.shutil, "which", lambda _: str(program))
    with pytest.raises(ResultError, match="ffmpeg failed: no such codec"):
        write_recording(paper, tmp_path / "a.mp4", frames_per_s=1, speed=10, size_px=(320, 200))
    assert not (tmp_path / "a.mp4").exists()


def test_the_end_of_a_diverged_run_says_so(diverged):
    *_, last = frames(diverged, rate_hz=5, size_px=(320, 200))
    red = np.asarray(last).astype(int)
    assert ((red[:, :, 0] > 150) & (red[:, :, 1] < 40) & (red[:, :, 2] < 60)).sum() > 50


def test_wrong_formats_and_a_missing_ffmpeg_are_told(paper, tmp_path, monkeypatch):
    with pytest.raises(ResultError, match=r"allowed: \.gif, \.mp4"):
        write_recording(paper, tmp_path / "a.avi")
    monkeypatch.setattr(record.shutil, "which", lambda _: None)
    with pytest.raises(ResultError, match="needs ffmpeg"):
        write_recording(paper, tmp_path / "a.mp4")


def test_films_of_the_documentation_are_quick_to_load():
    films = {
        file.name: file.stat().st_size for file in (Path(__file__).parents[2] / "docs/images").glob("*.gif")
    }
    assert set(films) >= {"docking.gif", "studio.gif"}
    assert max(films.values()) < 400e3, films


@pytest.mark.skipif(
    browser_program() is None, reason="no Chromium on this computer: the page was not recorded"
)
def test_a_page_is_recorded_as_it_is_seen(paper):
    """Pictures of the scene alone, of the wanted size, that move, and are the same when taken again."""
    payload = animation(paper)
    first, later, again = (
        np.asarray(Image.open(io.BytesIO(one)).convert("RGB")).astype(int)
        for one in page_pictures(payload, [0.0, 6.0, 0.0], (320, 200), kind="png")
    )
    assert first.shape == (200, 320, 3)
    assert (np.abs(later - first).max(axis=2) > 40).mean() > 0.01
    assert (first == again).all()


@pytest.mark.skipif(
    browser_program() is None, reason="no Chromium on this computer: the page was not recorded"
)
def test_texts_of_a_picture_that_is_shown_small_are_larger(paper):
    payload, light = animation(paper), []
    for pixel_ratio in (1, 2):
        (content,) = page_pictures(payload, [0.0], (640, 400), kind="png", pixel_ratio=pixel_ratio)
        picture = np.asarray(Image.open(io.BytesIO(content)).convert("RGB"))
        assert picture.shape == (400, 640, 3)
        light.append((picture[-60:].min(axis=2) > 200).sum())  # letters of the caption
    assert light[1] > 2 * light[0] > 0, light
