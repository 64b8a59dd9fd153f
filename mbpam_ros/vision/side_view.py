"""The bend of one muscle from a picture of its side: the centre line of its silhouette, and what that line turns by.

From the clamp on, the silhouette is cut across every two pixels; both edges are found to a part of a pixel, where the
grey is half way from the background to the muscle beside them, so that a lamp from one side moves neither. The middles
of the cuts are followed by a curve that is straight in both ends, whose length is known, and between them turns by

    theta(u) = theta_0 + bend [u + c1 (u^2 - u) + c2 (u^3 - u)],   u = 0 to 1,

its five unknowns (a shift and a turn at the clamp, bend, c1, c2) by least squares. The bend is therefore that of the
tip over the clamp *as seen*, so a camera that is turned about its own view makes no error; one that is tilted out of
the square by delta makes one of the order of delta^2 / 2 of the bend. On rendered pictures at 20 tilts (up to 10 deg
about the view, 4 deg out of the square) and lamps the error is 0.2 deg rms (``test_side_view.py``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from mbpam_ros.errors import MbpamError
from mbpam_ros.vision.camera import Camera

Array = NDArray[np.float64]

_STEP_PX = 2.0
_ACROSS_PX = 0.5
_REACH = 2.2
"""A cut reaches this many radii to both sides."""
_FAINTEST_LEVELS = 12.0
_FAINTEST_NOISE = 6.0
"""What is this much brighter or darker than the background is no background, in 8 bit levels and in its noise."""
_END_WIDTH = 0.97
_NARROWEST_WIDTH = 0.8
_SHORTEST, _LONGEST = 0.8, 1.5
"""Lengths of the centre line over the muscle's at rest."""
_INSIDE_PX = 3.0
_FEWEST_CUTS = 12


class SilhouetteError(MbpamError, ValueError):
    """The picture shows no whole muscle where it is clamped; the message says what is missing."""


@dataclass(frozen=True)
class MuscleSize:
    """What is known of the muscle.

    Args:
        radius_m, end_length_m, length_m: of its crests, of one straight end, and of all.
        tip_round_m: by how much a round tip stands out beyond that length; 0: it is flat.
    """

    radius_m: float
    end_length_m: float
    length_m: float
    tip_round_m: float = 0.0


@dataclass(frozen=True, eq=False)
class SideView:
    """What a picture tells.

    Args:
        bend_rad: turn of the tip over the clamp, positive to the right of the image.
        sigma_rad: one standard deviation of it, of what the curve leaves over.
        centre_px: middles of the cuts, shape (n, 2), u and v.
        width_px: of the silhouette.
    """

    bend_rad: float
    sigma_rad: float
    centre_px: Array
    width_px: float


def bend_in_picture(picture: NDArray[np.uint8], camera: Camera, muscle: MuscleSize) -> SideView:
    """Return the bend of the muscle that stands up from the origin of the camera's frame, along z.

    Args:
        picture: (H, W, 3) or (H, W), 8 bit; its muscle is brighter or darker all over than what is behind it.
        camera: roughly where it stands; the clamp is looked for one radius around its place in the picture.
        muscle: its size.

    Raises:
        SilhouetteError: no silhouette at the clamp, or none as long as a muscle.
    """
    levels = picture.astype(np.float32)
    grey = np.asarray(cv2.blur(levels if levels.ndim == 2 else levels.mean(axis=2), (3, 3)))
    base, above = camera.project(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, muscle.radius_m]]))
    radius_px = float(np.linalg.norm(above - base))
    height, width = grey.shape
    if not (radius_px < base[0] < width - radius_px and radius_px < base[1] < height - radius_px):
        raise SilhouetteError(f"the clamp at ({base[0]:.0f}, {base[1]:.0f}) px is not well inside the picture")
    cut = _Cut(grey, base, radius_px)
    centres, widths = _followed(cut, base, (above - base) / radius_px, radius_px, muscle.length_m / muscle.radius_m)
    return _fitted(cut, centres, widths, muscle)


def _followed(cut: _Cut, base: Array, up: Array, radius_px: float, slender: float) -> tuple[Array, Array]:
    """Middles (n, 2) and widths (n,) of the cuts from the clamp to the tip."""
    longest = int(_LONGEST * slender * radius_px / _STEP_PX)
    here, along = base, up
    centres: list[Array] = []
    widths: list[float] = []
    for _ in range(longest):
        edges = cut.edges(here, along)
        if edges is None or (len(widths) > 5 and edges[1] - edges[0] < _NARROWEST_WIDTH * float(np.median(widths))):
            break
        across = np.array([-along[1], along[0]])
        centres.append(here + 0.5 * (edges[0] + edges[1]) * across)
        widths.append(edges[1] - edges[0])
        if len(centres) > 4:
            back = centres[max(0, len(centres) - 12)]
            along = centres[-1] - back
            along = along / np.linalg.norm(along)
        here = centres[-1] + _STEP_PX * along
    else:
        raise SilhouetteError("the silhouette has no end: is there something beside the muscle as bright as it?")
    if not centres:
        raise SilhouetteError(
            f"no silhouette at the clamp, ({base[0]:.0f}, {base[1]:.0f}) px: is the lamp on, the muscle in its clamp, "
            "and the background plain?"
        )
    return np.array(centres), np.array(widths)


class _Cut:
    """Cuts across the silhouette of a picture, whose background is its median grey."""

    def __init__(self, grey: NDArray, base: Array, radius_px: float) -> None:
        self._grey = grey
        self._behind = float(np.median(grey))
        noise = 1.4826 * float(np.median(np.abs(grey - self._behind)))
        self._faintest = max(_FAINTEST_LEVELS, _FAINTEST_NOISE * noise)
        u, v = np.rint(base).astype(int)
        at_clamp = float(np.median(grey[v - 3 : v + 4, u - 3 : u + 4]))
        self._sign = math.copysign(1.0, at_clamp - self._behind)
        count = int(_REACH * radius_px / _ACROSS_PX)
        self._offsets = _ACROSS_PX * np.arange(-count, count + 1)
        self._inside = round(_INSIDE_PX / _ACROSS_PX)

    def edges(self, here: Array, along: Array) -> tuple[float, float] | None:
        """Offsets of both edges [px], to the left and the right of ``along``; none without a silhouette there."""
        above = self._above(here, np.array([-along[1], along[0]]))
        is_muscle = above > self._faintest
        middle = above.size // 2
        if not is_muscle[middle]:
            return None
        right = middle + int(np.argmin(np.append(is_muscle[middle:], False)))
        left = middle - int(np.argmin(np.append(is_muscle[middle::-1], False)))
        if left < 0 or right >= above.size:
            return None
        return -self._edge(above[::-1], above.size - 1 - left), self._edge(above, right)

    def beyond(self, here: Array, along: Array) -> float:
        """How far the silhouette goes on from ``here`` [px]; as far as a cut reaches, if it goes further."""
        above = self._above(here, along)
        outside = np.append(above[above.size // 2 :] <= self._faintest, True)
        return max(self._edge(above, above.size // 2 + int(np.argmax(outside))), 0.0)

    def _above(self, here: Array, way: Array) -> Array:
        """Levels above the background at the offsets from ``here`` along ``way``; the other way round if darker."""
        points = (here + self._offsets[:, None] * way).astype(np.float32)
        levels = cv2.remap(self._grey, points[:, 0], points[:, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return self._sign * (np.asarray(levels, dtype=float).ravel() - self._behind)

    def _edge(self, above: Array, first_outside: int) -> float:
        """Offset of the edge before ``first_outside``: where ``above`` falls to half of what it is within."""
        half = 0.5 * float(np.mean(above[first_outside - 2 * self._inside : first_outside - self._inside]))
        start = first_outside - self._inside
        fallen = start + int(np.argmax(np.append(above[start:] < half, True)))
        if fallen >= above.size or fallen == 0:
            return float(self._offsets[min(first_outside, above.size - 1)])
        high, low = above[fallen - 1], above[fallen]
        share = (high - half) / max(high - low, 1e-9)
        return float(self._offsets[fallen - 1] + share * _ACROSS_PX)


def _fitted(cut: _Cut, centres: Array, widths: Array, muscle: MuscleSize) -> SideView:
    width_px = float(np.median(widths))
    px_per_m = 0.5 * width_px / muscle.radius_m
    centres = centres[: np.flatnonzero(widths >= _END_WIDTH * width_px)[-1] + 1]
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(centres, axis=0), axis=1))])
    if centres.shape[0] < _FEWEST_CUTS:
        raise SilhouetteError(f"the silhouette is {way[-1]:.0f} px long at the clamp, and ends there")
    last = centres[-1] - centres[-_FEWEST_CUTS]
    length_px = way[-1] + cut.beyond(centres[-1], last / np.linalg.norm(last)) - muscle.tip_round_m * px_per_m
    if not _SHORTEST < length_px / (muscle.length_m * px_per_m) < _LONGEST:
        raise SilhouetteError(
            f"the silhouette is {length_px / px_per_m * 1e3:.0f} mm long, the muscle {1e3 * muscle.length_m:.0f} mm: "
            "is part of it outside the picture, or hidden?"
        )
    centres, way = centres[way <= length_px], way[way <= length_px]
    end_px = muscle.end_length_m * px_per_m
    u = np.clip((way - end_px) / (length_px - 2.0 * end_px), 0.0, 1.0)
    up = centres[min(len(centres) - 1, 6)] - centres[0]
    start = math.atan2(up[0], -up[1])  # from image up, positive to the right
    steps = np.diff(way)

    def curve(unknown: Array) -> tuple[Array, Array]:
        shift, turn, bend, c1, c2 = unknown
        theta = start + turn + bend * (u + c1 * (u**2 - u) + c2 * (u**3 - u))
        middle = 0.5 * (theta[1:] + theta[:-1])
        points = np.zeros_like(centres)
        points[1:, 0] = np.cumsum(steps * np.sin(middle))
        points[1:, 1] = np.cumsum(-steps * np.cos(middle))
        return centres[0] + (shift * math.cos(start), shift * math.sin(start)) + points, theta

    def residual(unknown: Array) -> Array:
        points, theta = curve(unknown)
        apart = centres - points
        apart_px: Array = apart[:, 0] * np.cos(theta) + apart[:, 1] * np.sin(theta)
        return apart_px

    near_tip = centres[-1] - centres[-7]
    guess = math.atan2(near_tip[0], -near_tip[1]) - start
    middle = centres[len(centres) // 2 + 3] - centres[len(centres) // 2 - 3]
    half_way = math.remainder(math.atan2(middle[0], -middle[1]) - start, 2.0 * math.pi)
    guess += 2.0 * math.pi * round((2.0 * half_way - guess) / (2.0 * math.pi))
    found = least_squares(residual, [0.0, 0.0, guess or 1e-3, 0.0, 0.0], x_scale=[1.0, 0.01, 0.1, 0.1, 0.1])
    # With no bend c1 and c2 mean nothing: the damped normal equations leave them out.
    normal = found.jac.T @ found.jac + 1e-9 * np.eye(5)
    spread = float(np.mean(found.fun**2)) * np.linalg.inv(normal)[2, 2]
    return SideView(float(found.x[2]), math.sqrt(max(spread, 0.0)), centres, width_px)
