"""A renderer that draws a moving square, so that recordings are quick and have all their frames."""

import io

from PIL import Image

from viz.recording import record


def draw_square_frames(monkeypatch):
    """Let recordings take frames of a moving square in place of a browser's."""

    def squares(_, times, size_px, **__):
        for k in range(len(times)):
            buffer = io.BytesIO()
            picture = Image.new("RGB", size_px)
            picture.paste("white", (4 * k, 0, 4 * k + 40, 40))  # moves, so that no frames are merged
            picture.save(buffer, "JPEG")
            yield buffer.getvalue()

    monkeypatch.setattr(record, "browser_program", lambda: "chromium")
    monkeypatch.setattr(record, "page_pictures", squares)
