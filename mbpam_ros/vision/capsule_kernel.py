"""Compiled drawing of capsules: half of a frame's pixels may have to be tried for each of a bent finger's pieces."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

# Compiled when imported, not under the first frame: there the interpreter would stand still for a second.
_SIGNATURE = "void(f4[:,:,:], f4[:,:], f4[:,:,:], f8[::1], f8[::1], f8, f8, f8, f8, f8[::1], f8[::1], f8, f8)"


@njit(_SIGNATURE, cache=True, nogil=True)
def paint_capsule(
    image: NDArray[np.float32],
    distance: NDArray[np.float32],
    rays: NDArray[np.float32],
    origin: NDArray[np.float64],
    axis: NDArray[np.float64],
    radius: float,
    station: float,
    stripe: float,
    stripe_length: float,
    colour: NDArray[np.float64],
    light: NDArray[np.float64],
    ambient: float,
    diffuse: float,
) -> None:
    """Paint the capsule from the frame's origin to ``axis`` where it is nearer than what has been drawn.

    The first hit as in :func:`~mbpam_ros.vision.raycast.hit_capsule`. Both round ends lie within the cylinder
    continued, so a ray that misses this one misses all, and one that enters it between the ends enters there.

    Args:
        image: (H, W, 3) float32, 8 bit levels, painted on.
        distance: (H, W) float32, along the rays to what has been drawn; updated.
        rays: (3, H, W) float32, unit directions.
        origin: (3,), the eye [m].
        axis: (3,) [m].
        radius: [m].
        station: of the capsule's start along the finger [m], for the stripes.
        stripe: their depth, 0 to 1.
        stripe_length: their distance [m].
        colour: (3,), 8 bit levels.
        light: (3,), unit vector toward the lamp.
        ambient, diffuse: brightness without the lamp, and what the lamp adds at right angles.
    """
    ox, oy, oz = origin
    ax, ay, az = axis
    length_sq = ax * ax + ay * ay + az * az
    length = math.sqrt(length_sq)
    along_o = ax * ox + ay * oy + az * oz
    c = ox * ox + oy * oy + oz * oz - radius * radius
    c_far = c - 2.0 * along_o + length_sq
    for v in range(distance.shape[0]):
        for u in range(distance.shape[1]):
            dx, dy, dz = float(rays[0, v, u]), float(rays[1, v, u]), float(rays[2, v, u])
            along_d = ax * dx + ay * dy + az * dz
            half_b = ox * dx + oy * dy + oz * dz
            a = max(length_sq - along_d * along_d, 1e-12)
            b = length_sq * half_b - along_o * along_d
            discriminant = b * b - a * (length_sq * c - along_o * along_o)
            if discriminant < 0.0:
                continue
            t = (-b - math.sqrt(discriminant)) / a
            if not 0.0 <= along_o + t * along_d <= length_sq:
                b_far = half_b - along_d
                near, far = half_b * half_b - c, b_far * b_far - c_far
                t = math.inf
                if near >= 0.0:
                    t = -half_b - math.sqrt(near)
                if far >= 0.0:
                    t = min(t, -b_far - math.sqrt(far))
            # As it is kept: two pieces share the round end between them, and the first one keeps it.
            t = float(np.float32(t))
            if not 0.0 < t < distance[v, u]:
                continue
            x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
            along = (ax * x + ay * y + az * z) / length
            share = min(max(along / length, 0.0), 1.0)
            facing = (x - share * ax) * light[0] + (y - share * ay) * light[1] + (z - share * az) * light[2]
            brightness = ambient + diffuse * max(facing / radius, 0.0)
            brightness *= 1.0 - stripe + stripe * math.cos(2.0 * math.pi / stripe_length * (station + along))
            for i in range(3):
                image[v, u, i] = brightness * colour[i]
            distance[v, u] = t
