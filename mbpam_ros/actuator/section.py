"""The section of a muscle along its waves (figure 2), from which drawing, finite elements, moulds and meshes are made.

A disc whose radius R follows the wave, less four chambers: quarter discs of radius rho = R - c, cut off h = b / 2 from
the arms of the cross. At z from a crest, p from crest to crest::

    R(z) = R_crest - a / 2 (1 - cos(2 pi z / p))
    A = rho^2 (pi / 4 - asin(h / rho)) - h (sqrt(rho^2 - h^2) - h)      of one chamber

Lengths in any one unit.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


def outer_radius(
    from_crest: ArrayLike, crest_radius: float, amplitude: float, wave_length: float
) -> NDArray[np.float64]:
    """Return R at distances along the axis from a crest, in their shape."""
    phase = 2.0 * np.pi * np.asarray(from_crest, dtype=float) / wave_length
    radius: NDArray[np.float64] = crest_radius - 0.5 * amplitude * (1.0 - np.cos(phase))
    return radius


def chamber_area(inner_radius: ArrayLike, cross: float) -> NDArray[np.float64]:
    """Return A of one chamber where its wall's inner radius is rho, beside arms of thickness ``cross``."""
    rho, half = np.asarray(inner_radius, dtype=float), 0.5 * cross
    area: NDArray[np.float64] = rho**2 * (0.25 * np.pi - np.arcsin(half / rho))
    return area - half * (np.sqrt(rho**2 - half**2) - half)
