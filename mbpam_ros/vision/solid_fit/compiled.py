"""What of this folder Python calls, compiled into the cache on disk.

The cache watches the file of the cached function alone. A digest of all files it is built from, being part of the
closure, is part of the cache's key: no stale machine code after an edit of another file.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from mbpam_ros.source_digest import source_digest
from mbpam_ros.vision.solid_fit import contour as _contour
from mbpam_ros.vision.solid_fit import edges as _edges
from mbpam_ros.vision.solid_fit import outline as _outline
from mbpam_ros.vision.solid_fit import shading as _shading

_fit_contour, _fit_edges, _clipped = _contour.fit_contour, _edges.fit_edges, _outline.clipped
_unexplained, _project, _hull = _shading.unexplained_shading, _outline.project_outline, _outline.convex_hull
_MOST_VERTICES = _outline.MOST_VERTICES


def _cached(digest: int) -> tuple[Callable[..., Any], ...]:
    @njit(cache=True, nogil=True)
    def fit_contour(form, guess, support, eye, rotation, lens, contour, contour_sigma_px, points, point_sigma_m, steps):
        assert digest >= 0
        return _fit_contour(
            form, guess, support, eye, rotation, lens, contour, contour_sigma_px, points, point_sigma_m, steps
        )

    @njit(cache=True, nogil=True)
    def fit_edges(
        form, start, support, eye, rotation, lens, image, hidden, level, contour, sigma_px, points, sigma_m, reaches
    ):
        assert digest >= 0
        return _fit_edges(
            form, start, support, eye, rotation, lens, image, hidden, level, contour, sigma_px, points, sigma_m, reaches
        )

    @njit(cache=True, nogil=True)
    def unexplained_shading(form, p, support, eye, rotation, lens, pixels, levels):
        assert digest >= 0
        return _unexplained(form, p, support, eye, rotation, lens, pixels, levels)

    @njit(cache=True, nogil=True)
    def silhouette(form, p, support, eye, rotation, lens):
        """The corners of the silhouette, (m, 2) px; none where it is not in front of the camera."""
        assert digest >= 0
        space, uv = np.empty((_MOST_VERTICES, 3)), np.empty((_MOST_VERTICES, 2))
        count = _project(form, p, support, eye, rotation, lens, space, uv)
        if count == 0:
            return uv[:0].copy()
        hull = np.empty(2 * _MOST_VERTICES, np.int64)
        return uv[hull[: _hull(uv, count, hull)]].copy()

    @njit(cache=True, nogil=True)
    def clipped(subject, window):
        assert digest >= 0
        return _clipped(subject, window)

    return fit_contour, fit_edges, unexplained_shading, silhouette, clipped


fit_contour, fit_edges, unexplained_shading, silhouette, clipped = _cached(
    source_digest(sorted(Path(__file__).parent.glob("*.py")))
)
