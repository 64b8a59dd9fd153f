"""The empty table, learnt from a few frames, and what differs from it.

Kept are the mean and the spread of every second pixel. A new image is compared at equal exposure (the median ratio of
each colour) and after a shift of a few pixels (phase correlation: Kuglin and Hines, 1975). What is darker in the same
hue may be a shadow: it passes for one unless the table's texture is not found again in it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mbpam_ros.errors import MbpamError
from mbpam_ros.vision.difference_kernel import differing, ratios

_FARTHEST_SHIFT_PX = 8.0
_LEAST_RESPONSE = 0.05
_WINDOW = (7, 7)
_SAMPLE = 29  # of the pixels, to compare exposures
_MOST_UNKNOWN = 0.005  # of the pixels that have to be known


class BackgroundError(MbpamError, ValueError):
    """Frames of the empty table that cannot be used: none, of different sizes, or with fingers always in one place."""


@dataclass(frozen=True, eq=False)
class Masks:
    """Which pixels, (h, w) bool, show an object.

    Args:
        sure: surely.
        with_shadow: with what may be shadow.
        relative: (h, w, c) uint8, the image over the empty table, 128 where they are alike: the table's pattern is not
            in it, and a shadow has no hue; None where the empty table is not known.
    """

    sure: NDArray[np.bool_]
    with_shadow: NDArray[np.bool_]
    relative: NDArray[np.uint8] | None = None


@dataclass(frozen=True, eq=False)
class Background:
    """The empty table at every second pixel.

    Args:
        mean: (h, w, c) float32 levels.
        spread: (h, w) float32, standard deviation over the frames [levels].
        known: (h, w) bool, pixels that no finger hid in all frames.
    """

    mean: NDArray[np.float32]
    spread: NDArray[np.float32]
    known: NDArray[np.bool_]

    @classmethod
    def learn(cls, frames: Sequence[NDArray], hidden: Sequence[NDArray]) -> Background:
        """Learn from frames, (h, w, c) of every second pixel, and where fingers hid it in each, (h, w).

        Raises:
            BackgroundError: no frames, or frames of different sizes.
        """
        if not frames or any(frame.shape != frames[0].shape for frame in frames):
            raise BackgroundError("the empty table is learnt from one or more frames of one size")
        stack = np.stack([np.asarray(frame, np.float32) for frame in frames])
        seen = np.stack([mask == 0 for mask in hidden])[..., None].astype(np.float32)
        count = np.maximum(seen.sum(axis=0), 1.0)
        mean = (stack * seen).sum(axis=0) / count
        variance = (((stack - mean) ** 2) * seen).sum(axis=0) / np.maximum(count - 1.0, 1.0)
        return cls(
            mean.astype(np.float32),
            np.sqrt(variance.mean(axis=-1)).astype(np.float32),
            np.asarray(seen.any(axis=0))[..., 0],
        )

    def require_known(self, wanted: NDArray[np.bool_], frames: int) -> None:
        """Check that the table is known wherever it is wanted, (h, w), up to a two-hundredth of that.

        Raises:
            BackgroundError: fingers hid it there in all of so many frames.
        """
        unknown = float(np.mean(~self.known[wanted])) if wanted.any() else 0.0
        if unknown > _MOST_UNKNOWN:
            raise BackgroundError(
                f"fingers hid {unknown:.1%} of what open fingers leave free of the table in all of {frames} images; "
                "open them, or let them move while it is learnt, over more images"
            )

    def differences(self, image: NDArray[np.uint8], known: NDArray[np.bool_]) -> Masks:
        """What of an image, (h, w, c) of every second pixel, is not the empty table.

        Args:
            image: uint8 levels.
            known: (h, w), pixels that no finger hides now.

        Raises:
            BackgroundError: it has another size or number of colours than the frames that were learnt.
        """
        if image.shape != self.mean.shape:
            raise BackgroundError(f"an image of {image.shape}, but the empty table was learnt with {self.mean.shape}")
        mean, usable = self._shifted(image, known & self.known)
        if usable.sum() < 100:
            empty = np.zeros(usable.shape, bool)
            return Masks(empty, empty)
        picked = np.flatnonzero(usable)[::_SAMPLE]
        channels = image.shape[2]
        sample = (image.reshape(-1, channels)[picked].astype(np.float32), mean.reshape(-1, channels)[picked])
        gain = np.median((sample[0] + 1.0) / (sample[1] + 1.0), axis=0).astype(np.float32)
        table = np.ascontiguousarray(np.minimum(mean * gain, np.float32(255.0)))
        noise = max(1.4826 * float(np.median(np.abs(sample[0] - sample[1] * gain))), 1.0)
        image, shape = np.ascontiguousarray(image), usable.shape
        grey_table, ratio, relative = np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty_like(image)
        ratios(image, table, grey_table, ratio, relative)
        logs = np.log(ratio), np.log(grey_table)
        means = _floats(cv2.blur(cv2.merge([*logs, *(part * part for part in logs)]), _WINDOW))
        slope = _floats(
            cv2.magnitude(cv2.Sobel(grey_table, cv2.CV_32F, 1, 0), cv2.Sobel(grey_table, cv2.CV_32F, 0, 1)) / 8.0
        )
        slope = _floats(cv2.dilate(slope, np.ones((3, 3), np.uint8)))
        sure, darker = np.empty(shape, np.uint8), np.empty(shape, np.uint8)
        differing(image, table, slope, _floats(self.spread), means, noise, sure, darker)
        certain = sure.astype(bool) & usable
        return Masks(_cleaned(certain), _cleaned(certain | (darker.astype(bool) & usable)), relative)

    def _shifted(
        self, image: NDArray[np.uint8], known: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """The mean moved to where the image has it, and the pixels that can be compared."""
        small = (image.shape[1] // 2, image.shape[0] // 2)
        first, second, weight = (
            cv2.resize(picture, small, interpolation=cv2.INTER_AREA).astype(np.float32, copy=False)
            for picture in (_grey(self.mean), _grey(image), known.astype(np.float32))
        )
        first, second = ((part - float(part.mean())) * weight for part in (first, second))
        window = cv2.createHanningWindow(small, cv2.CV_32F)
        (du, dv), response = cv2.phaseCorrelate(first, second, window)
        du, dv = 2.0 * du, 2.0 * dv
        if response < _LEAST_RESPONSE or math.hypot(du, dv) > _FARTHEST_SHIFT_PX or math.hypot(du, dv) < 0.1:
            return self.mean, known
        move = np.array([[1.0, 0.0, du], [0.0, 1.0, dv]])
        size = (image.shape[1], image.shape[0])
        moved = cv2.warpAffine(self.mean, move, size, borderMode=cv2.BORDER_REPLICATE).reshape(self.mean.shape)
        # Accept it only where it explains more than standing still.
        picked = np.flatnonzero(known)[::_SAMPLE]
        pixels = image.reshape(-1, image.shape[2])[picked].astype(np.float32)
        still, shifted = (
            float(np.median(np.abs(pixels - mean.reshape(-1, image.shape[2])[picked]))) for mean in (self.mean, moved)
        )
        return (moved.astype(np.float32, copy=False), known) if shifted < still else (self.mean, known)


def _grey(image: NDArray) -> NDArray[np.float32]:
    """Brightness, (h, w), of an image with one or three colours."""
    if image.shape[2] == 1:
        return image[..., 0].astype(np.float32)
    return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)


def _floats(image: NDArray) -> NDArray[np.float32]:
    return np.ascontiguousarray(image, np.float32)


def _cleaned(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    kernel = np.ones((3, 3), np.uint8)
    cleaned = cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, kernel)
    return cv2.morphologyEx(cleaned, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)).astype(bool)
