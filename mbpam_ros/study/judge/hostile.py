"""Images that make a detector work: many regions, no table, nothing but noise."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray


def hostile_images(width_px: int, height_px: int, seed: int = 0) -> list[NDArray[np.uint8]]:
    """Return images, (H, W, 3) rgb8: two checkerboards, forty discs, a hundred boxes, noise, and noise in blocks."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[0:height_px, 0:width_px]
    boards = [np.where((u // side + v // side) % 2, 220, 40) for side in (20, 45)]
    images = [np.repeat(board[..., None], 3, axis=2).astype(np.uint8) for board in boards]
    discs = np.full((height_px, width_px, 3), 60, np.uint8)
    for index in range(40):
        middle = (60 + (width_px - 120) * (index % 8) // 7, 60 + (height_px - 120) * (index // 8) // 4)
        cv2.circle(discs, middle, 22, tuple(int(level) for level in rng.integers(90, 255, 3)), -1)
    boxes = np.full((height_px, width_px, 3), 120, np.uint8)
    for _ in range(100):
        centre, size = rng.uniform((0, 0), (width_px, height_px)).tolist(), rng.uniform(15.0, 70.0, 2).tolist()
        corners = cv2.boxPoints((centre, size, float(rng.uniform(0.0, 180.0)))).astype(np.int32)
        cv2.fillConvexPoly(boxes, corners, tuple(int(level) for level in rng.integers(0, 255, 3)))
    noise = rng.integers(0, 256, (height_px, width_px, 3), dtype=np.uint8)
    blocks = rng.integers(0, 256, (height_px // 24 + 1, width_px // 24 + 1, 3), dtype=np.uint8)
    coarse = cv2.resize(blocks, (width_px, height_px), interpolation=cv2.INTER_NEAREST).astype(np.uint8, copy=False)
    return [*images, discs, boxes, noise, coarse]
