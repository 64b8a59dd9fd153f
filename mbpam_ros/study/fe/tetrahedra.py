"""Each hexahedron cut into 24 linear tetrahedra, by a node in its middle and one in the middle of each face.

The cut has the symmetry of the cube, so it favours no direction, and neighbours agree on the four triangles of the
face between them. Middles are means of corners: solid and gas keep the volumes they have with trilinear hexahedra.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

CORNERS = np.array(
    [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)], dtype=float
)
"""Corners of the reference cube, in VTK's order."""

FACES = np.array([(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)])
"""Corners of each face, counter-clockwise seen from outside; their middles are nodes 8 to 13, and 14 is the cell's."""

REFERENCE_NODES = np.vstack([CORNERS, CORNERS[FACES].mean(axis=1), np.zeros(3)])
"""The 15 nodes of a cut cell in the reference cube."""

CUT = np.array([(face[i - 3], face[i], 8 + index, 14) for index, face in enumerate(FACES.tolist()) for i in range(4)])
"""The tetrahedra in node numbers of the cut cell, shape (24, 4), all of positive volume."""


def cut_cells(
    points_mm: NDArray[np.float64], cells: NDArray[np.int64], walls: dict[int, NDArray[np.int64]]
) -> tuple[NDArray[np.float64], NDArray[np.int64], dict[int, NDArray[np.int64]]]:
    """Return points, cells and walls with the middle nodes appended.

    Args:
        points_mm: shape (nodes, 3).
        cells: trilinear hexahedra, shape (cells, 8).
        walls: some of their faces, by chamber, shape (faces, 4).

    Returns:
        points: the given ones first, then the faces' middles and the cells'.
        cells: shape (cells, 15), nodes as in ``REFERENCE_NODES``.
        walls: shape (faces, 5), the middle last.
    """
    faces = cells[:, FACES].reshape(-1, 4)
    known, first, number = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_inverse=True)
    face_nodes = len(points_mm) + number.reshape(-1, 6)
    cell_nodes = len(points_mm) + len(known) + np.arange(len(cells))
    number_of = {tuple(corners): len(points_mm) + index for index, corners in enumerate(known.tolist())}
    middles = {
        chamber: np.array([number_of[tuple(sorted(corners))] for corners in faces.tolist()])
        for chamber, faces in walls.items()
    }
    return (
        np.concatenate([points_mm, points_mm[faces[first]].mean(axis=1), points_mm[cells].mean(axis=1)]),
        np.column_stack([cells, face_nodes, cell_nodes]),
        {chamber: np.column_stack([faces, middles[chamber]]) for chamber, faces in walls.items()},
    )
