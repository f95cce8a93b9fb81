"""Recordings without a display: pictures of pages by a headless Chromium, GIF, PNG and MP4."""
