"""A camera that has stopped, and a scene that is still: the noise of a sensor tells them apart."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from mbpam_ros.vision.detector import ImageError

NOISE_GREY_LEVELS = 20
"""No noise of a usable picture changes a value by more."""

CHANGED_VALUES = 100
"""Values that changed by more than noise, of some million, from which a scene counts as moved: a square of 6 pixels."""


class FrozenCameraError(ImageError):
    """The camera repeats a picture, or its stamp."""


class FrozenCamera:
    """Finds the camera that has stopped.

    Args:
        patience_s: for how long the very same picture may come; 0 for pictures without noise, which are not judged.
    """

    def __init__(self, patience_s: float) -> None:
        self._patience_s = patience_s
        self._data: object = None
        self._stamp_s: float | None = None
        self._changed_s = 0.0

    def check(self, stamp_s: float, data: object) -> None:
        """Take a picture by its stamp [s] and its bytes.

        Raises:
            FrozenCameraError: its stamp is the last one's; or no bit has changed for longer than the patience.
        """
        if stamp_s == self._stamp_s:
            raise FrozenCameraError(f"the stamp of the images stands still at {stamp_s:.3f} s; the camera has stopped")
        if self._stamp_s is None or stamp_s < self._stamp_s or data != self._data:
            self._data, self._changed_s = data, stamp_s
        self._stamp_s = stamp_s
        same_s = stamp_s - self._changed_s
        if 0.0 < self._patience_s < same_s:
            raise FrozenCameraError(
                f"not a bit of the images has changed for {same_s:.1f} s; the camera has stopped (for pictures without "
                "noise set frozen_after_s to 0)"
            )


def is_same_scene(image: NDArray[np.uint8], before: NDArray[np.uint8]) -> bool:
    """Return whether two pictures of one shape differ by noise alone."""
    moved = cv2.threshold(cv2.absdiff(image, before), NOISE_GREY_LEVELS, 1, cv2.THRESH_BINARY)[1]
    return int(cv2.countNonZero(moved.reshape(-1))) < CHANGED_VALUES
