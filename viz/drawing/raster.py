"""Rasterised surfaces with a depth buffer: the run time depends little on the number of faces."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from spacerobot.common.arrays import Array

Picture = NDArray[np.float32]
Indices = NDArray[np.int64]

FINE = 2
"""Samples along each side of a pixel."""
EDGE = 0.55
"""Darkness of the edges between parts, as a fraction of their colour."""
_DEPTHS = 2**30  # steps between the farthest and the nearest point
_AT_ONCE = 4_000_000  # pixels of faces worked on together


class Faces(NamedTuple):
    """Triangles in picture coordinates.

    Attributes:
        corners: Across and down in pixels, from the picture's upper left corner, and towards the eye (m, 3,
            3).
        rgba: Colours (m, 4), 0 to 1.
        part: Part numbers (m,) from 0; edges are drawn between different parts.
    """

    corners: Array
    rgba: Array
    part: Indices


def draw_faces(faces: Faces, width: int, height: int) -> Picture:
    """Picture (height, width, 4) of triangles, transparent elsewhere.

    Args:
        faces: Triangles to draw.
        width, height: Size of the picture [pixels].
    """
    corners, size = faces.corners * [FINE, FINE, 1.0], (height * FINE, width * FINE)
    clear = faces.rgba[:, 3] < 1
    which, depth = nearest_faces(corners, np.flatnonzero(~clear), size)
    picture = _coloured(which, faces)
    if clear.any():
        veil, before = nearest_faces(corners, np.flatnonzero(clear), size)
        front = _coloured(np.where(before > depth, veil, -1), faces)
        picture = front + picture * (1 - front[..., 3:])
    return _coarser(picture, FINE)


def cover(corners: Array, width: int, height: int, *, fine: int = FINE) -> Picture:
    """Share (height, width) of each pixel that triangles (m, 3, 3) cover; see :class:`Faces`."""
    size = height * fine, width * fine
    which, _ = nearest_faces(corners * [fine, fine, 1.0], np.arange(len(corners)), size)
    return _coarser((which >= 0).astype(np.float32)[..., None], fine)[..., 0]


def _coloured(which: Indices, faces: Faces) -> Picture:
    """Colours (h, w, 4), premultiplied by the opacity, of the faces seen at each pixel."""
    part = np.append(faces.part, -1)[which]
    border = np.zeros(which.shape, dtype=bool)
    border[:, 1:] |= part[:, 1:] != part[:, :-1]
    border[1:] |= part[1:] != part[:-1]
    rgba = np.append(faces.rgba, np.zeros((1, 4)), axis=0).astype(np.float32)
    rgba[:, :3] *= rgba[:, 3:]
    dark = rgba * np.array([EDGE, EDGE, EDGE, 1.0], dtype=np.float32)
    picture: Picture = rgba[which]
    picture[border] = dark[which[border]]
    return picture


def _coarser(picture: Picture, fine: int) -> Picture:
    """Means over squares of ``fine`` by ``fine`` pixels."""
    height, width, colours = picture.shape
    rows = picture.reshape(height // fine, fine, width, colours).sum(axis=1)
    return np.asarray(
        rows.reshape(height // fine, width // fine, fine, colours).sum(axis=2) / np.float32(fine**2)
    )


def nearest_faces(corners: Array, chosen: Indices, size: tuple[int, int]) -> tuple[Indices, Array]:
    """Visible face at the middle of each pixel, and its depth.

    Args:
        corners: Corners of triangles (m, 3, 3): across, down, towards the viewer.
        chosen: Indices (k,) of the triangles to draw.
        size: Height and width in pixels.

    Returns:
        which: Index of the nearest triangle (h, w); -1 for none.
        depth: Depth towards the viewer (h, w); minus infinity for none.
    """
    first, tall = _covered(corners[chosen, :, 1], size[0])
    boxes = tall * _covered(corners[chosen, :, 0], size[1])[1]
    visible = (boxes > 0) & (_area(corners[chosen]) != 0)
    chosen, first, tall, boxes = chosen[visible], first[visible], tall[visible], np.cumsum(boxes[visible])
    corners = corners[chosen]
    low, high = corners[..., 2].min(initial=np.inf), corners[..., 2].max(initial=-np.inf)
    step = max(float(high - low), 1e-300) / _DEPTHS if len(chosen) else 1.0
    buffer = np.full(size[0] * size[1], -1, dtype=np.int64)
    starts = np.searchsorted(boxes, np.arange(0, boxes[-1] if len(boxes) else 0, _AT_ONCE))
    for start, end in zip(starts, [*starts[1:], len(chosen)], strict=True):
        few = slice(start, end)
        pixel, face, depth = _fragments(corners[few], first[few], tall[few], size[1])
        steps = np.clip((depth - low) / step, 0, _DEPTHS).astype(np.int64)
        np.maximum.at(buffer, pixel, (steps << 32) | (face + start))
    visible = buffer >= 0
    which = np.where(visible, np.append(chosen, -1)[np.where(visible, buffer & 0xFFFFFFFF, -1)], -1)
    depth = np.where(visible, low + step * (buffer >> 32), -np.inf)
    return which.reshape(size), depth.reshape(size)


def _covered(place: Array, size: int) -> tuple[Indices, Indices]:
    """First row (or column) whose centre a triangle may cover, and number of such rows.

    ``place`` is (m, 3).
    """
    first = np.clip(np.ceil(place.min(axis=1) - 0.5), 0, size)
    last = np.clip(np.floor(place.max(axis=1) - 0.5) + 1, first, size)
    return first.astype(np.int64), (last - first).astype(np.int64)


def _fragments(corners: Array, first: Indices, tall: Indices, width: int) -> tuple[Indices, Indices, Array]:
    """Pixel, triangle and depth for every pixel centre that a triangle covers."""
    face, row = _counted(tall)
    y = first[face] + row + 0.5
    left, right = np.zeros(len(face)), np.full(len(face), float(width))
    # lines a x + b y + c = 0 (m, 3) along the edges, positive inside whichever way the corners go round
    area = _area(corners)
    sign, (across, down) = np.sign(area)[:, None], np.moveaxis(corners[..., :2], -1, 0)
    a = sign * (down - np.roll(down, -1, axis=1))
    b = sign * (np.roll(across, -1, axis=1) - across)
    c = -(a * across + b * down)
    for k in range(3):  # the inside is where a x + b y + c >= 0 for all three
        slope, offset = a[face, k], b[face, k] * y + c[face, k]
        with np.errstate(divide="ignore", invalid="ignore"):
            at = -offset / slope
        left = np.where(slope > 0, np.maximum(left, at), left)
        right = np.where(slope < 0, np.minimum(right, at), right)
        right = np.where((slope == 0) & (offset < 0), -1.0, right)
    start = np.ceil(np.clip(left, 0, width + 1) - 0.5).astype(np.int64)
    end = np.floor(np.clip(right, -1, width) - 0.5).astype(np.int64) + 1
    wide = np.maximum(0, end - start)
    span, column = _counted(wide)
    x, face = start[span] + column, face[span]
    # slopes across and down of the depth, and its value at the origin (m,)
    safe = np.where(area == 0, 1.0, area)
    (ux, uy, uz), (vx, vy, vz) = (np.moveaxis(corners[:, k] - corners[:, 0], 1, 0) for k in (1, 2))
    right, below = (uz * vy - vz * uy) / safe, (ux * vz - vx * uz) / safe
    base = corners[:, 0, 2] - right * corners[:, 0, 0] - below * corners[:, 0, 1]
    depth = base[face] + right[face] * (x + 0.5) + below[face] * y[span]
    return (first[face] + row[span]) * width + x, face, depth


def _counted(counts: Indices) -> tuple[Indices, Indices]:
    """Owner i of each of ``counts[i]`` items, and the item's number within its owner."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)


def _area(corners: Array) -> Array:
    """Twice the areas (m,), signed."""
    u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return np.asarray(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
