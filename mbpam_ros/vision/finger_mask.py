"""Which pixels the fingers may hide: tubes about their centre lines, wherever they may be between open and told.

A finger that meets something, or lags behind what is told of it, bends less than told; so what is masked is all that it
passes on its way from where it hangs open to a little past where it is told to be. That way is cut into pieces, each
the hull of a few balls, and so is what a piece hides: the tangents from the eye to each ball, drawn as a polygon.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from mbpam_ros.vision.camera import Camera
from mbpam_ros.vision.finger_kernel import SUBPIXELS, bent, outlined

_CORNERS = 12
_SUBPIXEL_BITS = round(math.log2(SUBPIXELS))
_PIECE_M = 0.02
_LONGEST_STRIDE_M = 0.04  # of a tip from posture to posture


class FingerMask:
    """The mask of one camera's fingers; keeps the last one.

    Args:
        camera: the ideal pinhole.
        stride: every so many pixels of the image are one of the mask.
        radius_m: of the muscle, outside, with a margin for blur and the camera's pose.
        bend_margin: by what share of its bend a finger may be bent more than told.
    """

    def __init__(self, camera: Camera, stride: int, radius_m: float, bend_margin: float) -> None:
        self._camera, self._stride = camera, stride
        self._radius_m, self._bend_margin = radius_m, bend_margin
        k = camera.intrinsics
        self._shape = -(-k.height_px // stride), -(-k.width_px // stride)
        turns = (np.arange(_CORNERS) + 0.5) * (2.0 * math.pi / _CORNERS)
        # About the circle, not in it.
        self._circle = np.stack([np.cos(turns), np.sin(turns)], axis=1) / math.cos(math.pi / _CORNERS)
        self._lens = np.array([k.fx, k.fy, k.cx, k.cy])
        self._fingers_m = np.empty((0, 2, 3))
        self._mask = np.zeros(self._shape, np.uint8)

    def of(self, fingers_m: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Return (h, w) uint8, not 0 where fingers told to be at (k, n >= 2, 3) may hide what is behind."""
        if not np.array_equal(fingers_m, self._fingers_m):
            self._fingers_m, self._mask = fingers_m.copy(), self._drawn(fingers_m)
        return self._mask

    def _drawn(self, fingers_m: NDArray[np.float64]) -> NDArray[np.uint8]:
        mask = np.zeros(self._shape, np.uint8)
        if len(fingers_m) == 0:
            return mask
        lines, most = _in_short_pieces(fingers_m), 1.0 + self._bend_margin
        straight, farthest = bent_by(lines, np.array([0.0, most]))
        path_m = float(np.linalg.norm((farthest - straight)[:, -1], axis=1).max())
        strides = math.ceil(path_m / _LONGEST_STRIDE_M)
        postures = bent_by(lines, most * np.arange(strides + 1) / max(strides, 1))
        optical = (postures - self._camera.position_m) @ self._camera.rotation
        outlines, shown = self._outlines(optical), optical[..., 2] > -self._radius_m
        if strides:  # what lies between two postures and two points along a finger
            outlines, shown = np.concatenate([outlines[:-1], outlines[1:]], axis=3), shown[:-1] | shown[1:]
        pieces = np.concatenate([outlines[:, :, :-1], outlines[:, :, 1:]], axis=3)
        for piece in pieces[shown[:, :, :-1] | shown[:, :, 1:]]:
            cv2.fillConvexPoly(mask, cv2.convexHull(piece), 1, shift=_SUBPIXEL_BITS)
        return mask

    def _outlines(self, centres: NDArray[np.float64]) -> NDArray[np.int32]:
        """Corners, (..., _CORNERS, 2), about what balls at these places, (..., 3), of the optical frame hide."""
        corners = np.empty((*centres.shape[:-1], _CORNERS, 2), np.int32)
        flat_m, flat = np.ascontiguousarray(centres).reshape(-1, 3), corners.reshape(-1, _CORNERS, 2)
        outlined(flat_m, self._radius_m, self._circle, self._lens, self._stride, flat)
        return corners


def bent_by(fingers_m: NDArray[np.float64], shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return centre lines, (p, k, n, 3), bent by shares, (p,), of what (k, n, 3) are; at 0 they hang along z."""
    bent_m = np.empty((len(shares), *fingers_m.shape))
    bent(np.ascontiguousarray(fingers_m, dtype=float), np.ascontiguousarray(shares, dtype=float), bent_m)
    return bent_m


def _in_short_pieces(fingers_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same lines through points about :data:`_PIECE_M` apart."""
    longest_m = float(np.linalg.norm(np.diff(fingers_m, axis=1), axis=2).max())
    if longest_m > 1.5 * _PIECE_M:
        parts = math.ceil(longest_m / _PIECE_M)
        shares = (np.arange(parts) / parts)[:, None]
        between = fingers_m[:, :-1, None] + shares * np.diff(fingers_m, axis=1)[:, :, None]
        return np.concatenate([between.reshape(len(fingers_m), -1, 3), fingers_m[:, -1:]], axis=1)
    skip = max(round(_PIECE_M / max(longest_m, 1e-6)), 1)
    kept = [*range(0, fingers_m.shape[1] - 1, skip), fingers_m.shape[1] - 1]
    return fingers_m[:, kept]
