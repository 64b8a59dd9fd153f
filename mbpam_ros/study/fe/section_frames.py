"""Coordinates in which a slender body's large turns are straight lines: every plane of nodes has a frame of its own.

In node positions a finite turn along a straight line stretches the body (by 1 - cos of the turn), which a nearly
incompressible solid answers with huge forces: Newton's method then takes small steps only. Here a node of plane k is

    x = c_k + R_k xi,   R_k = R_(k-1) exp(omega_k),   c_k = c_(k-1) + R_(k-1) exp(omega_k / 2) e_k,

omega_k the rotation vector from the plane before, in that plane's own components, and e_k the axis between the two in
the frame half way. Lines in (omega, e, xi) bend, twist and stretch the body without stretching it on the way, however
far it turns.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation


class SectionFrames:
    """Frames of the planes z = const of a mesh.

    Args:
        points_mm: nodes at rest, shape (nodes, 3).
        mirrored: the nodes are half of a body whose other half is their mirror image in y = 0, at rest and later.
    """

    def __init__(self, points_mm: NDArray[np.float64], mirrored: bool = False) -> None:
        self.z_mm, self._plane = np.unique(np.round(points_mm[:, 2], 6), return_inverse=True)
        self._nodes_per_plane = np.bincount(self._plane)
        self._mirrored = mirrored
        flat = points_mm[:, :2]
        self._reach = flat - self._means(flat)[self._plane]

    def rotations(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return each plane's rotation, the one that fits its nodes best (:func:`fitted_rotations`), (planes, 3, 3)."""
        return fitted_rotations(
            centred_moments(x, self._reach, self._plane, np.ones(self._plane.size), self._mirrored)
        )[0]

    def centres_mm(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the mean of each plane's nodes, shape (planes, 3)."""
        return self._means(x)

    def angle_rad(self, x: NDArray[np.float64], direction: NDArray[np.float64]) -> float:
        """Return the angle between z and a direction near the last plane's normal, never negative.

        Continuous beyond half a turn if the body bends in a plane: it is followed from the base in the plane of z and
        the direction.
        """
        normals = np.concatenate([self.rotations(x)[:, :, 2], direction[None]])
        sideways = np.hypot(*direction[:2])
        azimuth = direction[:2] / sideways if sideways > 0.0 else np.array([1.0, 0.0])
        return float(abs(np.unwrap(np.arctan2(normals[:, :2] @ azimuth, normals[:, 2]))[-1]))

    def coordinates(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (omega, e, xi) of node positions ``x``, shape (nodes, 3), as one vector."""
        rotations, centres = self.rotations(x), self._means(x)
        before = np.concatenate([np.eye(3)[None], rotations[:-1]])
        turns = Rotation.from_matrix(before.swapaxes(1, 2) @ rotations).as_rotvec()
        middles = before @ Rotation.from_rotvec(0.5 * turns).as_matrix()
        steps = np.einsum("pji,pj->pi", middles, np.diff(centres, axis=0, prepend=0.0))
        own = np.einsum("nji,nj->ni", rotations[self._plane], x - centres[self._plane])
        return np.concatenate([turns.ravel(), steps.ravel(), own.ravel()])

    def positions_mm(self, coordinates: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the node positions, shape (nodes, 3)."""
        planes = self.z_mm.size
        turns, steps, own = np.split(coordinates, [3 * planes, 6 * planes])
        turns = turns.reshape(-1, 3)
        relative, half = Rotation.from_rotvec(turns).as_matrix(), Rotation.from_rotvec(0.5 * turns).as_matrix()
        rotations = np.empty_like(relative)
        before = np.eye(3)
        for index, turn in enumerate(relative):
            rotations[index] = before = before @ turn
        middles = np.concatenate([np.eye(3)[None], rotations[:-1]]) @ half
        centres = np.cumsum(np.einsum("pij,pj->pi", middles, steps.reshape(-1, 3)), axis=0)
        return centres[self._plane] + np.einsum("nij,nj->ni", rotations[self._plane], own.reshape(-1, 3))

    def _means(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Mean of each plane's rows, shape (planes, columns); y, the second one, cancels in a mirrored body."""
        sums = [np.bincount(self._plane, column) for column in values.T]
        means = np.stack(sums, axis=1) / self._nodes_per_plane[:, None]
        if self._mirrored:
            means[:, 1] = 0.0
        return means


def centred_moments(
    x: NDArray[np.float64],
    reach: NDArray[np.float64],
    group: NDArray[np.int64],
    weights: NDArray[np.float64],
    mirrored: bool,
) -> NDArray[np.float64]:
    """Return A = sum w x reach^T of each group of nodes, shape (groups, 3, 2).

    Args:
        x: node positions, shape (n, 3).
        reach: the nodes' places in their plane at rest, from its centre, shape (n, 2); sum w reach = 0 in each group.
        group: number of each node's group, shape (n,).
        weights: w, shape (n,).
        mirrored: the sum is over the nodes and their mirror images in y = 0, so that what is odd in y cancels.
    """
    moments = np.empty((int(group.max()) + 1, 3, 2))
    for i in range(3):
        for j in range(2):
            odd = mirrored and (i == 1) != (j == 1)
            moments[:, i, j] = 0.0 if odd else np.bincount(group, weights * x[:, i] * reach[:, j])
    return moments


def fitted_rotations(moments: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the rotations (k, 3, 3) that fit flat sets of nodes best, and their stretches S (k, 2, 2).

    The least sum w |x - c - R reach|^2 (Kabsch): A = sum w x reach^T = R S, with the symmetric S in the plane; the
    third column is the plane's normal.

    Args:
        moments: A, shape (k, 3, 2), of rank two.
    """
    square = np.einsum("kia,kib->kab", moments, moments)
    root = np.sqrt(square[:, 0, 0] * square[:, 1, 1] - square[:, 0, 1] ** 2)  # det S
    trace = np.sqrt(square[:, 0, 0] + square[:, 1, 1] + 2.0 * root)
    stretch = (square + root[:, None, None] * np.eye(2)) / trace[:, None, None]
    adjugate = trace[:, None, None] * np.eye(2) - stretch
    axes = moments @ adjugate / root[:, None, None]
    normal = np.cross(axes[:, :, 0], axes[:, :, 1])
    return np.concatenate([axes, normal[:, :, None]], axis=2), stretch
