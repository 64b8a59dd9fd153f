"""Fillets of the muscle: circular crests and valleys of the wave, and rounded corners of the chambers. Lengths in mm.

*Wave.* A crest and a valley of one radius rho, joined by a straight flank that touches both. With m = lambda / 4 and
k = rho - a/2, the flank passes through (m, k) as seen from the centre of the crest's circle, at the distance
D^2 = m^2 + k^2; it leaves the circle after the angle alpha, T = sqrt(D^2 - rho^2) before that point:

    sin alpha = (m rho - k T) / D^2,   cos alpha = (m T + k rho) / D^2.

There is room for the flank as long as rho <= m^2 / a + a / 4.

*Chamber.* In the octant 0 to 45 deg the chamber's outline runs from the cross (h, h) along the arm y = h to the wall, a
circle of radius r, and on it to 45 deg. Fillets of radius f lie at the cross, with the centre (h + f, h + f), and
between arm and wall, with the centre C = (sqrt((r - f)^2 - (h + f)^2), h + f).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


def largest_wave_fillet_mm(amplitude_mm: float, wave_length_mm: float) -> float:
    """Return the radius of crest and valley that leaves no flank between them."""
    return (0.25 * wave_length_mm) ** 2 / amplitude_mm + 0.25 * amplitude_mm


def filleted_wave_depth_mm(
    z_mm: NDArray[np.float64], amplitude_mm: float, wave_length_mm: float, radius_mm: float
) -> NDArray[np.float64]:
    """Return the depth below the crests at ``z_mm``, a crest being at 0; between 0 and the amplitude a.

    Args:
        radius_mm: rho, not above :func:`largest_wave_fillet_mm`.
    """
    m, k = 0.25 * wave_length_mm, radius_mm - 0.5 * amplitude_mm
    flank = math.sqrt(max(m**2 + k**2 - radius_mm**2, 0.0))
    sine, cosine = np.array([m * radius_mm - k * flank, m * flank + k * radius_mm]) / (m**2 + k**2)
    from_crest = np.abs((z_mm + 2.0 * m) % (4.0 * m) - 2.0 * m)
    from_nearer = np.minimum(from_crest, 2.0 * m - from_crest)  # distance from the nearer crest or valley
    arc = radius_mm - np.sqrt(np.maximum(radius_mm**2 - from_nearer**2, 0.0))
    straight = 0.5 * amplitude_mm - (m - from_nearer) * sine / cosine
    depth = np.where(from_nearer <= radius_mm * sine, arc, straight)
    return np.where(from_crest <= m, depth, amplitude_mm - depth)


@dataclass(frozen=True, eq=False)
class ChamberOutline:
    """Outline of a chamber's octant in sections of different wall radius.

    Args:
        half_mm: h, half the cross's thickness.
        wall_mm: r of each section, shape (k,).
        fillet_mm: f; 0: sharp corners.
    """

    half_mm: float
    wall_mm: NDArray[np.float64]
    fillet_mm: float = 0.0

    @property
    def cross_mm(self) -> float:
        """Both coordinates of the outline's point on the diagonal at the cross."""
        return self.half_mm + (1.0 - math.sqrt(0.5)) * self.fillet_mm

    @property
    def centre_mm(self) -> NDArray[np.float64]:
        """C, shape (k, 2)."""
        side = self.half_mm + self.fillet_mm
        return np.stack([np.sqrt((self.wall_mm - self.fillet_mm) ** 2 - side**2), np.full_like(self.wall_mm, side)], 1)

    @property
    def joint_mm(self) -> NDArray[np.float64]:
        """Middle of the fillet between arm and wall (sharp: their corner), shape (k, 2)."""
        middle = 0.5 * (self._wall_angle - 0.5 * math.pi)
        return self.centre_mm + self.fillet_mm * np.stack([np.cos(middle), np.sin(middle)], axis=1)

    def arm_side_mm(self, elements: int, order: int) -> NDArray[np.float64]:
        """Return points from the cross to the joint, shape (elements * order + 1, k, 2).

        They are evenly spaced if the corners are sharp; otherwise the first and the last element are the two fillets.
        """
        h, f, planes = self.half_mm, self.fillet_mm, self.wall_mm.size
        part = np.linspace(0.0, 1.0, elements * order + 1)[:, None, None]
        corner = np.broadcast_to([h, h], (planes, 2))
        if f == 0.0:
            return (1.0 - part) * corner + part * self.joint_mm
        at_cross = _arc(corner + f, f, np.full(planes, -0.75 * math.pi), np.full(planes, -0.5 * math.pi), order)
        end = 0.5 * (self._wall_angle - 0.5 * math.pi)
        at_wall = _arc(self.centre_mm, f, np.full(planes, -0.5 * math.pi), end, order)
        between = np.linspace(at_cross[-1], at_wall[0], (elements - 2) * order + 1)
        return np.concatenate([at_cross[:-1], between, at_wall[1:]])

    def wall_side_mm(self, elements: int, order: int) -> NDArray[np.float64]:
        """Return points from the joint to the diagonal, shape (elements * order + 1, k, 2).

        They are evenly spaced if the corners are sharp; otherwise the first element is the fillet.
        """
        f, origin = self.fillet_mm, np.zeros((self.wall_mm.size, 2))
        diagonal = np.full(self.wall_mm.size, 0.25 * math.pi)
        if f == 0.0:
            return _arc(origin, self.wall_mm, self._wall_angle, diagonal, elements * order)
        begin = 0.5 * (self._wall_angle - 0.5 * math.pi)
        at_arm = _arc(self.centre_mm, f, begin, self._wall_angle, order)
        return np.concatenate(
            [at_arm, _arc(origin, self.wall_mm, self._wall_angle, diagonal, (elements - 1) * order)[1:]]
        )

    def area_mm2(self) -> NDArray[np.float64]:
        """Return the area of the whole chamber in each section, shape (k,).

        With s = sqrt(r^2 - h^2): the sector between the sharp wall corners, minus the two triangles between its sides
        and the chamber's corner (h, h), minus what the fillets fill.
        """
        r, h, f = self.wall_mm, self.half_mm, self.fillet_mm
        s = np.sqrt(r**2 - h**2)
        sharp = 0.5 * r**2 * (0.5 * np.pi - 2.0 * np.arcsin(h / r)) - h * (s - h)
        x, y = self.centre_mm.T
        turn = self._wall_angle  # of the fillet's end on the wall, seen from the axis and from C
        swept = f**2 * (turn + 0.5 * np.pi) + f * (x * (np.sin(turn) + 1.0) - y * np.cos(turn))
        at_wall = 0.5 * (r**2 * (turn - np.arcsin(h / r)) - h * (s - x) - swept)
        return sharp - f**2 * (1.0 - 0.25 * np.pi) - 2.0 * at_wall

    @property
    def _wall_angle(self) -> NDArray[np.float64]:
        """Azimuth at which the wall's circle begins, shape (k,)."""
        x, y = self.centre_mm.T
        return np.arctan2(y, x)


def _arc(
    centre: NDArray[np.float64],
    radius: float | NDArray[np.float64],
    begin_rad: NDArray[np.float64],
    end_rad: NDArray[np.float64],
    count: int,
) -> NDArray[np.float64]:
    """Points of one circle's arc per section, evenly spaced, shape (count + 1, k, 2)."""
    angle = np.linspace(begin_rad, end_rad, count + 1)
    return centre + np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
