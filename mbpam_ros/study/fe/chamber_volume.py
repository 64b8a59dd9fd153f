"""Volume of gas in the chambers as a cubic form of the node positions: the potential of a follower pressure.

By the divergence theorem V = 1/3 int x . n dA over the wall and over the flat cover at the end plane; the plane z = 0
and the symmetry plane, on which the cell's axis lies, contribute nothing. On a face x = sum N_a x_a, and on the cover
between its rim and a point P of the end plane,

    V_face = 1/3 int x . (x_s x x_t) ds dt,   V_cover = 1/6 int P . (x x x') ds,

both cubic in the nodes: V = sum_t w_t det(x_a, x_b, x_c). A chamber closed by caps needs no cover. The energy of the
gas, -p V, gives the force p dV/dx on the walls, always normal to them, the gas thrust p A on the end plane, and a
symmetric tangent, all without approximation.
"""

from __future__ import annotations

import itertools
from functools import cached_property

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

_LEVI_CIVITA = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _LEVI_CIVITA[_i, _j, _k], _LEVI_CIVITA[_j, _i, _k] = 1.0, -1.0


class ChamberVolume:
    """Volume of one chamber: closed by its faces and the symmetry plane, or open at an end plane and covered there.

    Args:
        faces: of walls and caps, shape (n, 4 or 8), normals out of the gas; (n, 5) are four triangles each, around the
            last node.
        rim: edges around the opening at the end plane, shape (m, 2 or 3), counter-clockwise; None if closed.
        cover_node: number of the node P, on the end plane and in the symmetry plane; with ``rim``.
    """

    def __init__(
        self, faces: NDArray[np.int64], rim: NDArray[np.int64] | None = None, cover_node: int | None = None
    ) -> None:
        self._nodes, self._weights = _triangles(faces) if faces.shape[1] == 5 else _triples(faces)
        if rim is not None:
            edges, edge_weights = _pairs(rim)
            cover = np.concatenate([np.full((len(edges), 1), cover_node), edges], axis=1)
            self._nodes = np.concatenate([self._nodes, cover])
            self._weights = np.concatenate([self._weights, edge_weights])

    def value(self, x: NDArray[np.float64]) -> float:
        """Return V for node positions ``x``, shape (nodes, 3)."""
        a, b, c = (x[self._nodes[:, index]] for index in range(3))
        return float(self._weights @ np.sum(a * np.cross(b, c), axis=1))

    def gradient(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return dV/dx, shape (nodes, 3)."""
        result = np.zeros_like(x)
        for here in range(3):
            b, c = x[self._nodes[:, (here + 1) % 3]], x[self._nodes[:, (here + 2) % 3]]
            np.add.at(result, self._nodes[:, here], self._weights[:, None] * np.cross(b, c))
        return result

    def hessian_entries(self, x: NDArray[np.float64]) -> tuple[NDArray, NDArray[np.int64], NDArray[np.int64]]:
        """Return d2V/dx2 as (values, rows, columns) of a sparse matrix over 3 node + component."""
        return self.hessian_values(x), *self.hessian_places

    def hessian_values(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the entries of d2V/dx2 at :attr:`hessian_places`, which may come more than once."""
        values = []
        for here in range(3):  # d2 det(a, b, c) / da_i db_j = e_ijk c_k, and cyclic
            c = self._nodes[:, (here + 2) % 3]
            block = np.einsum("ijk,tk->tij", _LEVI_CIVITA, self._weights[:, None] * x[c])
            values += [block.ravel(), block.ravel()]
        return np.concatenate(values)

    @cached_property
    def hessian_places(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and columns of the entries of d2V/dx2."""
        rows, columns = [], []
        component = np.arange(3)
        for here in range(3):
            a, b = self._nodes[:, here], self._nodes[:, (here + 1) % 3]
            shape = (a.size, 3, 3)
            row = np.broadcast_to((3 * a[:, None] + component)[:, :, None], shape)
            column = np.broadcast_to((3 * b[:, None] + component)[:, None, :], shape)
            rows += [row.ravel(), column.ravel()]
            columns += [column.ravel(), row.ravel()]
        return np.concatenate(rows), np.concatenate(columns)


def _face_tensor(nodes: int) -> NDArray[np.float64]:
    """T_abc = 1/3 int N_a N_b,s N_c,t ds dt of a 4-node or 8-node face, by a Gauss rule that is exact for it."""
    points, weights = leggauss(4)
    tensor = np.zeros((nodes, nodes, nodes))
    for (s, ws), (t, wt) in itertools.product(zip(points, weights, strict=True), repeat=2):
        shape, slope_s, slope_t = face_shape(s, t, nodes)
        tensor += ws * wt / 3.0 * np.einsum("a,b,c->abc", shape, slope_s, slope_t)
    return tensor


def face_shape(s: float, t: float, nodes: int) -> tuple[NDArray, NDArray, NDArray]:
    """Bilinear or serendipity shape functions on the square -1..1 and their slopes."""
    corner_s, corner_t = np.array([-1.0, 1.0, 1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0])
    u, v = 1.0 + s * corner_s, 1.0 + t * corner_t
    if nodes == 4:
        return 0.25 * u * v, 0.25 * corner_s * v, 0.25 * u * corner_t
    w = s * corner_s + t * corner_t - 1.0
    shape = 0.25 * u * v * w
    slope_s = 0.25 * corner_s * v * (w + u)
    slope_t = 0.25 * corner_t * u * (w + v)
    middle = 0.5 * np.array(
        [(1 - s * s) * (1 - t), (1 + s) * (1 - t * t), (1 - s * s) * (1 + t), (1 - s) * (1 - t * t)]
    )
    middle_s = 0.5 * np.array([-2 * s * (1 - t), 1 - t * t, -2 * s * (1 + t), t * t - 1])
    middle_t = 0.5 * np.array([s * s - 1, -2 * t * (1 + s), 1 - s * s, -2 * t * (1 - s)])
    return np.append(shape, middle), np.append(slope_s, middle_s), np.append(slope_t, middle_t)


def _triples(faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Collect sum_abc T_abc det(x_a, x_b, x_c) over distinct nodes a < b < c: (triples, 3) and their weights."""
    tensor = _face_tensor(faces.shape[1])
    chosen, weights = [], []
    for triple in itertools.combinations(range(faces.shape[1]), 3):
        even = sum(tensor[triple[i], triple[(i + 1) % 3], triple[(i + 2) % 3]] for i in range(3))
        odd = sum(tensor[triple[i], triple[(i + 2) % 3], triple[(i + 1) % 3]] for i in range(3))
        if abs(even - odd) > 1e-14:
            chosen.append(triple)
            weights.append(even - odd)
    nodes = faces[:, np.array(chosen)]  # (faces, triples, 3)
    return nodes.reshape(-1, 3), np.tile(weights, len(faces))


def _triangles(faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The triangles between two corners and the middle (last); each has V = 1/6 det(x_a, x_b, x_c)."""
    corners, middle = faces[:, :4], np.repeat(faces[:, 4:], 4, axis=1)
    nodes = np.stack([corners, np.roll(corners, -1, axis=1), middle], axis=-1).reshape(-1, 3)
    return nodes, np.full(len(nodes), 1.0 / 6.0)


def _pairs(rim: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Nodes and weights of 1/6 int x x x' ds = sum w x_a x x_b over straight or quadratic edges (middle node last)."""
    pair_weights = {2: {(0, 1): 1.0}, 3: {(0, 2): 4.0 / 3.0, (2, 1): 4.0 / 3.0, (0, 1): -1.0 / 3.0}}[rim.shape[1]]
    nodes = np.concatenate([rim[:, list(pair)] for pair in pair_weights])
    return nodes, np.repeat(np.array(list(pair_weights.values())) / 6.0, len(rim))
