"""Recordings: they move, and need no display."""

import numpy as np
import pytest
from PIL import Image

from spacerobot.errors import ResultError
from viz import record
from viz.record import frames, write_recording


def test_a_gif_moves_at_the_wanted_pace(paper, tmp_path):
    path = tmp_path / "docking.gif"
    write_recording(path, paper, frames_per_s=2, speed=2, size_px=(320, 200))
    with Image.open(path) as gif:
        assert gif.size == (320, 200)
        assert gif.n_frames == 11
        assert gif.info["duration"] == 500
        first = np.asarray(gif.convert("RGB")).astype(int)
        gif.seek(5)
        assert (np.abs(np.asarray(gif.convert("RGB")) - first).sum(axis=2) > 60).mean() > 0.02


def test_the_end_of_a_diverged_run_says_so(diverged):
    *_, last = frames(diverged, rate_hz=5, size_px=(320, 200))
    red = np.asarray(last).astype(int)
    assert ((red[:, :, 0] > 150) & (red[:, :, 1] < 40) & (red[:, :, 2] < 60)).sum() > 50


def test_wrong_formats_and_a_missing_ffmpeg_are_told(paper, tmp_path, monkeypatch):
    with pytest.raises(ResultError, match=r"allowed: \.gif, \.mp4"):
        write_recording(tmp_path / "a.avi", paper)
    monkeypatch.setattr(record.shutil, "which", lambda _: None)
    with pytest.raises(ResultError, match="needs ffmpeg"):
        write_recording(tmp_path / "a.mp4", paper)
