r"""Mechanics of one muscle as an inextensible Kirchhoff rod with a few modes of curvature.

Geometric variable strain (F. Renda et al., "A geometric variable-strain approach for static modeling of soft
manipulators with tendon and fluidic actuation", 2020) without stretch, shear and twist. Over the active part, of
length L, with sigma = 0 .. 1 along it and the Legendre polynomials P_i, the curvature in the material frame is

    L kappa(sigma) = sum_i q_i P_i(2 sigma - 1)        q_i = (q_ix, q_iy) [rad], toward x and y; i = 0 .. m - 1
    dR/dsigma = R [z x L kappa],  t = R z              R: orientation of the section, t: tangent

q_0 is the bend from end to end, added up in the material frame; m = 1 is the constant curvature of the tier ``arc``.

Rotations: the active part is cut at the S + 1 Gauss-Lobatto points. A segment with the bends b_1, b_2 = h L kappa at
its two Gauss points (h: its share of the active part) turns by the fourth-order Magnus expansion

    R_k = R_{k-1} exp([o]),  o = z x (b_1 + b_2) / 2 + sqrt(3) / 12 (z x b_1) x (z x b_2),

exact where curvature is constant. It has no step limit: |o| may have any size, accuracy asks for |o| < 1 or so.

Positions, mass and gravity: tangents between the Lobatto points are the polynomial through them, the straight ends
have those of their neighbours. So every position is a fixed sum of tangents, p(s) = sum_k w_k(s) t_k, and so are

    kinetic energy    1/2 sum_kl G_kl dt_k/dt . dt_l/dt,   G = rho integral w(s) w(s)^T ds,  integrated exactly
    energy in gravity -g sum_k W_k t_k,z,                  W = rho integral w(s) ds

(rho: mass per length; turning inertia of the sections is neglected, 1 % of the tip's). All velocities, forces and
velocity terms come from the exact derivatives of these sums with respect to q: the discrete muscle has a Lagrangian of
its own, hence an energy that it keeps.

Frame: the clamp's, z along the hanging muscle. Columns of Jacobians: q_0x, q_0y, q_1x, ...
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.plant.mechanics.kernel import kernel
from mbpam_ros.plant.mechanics.vectors import Array, Vector, combined, cross, dot, plus

_MAGNUS = math.sqrt(3.0) / 12.0
_GAUSS = 0.5 / math.sqrt(3.0)


class Rod(NamedTuple):
    """What does not change of a muscle with m modes and S segments.

    Args:
        bends: bends of the segments at their two Gauss points per q_i, shape (S, 2, m).
        springs: stiffness of q_i over B, 1 / (L (2 i + 1)) [1/m], shape (m,).
        inertia: upper triangle C with C^T C = G [m sqrt(kg)], of the points 1 to S, shape (S, S).
        levers: W of the points 1 to S [kg m], shape (S,).
        balls: w(s) of the balls that touch [m], shape (n, S + 1).
        turns: weights of the points in the turning of the balls, shape (n, S + 1).
        spacing, radius: of the balls [m].
    """

    bends: Array
    springs: Array
    inertia: Array
    levers: Array
    balls: Array
    turns: Array
    spacing: float
    radius: float


class Motion(NamedTuple):
    """Muscles in motion at the Lobatto points; the row of point 0, the clamp, stays as it is.

    Args:
        tangent: t, shape (4, S + 1, 3).
        turning: derivative of the turning of the section by q, shape (4, S + 1, 3, 2 m).
        slope: derivative of t by q, shape (4, S + 1, 3, 2 m).
        acceleration: d2t/dt2 while dq/dt is constant, shape (4, S + 1, 3).
    """

    tangent: Array
    turning: Array
    slope: Array
    acceleration: Array


def build_rod(geometry: MuscleGeometry, modes: int, segments: int, balls: int) -> Rod:
    """Return the rod with ``modes`` modes a plane and ``segments`` segments.

    At 170 deg, four segments place the tip to 0.05 % and have the mass matrix to 3e-4; each one more is ten times as
    good. ``balls`` of the muscle's radius stand evenly along it, the last one a radius before its end.
    """
    shares = 0.5 * (1.0 + _lobatto_points(segments))
    widths = np.diff(shares)
    middles = shares[:-1] + 0.5 * widths
    at = middles[:, None] + widths[:, None] * np.array([-_GAUSS, _GAUSS])
    bends = widths[:, None, None] * legendre.legvander(2.0 * at - 1.0, modes - 1)
    inertia, levers = _inertia_and_levers(geometry, segments)
    ball_at = np.linspace(0.0, geometry.length_m - geometry.outer_radius_m, balls)
    return Rod(
        bends=np.ascontiguousarray(bends),
        springs=1.0 / (geometry.active_length_m * (2.0 * np.arange(modes, dtype=np.float64) + 1.0)),
        inertia=inertia,
        levers=levers,
        balls=position_weights(geometry, segments, ball_at),
        turns=_turn_weights(geometry, segments, ball_at),
        spacing=float(ball_at[1]),
        radius=geometry.outer_radius_m,
    )


def motion_at_rest(fingers: int, modes: int, segments: int) -> Motion:
    """Return the motion of straight muscles; what is not the clamp's is to be overwritten by :func:`move_rods`."""
    tangent = np.zeros((fingers, segments + 1, 3))
    tangent[..., 2] = 1.0
    columns = np.zeros((2, fingers, segments + 1, 3, 2 * modes))
    return Motion(tangent, columns[0].copy(), columns[1].copy(), np.zeros_like(tangent))


def position_weights(geometry: MuscleGeometry, segments: int, arc_length_m: ArrayLike) -> Array:
    """Return w(s) [m], shape (n, S + 1): the position at arc length s from the clamp is w(s) @ tangents (S + 1, 3)."""
    along = np.asarray(arc_length_m, dtype=float)
    active = np.clip(along - geometry.end_length_m, 0.0, geometry.active_length_m)
    integrals = legendre.legint(_lagrange_coefficients(segments), lbnd=-1.0)
    weights = legendre.legval(2.0 * active / geometry.active_length_m - 1.0, integrals).T
    weights = 0.5 * geometry.active_length_m * weights
    weights[:, 0] += np.minimum(along, geometry.end_length_m)
    weights[:, -1] += np.maximum(along - geometry.end_length_m - geometry.active_length_m, 0.0)
    return np.ascontiguousarray(weights)


def _turn_weights(geometry: MuscleGeometry, segments: int, arc_length_m: Array) -> Array:
    active = np.clip(arc_length_m - geometry.end_length_m, 0.0, geometry.active_length_m)
    values = legendre.legval(2.0 * active / geometry.active_length_m - 1.0, _lagrange_coefficients(segments))
    return np.ascontiguousarray(values.T)


def _inertia_and_levers(geometry: MuscleGeometry, segments: int) -> tuple[Array, Array]:
    """Return C and W; the rules are exact for the polynomials w: of degree S + 1 on the active part, 1 on the end."""
    inertia, levers = np.zeros((segments, segments)), np.zeros(segments)
    for count, start, length in (
        (segments + 2, geometry.end_length_m, geometry.active_length_m),
        (2, geometry.end_length_m + geometry.active_length_m, geometry.end_length_m),
    ):
        x, weight = legendre.leggauss(count)
        mass = 0.5 * length * weight * geometry.mass_per_length_kg_m
        positions = position_weights(geometry, segments, start + 0.5 * length * (1.0 + x))[:, 1:]
        inertia += positions.T @ (mass[:, None] * positions)
        levers += mass @ positions
    return np.ascontiguousarray(np.linalg.cholesky(inertia).T), levers


def _lobatto_points(segments: int) -> Array:
    inner = legendre.Legendre.basis(segments).deriv().roots()
    return np.concatenate([[-1.0], np.sort(inner.real), [1.0]])


def _lagrange_coefficients(segments: int) -> Array:
    """Legendre coefficients of the polynomials that are 1 at one Lobatto point and 0 at the others, in columns."""
    inverse = np.linalg.inv(legendre.legvander(_lobatto_points(segments), segments))
    return inverse.astype(np.float64, copy=False)


@kernel
def stumpff(u: float) -> tuple[float, float, float, float, float]:
    """Return c_1 .. c_5 at u = x^2 >= 0: c_1 = sin x / x, c_2 = (1 - cos x) / u, c_{k+2} = (1 / k! - c_k) / u."""
    if u > 1.0:
        angle = math.sqrt(u)
        c1, c2 = math.sin(angle) / angle, (1.0 - math.cos(angle)) / u
        c3 = (1.0 - c1) / u
        return c1, c2, c3, (0.5 - c2) / u, (1.0 / 6.0 - c3) / u
    c4, c5 = 1.0 - u * (1.0 / 240.0), 1.0 - u * (1.0 / 272.0)
    c4, c5 = 1.0 - u * (1.0 / 182.0) * c4, 1.0 - u * (1.0 / 210.0) * c5
    c4, c5 = 1.0 - u * (1.0 / 132.0) * c4, 1.0 - u * (1.0 / 156.0) * c5
    c4, c5 = 1.0 - u * (1.0 / 90.0) * c4, 1.0 - u * (1.0 / 110.0) * c5
    c4, c5 = 1.0 - u * (1.0 / 56.0) * c4, 1.0 - u * (1.0 / 72.0) * c5
    c4, c5 = (1.0 / 24.0) * (1.0 - u * (1.0 / 30.0) * c4), (1.0 / 120.0) * (1.0 - u * (1.0 / 42.0) * c5)
    c3 = 1.0 / 6.0 - u * c5
    return 1.0 - u * c3, 0.5 - u * c4, c3, c4, c5


@kernel
def move_rods(q: Array, rate: Array, rod: Rod, motion: Motion) -> None:
    """Write the motion of all muscles with coordinates q and their rates, shapes (4, 2 m).

    A segment turns at T do/dt seen from its start, T = 1 + c_2 [o] + c_3 [o]^2, and while dq/dt is constant this grows
    at dT/dt do/dt + T d2o/dt2; only the Magnus term, along z, has a second derivative then.
    """
    bends, modes = rod.bends, rod.bends.shape[2]
    tangent, acceleration, turning, slope = motion.tangent, motion.acceleration, motion.turning, motion.slope
    for f in range(q.shape[0]):
        rx, ry, rz = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)  # rows of R
        turn, gain = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)  # turning rate of the section, and its rate
        for k in range(rod.bends.shape[0]):
            b1x, b1y, b2x, b2y, d1x, d1y, d2x, d2y = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for i in range(modes):
                x, y, one, two = 2 * i, 2 * i + 1, bends[k, 0, i], bends[k, 1, i]
                b1x, b1y, b2x, b2y = b1x + one * q[f, x], b1y + one * q[f, y], b2x + two * q[f, x], b2y + two * q[f, y]
                d1x, d1y, d2x, d2y = (
                    d1x + one * rate[f, x],
                    d1y + one * rate[f, y],
                    d2x + two * rate[f, x],
                    d2y + two * rate[f, y],
                )
            o = (-0.5 * (b1y + b2y), 0.5 * (b1x + b2x), _MAGNUS * (b1x * b2y - b1y * b2x))
            do = (-0.5 * (d1y + d2y), 0.5 * (d1x + d2x), _MAGNUS * (d1x * b2y + b1x * d2y - d1y * b2x - b1y * d2x))
            ddo = 2.0 * _MAGNUS * (d1x * d2y - d1y * d2x)  # along z only
            u, du = dot(o, o), 2.0 * dot(o, do)
            c1, c2, c3, c4, c5 = stumpff(u)
            # rows of R [o] and R [o]^2, then of R T
            ax, ay, az = cross(rx, o), cross(ry, o), cross(rz, o)
            bx, by, bz = cross(ax, o), cross(ay, o), cross(az, o)
            tx = combined(1.0, rx, c2, ax, c3, bx)
            ty = combined(1.0, ry, c2, ay, c3, by)
            tz = combined(1.0, rz, c2, az, c3, bz)
            # r = dT/dt do/dt, with dc_k/du = (k c_{k+2} - c_{k+1}) / 2
            e = cross(o, do)
            r = combined(c3, cross(do, e), 0.5 * (2.0 * c4 - c3) * du, e, 0.5 * (3.0 * c5 - c4) * du, cross(o, e))
            own = (dot(tx, do), dot(ty, do), dot(tz, do))
            own_gain = (dot(rx, r) + tx[2] * ddo, dot(ry, r) + ty[2] * ddo, dot(rz, r) + tz[2] * ddo)
            gain = combined(1.0, gain, 1.0, own_gain, 1.0, cross(turn, own))
            turn = plus(turn, own)
            rx = combined(1.0, rx, c1, ax, c2, bx)
            ry = combined(1.0, ry, c1, ay, c2, by)
            rz = combined(1.0, rz, c1, az, c2, bz)
            t = (rx[2], ry[2], rz[2])
            change = plus(cross(gain, t), cross(turn, cross(turn, t)))
            for i in range(3):
                tangent[f, k + 1, i], acceleration[f, k + 1, i] = t[i], change[i]
            for i in range(modes):
                one, two = bends[k, 0, i], bends[k, 1, i]
                mean, one, two = 0.5 * (one + two), _MAGNUS * one, _MAGNUS * two
                x_along, y_along = one * b2y - two * b1y, two * b1x - one * b2x  # do/dq along z; across it is z x mean
                for j in range(2):
                    n, p, y, z = 2 * i + j, 1 - j, (mean if j == 0 else -mean), (x_along if j == 0 else y_along)
                    wx = turning[f, k, 0, n] + tx[p] * y + tx[2] * z
                    wy = turning[f, k, 1, n] + ty[p] * y + ty[2] * z
                    wz = turning[f, k, 2, n] + tz[p] * y + tz[2] * z
                    turning[f, k + 1, 0, n], turning[f, k + 1, 1, n], turning[f, k + 1, 2, n] = wx, wy, wz
                    slope[f, k + 1, 0, n] = wy * t[2] - wz * t[1]
                    slope[f, k + 1, 1, n] = wz * t[0] - wx * t[2]
                    slope[f, k + 1, 2, n] = wx * t[1] - wy * t[0]


@kernel
def masses_and_loads(rod: Rod, motion: Motion, gravity: float, work: Array, mass: Array, load: Array) -> None:
    """Write mass matrices (4, 2 m, 2 m) [kg m2] and loads (4, 2 m) [N m] of gravity less velocity terms of all muscles.

    ``gravity`` is along +z in the (accelerated) clamp frame. With J_k = dt_k/dq, a_k the acceleration of t_k while
    dq/dt is constant and the factor C of G: mass = Z^T Z, load = sum_k W_k g z^T J_k - Z^T C a, Z = C J.

    Args:
        work: scratch, shape (m + 1, 6 S).
    """
    segments, modes, inertia, levers = rod.inertia.shape[0], rod.bends.shape[2], rod.inertia, rod.levers
    slope, acceleration = motion.slope, motion.acceleration
    for finger in range(load.shape[0]):
        for k in range(segments):
            ax, ay, az = 0.0, 0.0, 0.0
            for n in range(k, segments):
                share = inertia[k, n]
                ax += share * acceleration[finger, n + 1, 0]
                ay += share * acceleration[finger, n + 1, 1]
                az += share * acceleration[finger, n + 1, 2]
            work[modes, 3 * k], work[modes, 3 * k + 1], work[modes, 3 * k + 2] = ax, ay, az
        for i in range(modes):
            x, y, load_x, load_y = 2 * i, 2 * i + 1, 0.0, 0.0
            for k in range(segments):
                xx, yx, zx, xy, yy, zy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # rows of Z: axis, column
                for n in range(k, segments):
                    share = inertia[k, n]
                    xx, xy = xx + share * slope[finger, n + 1, 0, x], xy + share * slope[finger, n + 1, 0, y]
                    yx, yy = yx + share * slope[finger, n + 1, 1, x], yy + share * slope[finger, n + 1, 1, y]
                    zx, zy = zx + share * slope[finger, n + 1, 2, x], zy + share * slope[finger, n + 1, 2, y]
                work[i, 6 * k], work[i, 6 * k + 1], work[i, 6 * k + 2] = xx, xy, yx
                work[i, 6 * k + 3], work[i, 6 * k + 4], work[i, 6 * k + 5] = yy, zx, zy
                ax, ay, az = work[modes, 3 * k], work[modes, 3 * k + 1], work[modes, 3 * k + 2]
                weight = gravity * levers[k]
                load_x += weight * slope[finger, k + 1, 2, x] - xx * ax - yx * ay - zx * az
                load_y += weight * slope[finger, k + 1, 2, y] - xy * ax - yy * ay - zy * az
            load[finger, x], load[finger, y] = load_x, load_y
            for j in range(i + 1):
                xx, xy, yx, yy = 0.0, 0.0, 0.0, 0.0
                for r in range(0, 6 * segments, 2):
                    ix, iy, jx, jy = work[i, r], work[i, r + 1], work[j, r], work[j, r + 1]
                    xx, xy, yx, yy = xx + ix * jx, xy + ix * jy, yx + iy * jx, yy + iy * jy
                v, w = 2 * j, 2 * j + 1
                mass[finger, x, v], mass[finger, x, w], mass[finger, y, v], mass[finger, y, w] = xx, xy, yx, yy
                mass[finger, v, x], mass[finger, w, x], mass[finger, v, y], mass[finger, w, y] = xx, xy, yx, yy


@kernel(forceinline=True)
def ball_position(rod: Rod, tangent: Array, ball: int) -> Vector:
    """Return the position of a ball of the muscle with these tangents, shape (S + 1, 3), from its clamp."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(tangent.shape[0]):
        weight = rod.balls[ball, k]
        x, y, z = x + weight * tangent[k, 0], y + weight * tangent[k, 1], z + weight * tangent[k, 2]
    return x, y, z


@kernel(forceinline=True)
def ball_jacobian(rod: Rod, motion: Motion, finger: int, ball: int, sign: float, arm: Vector, jacobian: Array) -> None:
    """Write sign d(position, turning)/dq of the material at ``arm`` from a ball's centre.

    It goes into columns 0 to 2 m - 1 of ``jacobian`` (6, 2 m or more).
    """
    slope, turning = motion.slope[finger], motion.turning[finger]
    for j in range(slope.shape[2]):
        px, py, pz, wx, wy, wz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(1, slope.shape[0]):
            far, near = rod.balls[ball, k], rod.turns[ball, k]
            px, py, pz = px + far * slope[k, 0, j], py + far * slope[k, 1, j], pz + far * slope[k, 2, j]
            wx, wy, wz = wx + near * turning[k, 0, j], wy + near * turning[k, 1, j], wz + near * turning[k, 2, j]
        jacobian[0, j] = sign * (px + wy * arm[2] - wz * arm[1])
        jacobian[1, j] = sign * (py + wz * arm[0] - wx * arm[2])
        jacobian[2, j] = sign * (pz + wx * arm[1] - wy * arm[0])
        jacobian[3, j], jacobian[4, j], jacobian[5, j] = sign * wx, sign * wy, sign * wz
