"""Where the pieces of a drawn muscle lie along its centre line."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def places_along(line_m: NDArray[np.float64], shares: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points of lines and the least turns that take the z axis along them there.

    With the unit tangent t the turn is the quaternion (w, x, y, z) along (1 + t_z, -t_y, t_x, 0). A line that comes
    straight back (t_z = -1) is turned about x. Tangents are differences over the neighbours, exact for arcs whose
    points are evenly spaced.

    Args:
        line_m: points of the lines, shape (..., n, 3), n >= 2, no two neighbours alike.
        shares: of a line's length, 0 to 1, shape (k,).

    Returns:
        Positions (..., k, 3) [m] and unit quaternions w x y z, (..., k, 4).
    """
    along = np.zeros(line_m.shape[:-1])
    np.cumsum(np.linalg.norm(np.diff(line_m, axis=-2), axis=-1), axis=-1, out=along[..., 1:])
    wanted = along[..., -1:] * np.asarray(shares, dtype=float)
    behind = (along[..., None, 1:-1] <= wanted[..., None]).sum(axis=-1)
    before, after = (np.take_along_axis(along, index, axis=-1) for index in (behind, behind + 1))
    weight = ((wanted - before) / (after - before))[..., None]

    def at_wanted(values: NDArray[np.float64]) -> NDArray[np.float64]:
        first, second = (np.take_along_axis(values, index[..., None], axis=-2) for index in (behind, behind + 1))
        between: NDArray[np.float64] = first + weight * (second - first)
        return between

    padded, lengths = (np.concatenate([x[..., :1, :], x, x[..., -1:, :]], axis=-2) for x in (line_m, along[..., None]))
    tangents = at_wanted((padded[..., 2:, :] - padded[..., :-2, :]) / (lengths[..., 2:, :] - lengths[..., :-2, :]))
    tangents /= np.linalg.norm(tangents, axis=-1, keepdims=True)
    x, y, z = np.moveaxis(tangents, -1, 0)
    turns = np.stack([1.0 + z, -y, x, np.zeros_like(z)], axis=-1)
    turns[1.0 + z < 1e-12] = (0.0, 1.0, 0.0, 0.0)
    return at_wanted(line_m), turns / np.linalg.norm(turns, axis=-1, keepdims=True)
