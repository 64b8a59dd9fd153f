"""Where the pieces of a drawn muscle lie along its centre line."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def places_along(line_m: NDArray[np.float64], shares: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points of a line and the least turns that take the z axis along it there.

    With the unit tangent t the turn is the quaternion (w, x, y, z) along (1 + t_z, -t_y, t_x, 0). A line that comes
    straight back (t_z = -1) is turned about x.

    Args:
        line_m: points of the line, shape (n, 3), n >= 2, no two neighbours alike.
        shares: of the line's length, 0 to 1, shape (k,).

    Returns:
        Positions (k, 3) [m] and unit quaternions w x y z, (k, 4).
    """
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line_m, axis=0), axis=1))])
    wanted = np.asarray(shares, dtype=float) * along[-1]
    positions = np.column_stack([np.interp(wanted, along, line_m[:, axis]) for axis in range(3)])
    slopes = np.gradient(line_m, along, axis=0)
    tangents = np.column_stack([np.interp(wanted, along, slopes[:, axis]) for axis in range(3)])
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    x, y, z = tangents.T
    turns = np.column_stack([1.0 + z, -y, x, np.zeros_like(z)])
    turns[1.0 + z < 1e-12] = (0.0, 1.0, 0.0, 0.0)
    return positions, turns / np.linalg.norm(turns, axis=1, keepdims=True)
