"""Compiled passes of the finger mask: for some hundred balls NumPy takes longer to begin than to compute."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

SUBPIXELS = 16
_NEAREST = 0.05  # of a ray's direction along the axis: farther than 87 deg off it no image reaches

# Compiled when imported, not under the first frame.
_BENT = "void(f8[:,:,::1], f8[::1], f8[:,:,:,::1])"
_OUTLINED = "void(f8[:,::1], f8, f8[:,::1], f8[::1], i8, i4[:,:,::1])"


@njit(_BENT, cache=True, nogil=True)
def bent(fingers_m: NDArray[np.float64], shares: NDArray[np.float64], bent_m: NDArray[np.float64]) -> None:
    """Bend fingers by shares of what they are bent; at 0 they hang along z.

    Args:
        fingers_m: (k, n, 3), centre lines.
        shares: (p,).
        bent_m: (p, k, n, 3), filled.
    """
    count, points, _ = fingers_m.shape
    for finger in range(count):
        for p in range(shares.size):
            for c in range(3):
                bent_m[p, finger, 0, c] = fingers_m[finger, 0, c]
        for point in range(points - 1):
            x, y, z = fingers_m[finger, point + 1] - fingers_m[finger, point]
            length, aside = math.sqrt(x * x + y * y + z * z), math.hypot(x, y)
            angle = math.atan2(aside, z)
            for p in range(shares.size):
                along = length * math.sin(shares[p] * angle) / max(aside, 1e-12)
                bent_m[p, finger, point + 1, 0] = bent_m[p, finger, point, 0] + along * x
                bent_m[p, finger, point + 1, 1] = bent_m[p, finger, point, 1] + along * y
                bent_m[p, finger, point + 1, 2] = bent_m[p, finger, point, 2] + length * math.cos(shares[p] * angle)


@njit(_OUTLINED, cache=True, nogil=True)
def outlined(
    centres_m: NDArray[np.float64],
    radius_m: float,
    circle: NDArray[np.float64],
    lens: NDArray[np.float64],
    stride: int,
    corners: NDArray[np.int32],
) -> None:
    """Find a polygon about what each of some balls hides: tangents from the eye to it.

    Args:
        centres_m: (m, 3), in the optical frame.
        radius_m: of the balls.
        circle: (c, 2), corners about the unit circle.
        lens: fx, fy, cx, cy [px].
        stride: every so many pixels of the image are one of the mask.
        corners: (m, c, 2), filled: the mask's pixels, in parts of :data:`SUBPIXELS`.
    """
    half = 0.5 * (stride - 1)
    for ball in range(len(centres_m)):
        x, y, z = centres_m[ball]
        distance = max(math.sqrt(x * x + y * y + z * z), 1e-9)
        sine = min(radius_m / distance, 0.999)
        cosine = math.sqrt(1.0 - sine**2)
        x, y, z = x / distance, y / distance, z / distance
        # Two directions at right angles to it (Duff et al., 2017).
        sign = -1.0 if z < 0.0 else 1.0
        a = -1.0 / (sign + z)
        b = x * y * a
        for corner in range(len(circle)):
            across, along = circle[corner]
            u = cosine * x + sine * (across * (1.0 + sign * x * x * a) + along * b)
            v = cosine * y + sine * (across * (sign * b) + along * (sign + y * y * a))
            w = max(cosine * z + sine * (across * (-sign * x) - along * y), _NEAREST)
            corners[ball, corner, 0] = np.int32(np.round((u / w * lens[0] + lens[2] - half) / stride * SUBPIXELS))
            corners[ball, corner, 1] = np.int32(np.round((v / w * lens[1] + lens[3] - half) / stride * SUBPIXELS))
