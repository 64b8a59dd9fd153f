"""Coordinates in which a slender body's large turns are straight lines: every plane of nodes has a frame of its own.

In node positions a finite turn along a straight line stretches the body (by 1 - cos of the turn), which a nearly
incompressible solid answers with huge forces: Newton's method then takes small steps only. Here a node of plane k is

    x = c_k + R(theta_k) xi,   c_k = c_(k-1) + R((theta_k + theta_(k-1)) / 2) e_k,

R the turn about y that takes x toward z, e_k the axis between two planes in their frame's components. Lines in
(theta, e, xi) bend and stretch the body without stretching it on the way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class SectionFrames:
    """Frames of the planes z = const of a mesh that bends in the plane y = 0.

    Args:
        points_mm: nodes at rest, shape (nodes, 3).
    """

    def __init__(self, points_mm: NDArray[np.float64]) -> None:
        self.z_mm, self._plane = np.unique(np.round(points_mm[:, 2], 6), return_inverse=True)
        self._nodes_per_plane = np.bincount(self._plane)
        rest_x = points_mm[:, 0]
        self._reach = rest_x - self._mean(rest_x)[self._plane]

    def angles_rad(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return each plane's turn about y, shape (planes,), positive from x toward z.

        The one that fits its nodes best, continuous from base to tip.
        """
        sine, cosine = (np.bincount(self._plane, self._reach * x[:, axis]) for axis in (2, 0))
        return np.unwrap(np.arctan2(sine, cosine))

    def centres_mm(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mean of each plane's nodes in x and z, shape (planes, 2)."""
        return np.stack([self._mean(x[:, axis]) for axis in (0, 2)], axis=1)

    def coordinates(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (theta, e, xi) of node positions ``x``, shape (nodes, 3), as one vector."""
        angles, centres = self.angles_rad(x), self.centres_mm(x)
        steps = _turned(np.diff(centres, axis=0, prepend=0.0), -_between(angles))
        own = _turned(x[:, [0, 2]] - centres[self._plane], -angles[self._plane])
        return np.concatenate([angles, steps.ravel(), own.ravel(), x[:, 1]])

    def positions_mm(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the node positions, shape (nodes, 3)."""
        planes, nodes = self.z_mm.size, self._plane.size
        angles, steps, own, y = np.split(coordinates, np.cumsum([planes, 2 * planes, 2 * nodes]))
        centres = np.cumsum(_turned(steps.reshape(-1, 2), _between(angles)), axis=0)
        flat = centres[self._plane] + _turned(own.reshape(-1, 2), angles[self._plane])
        return np.stack([flat[:, 0], y, flat[:, 1]], axis=1)

    def _mean(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.bincount(self._plane, values) / self._nodes_per_plane


def _between(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean angle of each plane and the one before it; the first plane's own."""
    return 0.5 * (angles + np.concatenate([angles[:1], angles[:-1]]))


def _turned(vectors: NDArray[np.float64], angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn (x, z) vectors from x toward z."""
    cosine, sine = np.cos(angles), np.sin(angles)
    x, z = vectors[:, 0], vectors[:, 1]
    return np.stack([cosine * x - sine * z, sine * x + cosine * z], axis=1)
