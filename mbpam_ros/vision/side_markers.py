"""The bend of one muscle from two coloured strips at its ends, seen from the side: their turn to each other.

Where the background is not plain, or the lamp does not light all of the muscle, its silhouette cannot be followed
(:mod:`~mbpam_ros.vision.side_view`). Two strips of a colour that nothing else in the picture has can still be seen,
each along the axis: one at the clamp, one on the tip's straight end, and beyond it. A pixel belongs to a
strip by how far its colour, less its grey, points the way of the strips' colour; with these shares as weights w the
second moments

    m_ij = sum w (x_i - <x_i>) (x_j - <x_j>) / sum w

tell its direction, 1/2 atan2(2 m_uv, m_uu - m_vv), but not which end of it is up. The strip at the clamp points upward;
for the other one the line between the two tells it: with the straight ends tangent to it, an arc turns by twice what
its chord does.

As with the silhouette a camera that is turned about its own view makes no error, one that is out of the square by delta
one of the order of delta^2 / 2 of the bend. On rendered pictures of strips of 25 mm, 59 pixels long, at 60 tilts and
lamps the error is 0.2 deg rms and 0.9 at worst (``test_side_view.py`` has 20 of them); with 9 mm it is 1.3 deg rms, for
the picture's steps of a pixel alone turn so short a strip.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mbpam_ros.errors import MbpamError
from mbpam_ros.vision.camera import Camera
from mbpam_ros.vision.render import ColouredSolid

Array = NDArray[np.float64]
Colour = tuple[float, float, float]

_FAINTEST_LEVELS = 20.0
"""A strip's colour, less its grey, is at least so strong."""
_SHARE = 0.4
"""Of the strongest: what has more is looked at."""
_SMALLEST_PX = 30
_LEAST_SLENDER = 1.6
"""Length over width of a strip, as seen."""
_RIVAL = 0.5
"""A third patch of the colour must be smaller than this share of the second."""

_LENGTH_M, _WIDTH_M, _THICKNESS_M = 0.025, 0.004, 0.001
_INWARD_M = 0.009
"""By so much a simulated strip lies on its straight end; the rest stands out."""


class MarkerError(MbpamError, ValueError):
    """The picture does not show the two strips; the message says what is wrong."""


@dataclass(frozen=True, eq=False)
class MarkerView:
    """What the strips tell.

    Args:
        bend_rad: turn of the strip at the tip over that at the clamp, positive to the right of the image.
        places_px: of the two strips, clamp first, shape (2, 2), u and v.
    """

    bend_rad: float
    places_px: Array


def bend_between_markers(picture: NDArray[np.uint8], camera: Camera, colour_rgb: Colour) -> MarkerView:
    """Return the bend of the muscle that stands up from the origin of the camera's frame, along z.

    Args:
        picture: (H, W, 3), rgb8.
        camera: roughly where it stands: the strip nearer to the clamp's place in the picture is the one on that end.
        colour_rgb: of the strips, 0 to 1; what counts is what it has beside its grey.

    Raises:
        MarkerError: the colour is a grey, or there are not two strips of it, and two alone.
    """
    if picture.ndim != 3:
        raise MarkerError("the picture has no colours; take the silhouette instead")
    likeness = _likeness(picture, colour_rgb)
    strips = _strips(likeness)
    base, above = camera.project(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.01]]))
    first, last = sorted(strips, key=lambda strip: float(np.linalg.norm(strip[0] - base)))
    up = _turn(above - base)
    start = _nearest(first[1], up, math.pi)
    half = math.remainder(_turn(last[0] - first[0]) - start, 2.0 * math.pi)
    bend = _nearest(last[1] - start, 2.0 * half, math.pi)
    return MarkerView(bend, np.array([first[0], last[0]]))


def marker_strips(axis_m: Array, radius_m: float, toward: Array, colour_rgb: Colour) -> tuple[ColouredSolid, ...]:
    """Return two strips for the simulated camera, on both ends of a muscle and beyond, on the side toward the camera.

    Args:
        axis_m: of the muscle, clamp to tip, shape (n, 3).
        radius_m: of its crests.
        toward: unit vector across the plane of the bend, to the camera's side.
        colour_rgb: of the strips.
    """
    solids = []
    for line in (axis_m, axis_m[::-1]):
        inward = line[np.argmax(np.linalg.norm(line - line[0], axis=1) > 0.5 * _INWARD_M)] - line[0]
        along = inward / np.linalg.norm(inward)
        place = line[0] + (_INWARD_M - 0.5 * _LENGTH_M) * along + radius_m * toward
        turned = Rotation.from_matrix(np.column_stack([np.cross(toward, along), toward, along]))
        size = np.array([_WIDTH_M, _THICKNESS_M, _LENGTH_M])
        solids.append(ColouredSolid("box", size, place, turned.as_quat(), colour_rgb))
    return tuple(solids)


def _likeness(picture: NDArray[np.uint8], colour_rgb: Colour) -> NDArray:
    """How far each pixel's colour, less its grey, points the way of ``colour_rgb``, less what it points aside."""
    wanted = np.array(colour_rgb, dtype=np.float32) - np.float32(np.mean(colour_rgb))
    size = float(np.linalg.norm(wanted))
    if not size > 0.1:
        raise MarkerError(f"{colour_rgb} is nearly grey; paint the strips in a colour that nothing else has")
    levels = np.asarray(cv2.blur(picture, (3, 3)), dtype=np.float32)
    colours = levels - levels.mean(axis=2, keepdims=True)
    along = colours @ (wanted / size)
    aside = np.linalg.norm(colours - along[..., None] * (wanted / size), axis=2)
    likeness: NDArray = along - aside
    return likeness


def _strips(likeness: NDArray) -> list[tuple[Array, float]]:
    """Place [px] and direction [rad] of the two strips."""
    strongest = float(np.partition(likeness.ravel(), -_SMALLEST_PX)[-_SMALLEST_PX])
    if strongest < _FAINTEST_LEVELS:
        raise MarkerError("no strip of that colour is in the picture: is the lamp on, and the colour right?")
    mask = (likeness > _SHARE * strongest).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    order = sorted(range(1, count), key=lambda label: -stats[label, cv2.CC_STAT_AREA])
    areas = [int(stats[label, cv2.CC_STAT_AREA]) for label in order]
    if len(areas) < 2 or areas[1] < _SMALLEST_PX:
        raise MarkerError(
            f"{min(len(areas), 1)} strip of that colour is in the picture, two are needed: is one hidden?"
        )
    if len(areas) > 2 and areas[2] > _RIVAL * areas[1]:
        raise MarkerError("more than two patches of that colour are in the picture; take another colour")
    return [_strip(likeness, labels == label, stats[label]) for label in order[:2]]


def _strip(likeness: NDArray, mask: NDArray[np.bool_], box: NDArray) -> tuple[Array, float]:
    """Place and direction of one strip from the moments of all around it that is like it."""
    left, top, width, height = (int(value) for value in box[:4])
    rows, columns = slice(max(top - 3, 0), top + height + 3), slice(max(left - 3, 0), left + width + 3)
    near = cv2.dilate(mask[rows, columns].astype(np.uint8), np.ones((5, 5), np.uint8)) != 0
    weight = np.where(near, np.maximum(likeness[rows, columns], 0.0), 0.0).astype(float)
    v, u = np.nonzero(weight)
    w = weight[v, u] / weight.sum()
    points = np.column_stack([u + columns.start, v + rows.start]).astype(float)
    place = w @ points
    moments = (points - place).T @ ((points - place) * w[:, None])
    small, large = np.linalg.eigvalsh(moments)
    if not large > _LEAST_SLENDER**2 * small:
        raise MarkerError(
            f"the patch at ({place[0]:.0f}, {place[1]:.0f}) px is no strip: it is {math.sqrt(large / small):.1f} times "
            "as long as wide"
        )
    turn = 0.5 * math.atan2(2.0 * moments[0, 1], moments[0, 0] - moments[1, 1])
    return place, _turn(np.array([math.cos(turn), math.sin(turn)]))


def _turn(way: Array) -> float:
    """Angle of a way in the picture from image up, positive to the right."""
    return math.atan2(way[0], -way[1])


def _nearest(angle: float, to: float, period: float) -> float:
    """The angle nearest to ``to`` that differs from ``angle`` by whole periods."""
    return to + math.remainder(angle - to, period)
