"""The tip's plane end: where it is, how it is turned, and how a force and a moment act on it.

With the shares w_a of the face's area at rest that belong to its nodes (sum 1), and their places X_a in it,

    centre c = sum w_a x_a,   rotation R: least sum w_a |x_a - c - R X_a|^2  (Kabsch; A = sum w_a x_a X_a^T = R S).

A dead force F at the centre is w_a F on each node, with the potential -F . c. The moment T about the tip's direction
t = R e_z is

    f_a = T / tr S  w_a  t x R X_a:   sum f_a = 0,   sum (x_a - c) x f_a = T t   exactly, whatever the face's strain.

It follows the tip and has no potential: in space, turning a free tip around a closed way and back takes work from a
moment about its own axis (Ziegler 1968). A moment with one, -T times the roll, would be another load, with components
across t. So its tangent is not symmetric; it is of rank four, and solved for as an update of a symmetric one
(:class:`~mbpam_ros.study.fe.solve.UpdatedMatrix`):

    df_a = -T / (tr S)^2 w_a (t x p_a) sum w_b p_b . dx_b + T / tr S  w_a  dtheta x (t x p_a),   p_a = R X_a,
    dtheta = M^(-1) sum w_b p_b x dx_b,   M = R (tr S - S) R^T.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.study.fe.chamber_volume import face_shape
from mbpam_ros.study.fe.section_frames import centred_moments, fitted_rotations


@dataclass(frozen=True, eq=False)
class TipPose:
    """Where the tip's face is.

    Args:
        position_mm: its centre, shape (3,).
        rotation: columns are the turned axes, the last one the tip's direction; shape (3, 3).
    """

    position_mm: NDArray[np.float64]
    rotation: NDArray[np.float64]

    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit vector along the muscle, out of the face."""
        return self.rotation[:, 2]

    @property
    def roll_rad(self) -> float:
        """Turn about the direction t: the angle of R_z in R = R_turn R_z, R_turn the shortest turn from z to t.

        Undetermined where t = -z.
        """
        x, y, z = self.direction
        rotation = self.rotation
        axis = np.array([-y, x, 0.0])  # z x t; the section's x axis is turned back by R_turn^T (Rodrigues)
        back = z * rotation[:, 0] - np.cross(axis, rotation[:, 0])
        if 1.0 + z > 0.0:
            back = back + axis * float(axis @ rotation[:, 0]) / (1.0 + z)
        return float(np.arctan2(back[1], back[0]))


class TipFace:
    """The face and its loads.

    Args:
        points_mm: nodes of the body at rest, shape (nodes, 3); the face lies across z with its centre on the axis.
        faces: its element faces, shape (n, 4 or 8).
        mirrored: the body is half of one, whose other half is its mirror image in y = 0.
    """

    def __init__(self, points_mm: NDArray[np.float64], faces: NDArray[np.int64], mirrored: bool) -> None:
        shares = np.zeros(len(points_mm))
        np.add.at(shares, faces.ravel(), _face_shares_mm2(points_mm[faces]).ravel())
        self.nodes = np.unique(faces)
        self._mirrored = mirrored
        self._shares = shares[self.nodes] / shares.sum()
        self._reach = points_mm[self.nodes, :2]
        self._group = np.zeros(self.nodes.size, dtype=np.int64)

    def pose(self, x: NDArray[np.float64]) -> TipPose:
        """Return where the face of a body with nodes at ``x``, shape (nodes of the body, 3), is."""
        return TipPose(self._centre_mm(x), self._fit(x)[0])

    def forces_n(self, x: NDArray[np.float64], force_n: NDArray[np.float64], torque_n_mm: float) -> NDArray[np.float64]:
        """Return the forces on the face's nodes of a dead force at the centre and a moment about the direction.

        Those on the nodes that there are: a half body gets half of ``force_n``.

        Returns:
            Shape (nodes of the face, 3) [N].
        """
        forces = self._shares[:, None] * force_n
        if self._mirrored:
            return 0.5 * forces
        if torque_n_mm:
            rotation, stretch = self._fit(x)
            forces = forces + torque_n_mm / np.trace(stretch) * self._shares[:, None] * self._around(rotation)
        return forces

    def torque_tangent(
        self, x: NDArray[np.float64], torque_n_mm: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return U and V, shape (3 nodes of the face, 4): the moment's forces change by U V^T dx."""
        rotation, stretch = self._fit(x)
        shares, trace = self._shares[:, None], float(np.trace(stretch))
        arms, around = self._reach @ rotation[:, :2].T, self._around(rotation)
        flat = np.zeros((3, 3))
        flat[:2, :2] = stretch
        inverse = np.linalg.inv(rotation @ (trace * np.eye(3) - flat) @ rotation.T)
        left, right = [-torque_n_mm / trace**2 * shares * around], [shares * arms]
        for axis in range(3):
            left.append(torque_n_mm / trace * shares * np.cross(np.eye(3)[axis], around))
            right.append(shares * np.cross(inverse[axis], arms))
        return np.stack([part.ravel() for part in left], 1), np.stack([part.ravel() for part in right], 1)

    def _around(self, rotation: NDArray[np.float64]) -> NDArray[np.float64]:
        """The arms turned by a quarter about the direction: t x R X."""
        return self._reach[:, :1] * rotation[:, 1] - self._reach[:, 1:] * rotation[:, 0]

    def _centre_mm(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        centre = self._shares @ x[self.nodes]
        return centre * (1.0, 0.0, 1.0) if self._mirrored else centre

    def _fit(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        offsets = x[self.nodes] - self._centre_mm(x)
        moments = centred_moments(offsets, self._reach, self._group, self._shares, self._mirrored)
        rotations, stretches = fitted_rotations(moments)
        return rotations[0], stretches[0]


def _face_shares_mm2(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return int N_a dA of plane faces across z with nodes (n, 4 or 8, 3), shape (n, nodes)."""
    points, weights = np.polynomial.legendre.leggauss(3)
    shares = np.zeros(corners.shape[:2])
    for s, ws in zip(points, weights, strict=True):
        for t, wt in zip(points, weights, strict=True):
            shape, slope_s, slope_t = face_shape(s, t, corners.shape[1])
            along_s, along_t = slope_s @ corners, slope_t @ corners
            area = along_s[:, 0] * along_t[:, 1] - along_s[:, 1] * along_t[:, 0]
            shares += ws * wt * area[:, None] * shape
    return shares
