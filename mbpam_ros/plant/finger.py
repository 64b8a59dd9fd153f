r"""Mechanics of one constant-curvature muscle in its two bend components.

The active part, of length L, carries the bend angle beta = (beta_x, beta_y) evenly: at the fraction sigma of it the
tangent has turned by phi = sigma beta. With u = phi . phi and the Stumpff functions c_k(u) (c_0 = cos, c_1 = sinc,
c_2 = (1 - cos) / u, all smooth at u = 0, where curvature and direction would be singular):

    tangent   t = (c_1 phi, c_0)
    position  p = (0, 0, e) + sigma L (c_2 phi, c_1)           (e: length of the rigid ends)
    turning   r = z x phi,  omega = (I + c_2 [r] + c_3 [r]^2) dr/dt

Frame: the clamp's, z along the hanging muscle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from mbpam_ros.actuator.design import MuscleGeometry

Array = NDArray[np.float64]

ACTIVE_NODES = 5
"""Gauss points of mass on the active part: mass matrix to 4e-6 at 170 deg."""


class Muscle(NamedTuple):
    """Lengths of a muscle [m]: of each rigid end and of the active part, and its outer radius."""

    end_length: float
    active_length: float
    radius: float


def mass_nodes(geometry: MuscleGeometry) -> Array:
    """Return the point masses that stand for the moving muscle, rows (arc length [m], mass [kg]).

    Gauss points on the active part and two on the far end piece, whose motion is quadratic in the arc length: exact.
    """
    nodes = []
    for count, start, length in (
        (ACTIVE_NODES, geometry.end_length_m, geometry.active_length_m),
        (2, geometry.end_length_m + geometry.active_length_m, geometry.end_length_m),
    ):
        x, weight = np.polynomial.legendre.leggauss(count)
        arc_length = start + 0.5 * length * (1.0 + x)
        nodes.append(np.column_stack([arc_length, 0.5 * length * weight * geometry.mass_per_length_kg_m]))
    return np.vstack(nodes)


@njit
def stumpff(u: float) -> tuple[float, float, float, float, float, float, float]:
    """Return c_0 .. c_6 at u >= 0; the two highest by series, good to 1e-11 for u < 40 (a full turn)."""
    c5, c6 = 0.0, 0.0
    for j in range(13, -1, -1):
        c5 = 1.0 - u * c5 / ((2.0 * j + 6.0) * (2.0 * j + 7.0))
        c6 = 1.0 - u * c6 / ((2.0 * j + 7.0) * (2.0 * j + 8.0))
    c5, c6 = c5 / 120.0, c6 / 720.0
    c4 = 1.0 / 24.0 - u * c6
    c3 = 1.0 / 6.0 - u * c5
    c2 = 0.5 - u * c4
    c1 = 1.0 - u * c3
    return 1.0 - u * c2, c1, c2, c3, c4, c5, c6


@njit
def station(bx: float, by: float, muscle: Muscle, s: float) -> tuple[float, float, float]:
    """Return the position at arc length s."""
    along = min(max(s - muscle.end_length, 0.0), muscle.active_length)
    sigma = along / muscle.active_length
    fx, fy = sigma * bx, sigma * by
    u = fx * fx + fy * fy
    if u < 1e-8:
        c0, c1, c2 = 1.0 - 0.5 * u, 1.0 - u / 6.0, 0.5 - u / 24.0
    else:
        angle = math.sqrt(u)
        c0, c1 = math.cos(angle), math.sin(angle) / angle
        half = math.sin(0.5 * angle)
        c2 = 2.0 * half * half / u
    near = min(s, muscle.end_length)  # straight pieces: this one, and one after the active part
    far = s - along - near
    across = along * c2 + far * c1
    return across * fx, across * fy, near + along * c1 + far * c0


@njit
def station_jacobian(
    bx: float, by: float, muscle: Muscle, s: float, sign: float, ax: float, ay: float, az: float, jacobian: Array
) -> None:
    """Write sign d(position, turning)/d(beta) of the material at (ax, ay, az) from the centreline at arc length s.

    It goes into columns 0 and 1 of ``jacobian`` (6, 2 or more).
    """
    along = min(max(s - muscle.end_length, 0.0), muscle.active_length)
    sigma = along / muscle.active_length
    far = max(s - muscle.end_length - muscle.active_length, 0.0)
    fx, fy = sigma * bx, sigma * by
    u = fx * fx + fy * fy
    c0, c1, c2, c3, c4, c5, c6 = stumpff(u)
    d1, d2 = 0.5 * (c3 - c2), 0.5 * (2.0 * c4 - c3)  # dc_k/du = (k c_{k+2} - c_{k+1}) / 2
    diagonal = along * c2 + far * c1
    mixed = 2.0 * (along * d2 + far * d1)
    upright = 2.0 * along * d1 - far * c1
    scale = sign * sigma
    for j in range(2):
        f = fx if j == 0 else fy
        ex, ey = (1.0, 0.0) if j == 0 else (0.0, 1.0)
        # [r]^2 w = r (r . w) - u w, with r = z x phi, w = z x e_j, r . w = f; z component of r x w last
        wx, wy, wz = -ey + c3 * (u * ey - fy * f), ex + c3 * (fx * f - u * ex), c2 * (fx * ey - fy * ex)
        jacobian[0, j] = scale * (diagonal * ex + mixed * fx * f + wy * az - wz * ay)
        jacobian[1, j] = scale * (diagonal * ey + mixed * fy * f + wz * ax - wx * az)
        jacobian[2, j] = scale * (upright * f + wx * ay - wy * ax)
        jacobian[3, j], jacobian[4, j], jacobian[5, j] = scale * wx, scale * wy, scale * wz


@njit
def inertia_and_load(
    bx: float, by: float, vx: float, vy: float, muscle: Muscle, nodes: Array, gravity: float
) -> tuple[float, float, float, float, float]:
    """Return mass matrix (m_xx, m_xy, m_yy) [kg m2] and load (q_x, q_y) [N m] of gravity less velocity terms.

    ``gravity`` is along +z in the (accelerated) clamp frame. The load is sum m J^T (g - d2p/dt2 at zero bend
    acceleration), the exact velocity terms of the Lagrangian of the point masses.
    """
    mxx, mxy, myy, qx, qy = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(nodes.shape[0]):
        s, mass = nodes[k, 0], nodes[k, 1]
        along = min(max(s - muscle.end_length, 0.0), muscle.active_length)
        sigma = along / muscle.active_length
        far = max(s - muscle.end_length - muscle.active_length, 0.0)
        fx, fy, wx, wy = sigma * bx, sigma * by, sigma * vx, sigma * vy
        u = fx * fx + fy * fy
        c0, c1, c2, c3, c4, c5, c6 = stumpff(u)
        d1, d2 = 0.5 * (c3 - c2), 0.5 * (2.0 * c4 - c3)
        d3, d4 = 0.5 * (3.0 * c5 - c4), 0.5 * (4.0 * c6 - c5)
        e1, e2 = 0.5 * (d3 - d2), 0.5 * (2.0 * d4 - d3)
        diagonal = along * c2 + far * c1
        slope = along * d2 + far * d1
        upright = 2.0 * along * d1 - far * c1
        jxx = sigma * (diagonal + 2.0 * slope * fx * fx)
        jxy = sigma * 2.0 * slope * fx * fy
        jyy = sigma * (diagonal + 2.0 * slope * fy * fy)
        jzx, jzy = sigma * upright * fx, sigma * upright * fy
        mxx += mass * (jxx * jxx + jxy * jxy + jzx * jzx)
        mxy += mass * (jxx * jxy + jxy * jyy + jzx * jzy)
        myy += mass * (jxy * jxy + jyy * jyy + jzy * jzy)
        du, ddu = 2.0 * (fx * wx + fy * wy), 2.0 * (wx * wx + wy * wy)
        turn = 2.0 * slope * du
        stretch = (along * e2 + far * e1) * du * du + slope * ddu
        ax, ay = turn * wx + stretch * fx, turn * wy + stretch * fy
        az = (along * e1 - 0.5 * far * d1) * du * du + (along * d1 - 0.5 * far * c1) * ddu
        qx += mass * (-jxx * ax - jxy * ay + jzx * (gravity - az))
        qy += mass * (-jxy * ax - jyy * ay + jzy * (gravity - az))
    return mxx, mxy, myy, qx, qy
