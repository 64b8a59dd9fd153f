r"""Mechanics of one muscle as a Kirchhoff rod with a few modes of each strain: curvature, twist, stretch.

Geometric variable strain (F. Renda et al., "A geometric variable-strain approach for static modeling of soft
manipulators with tendon and fluidic actuation", 2020) without shear. Over the active part, of unstretched length L,
with sigma = 0 .. 1 along it and the Legendre polynomials P_i, curvature and twist in the material frame and the
stretch are

    L kappa(sigma) = sum_i q_i P_i(2 sigma - 1)        q_i = (q_ix, q_iy) [rad], toward x and y; i = 0 .. m - 1
    L tau(sigma)   = sum_i c_i P_i(2 sigma - 1)        c_i [rad], right-handed about the tangent; i = 0 .. m_c - 1
    s(sigma)       = 1 + sum_i e_i P_i(2 sigma - 1)    i = 0 .. m_e - 1
    dR/dsigma = R [u],  u = z x L kappa + L tau z,  t = R z,  dp/dsigma = L s t

with R the orientation of the section, t the tangent, p the position. q_0 is the bend from end to end, added up in the
material frame; m = 1 is the constant curvature of the tier ``arc``. A strain without modes is absent and costs nothing.

Rotations: the active part is cut at the S + 1 Gauss-Lobatto points. A segment with h u = u_1, u_2 at its two Gauss
points (h: its share of the active part) turns by the fourth-order Magnus expansion

    R_k = R_{k-1} exp([o]),  o = (u_1 + u_2) / 2 + sqrt(3) / 12 u_1 x u_2,

exact where curvature and twist are constant. It has no step limit: |o| may have any size, accuracy asks for |o| < 1 or
so.

Positions, mass and gravity: s t between the Lobatto points is the polynomial through them, the straight ends have the
tangents of their neighbours. So every position is a fixed sum of directors, p(s) = sum_k w_k(s) d_k: of the tangents
t_0 .. t_S without stretch; with it of z (the straight end at the clamp), s_0 t_0 .. s_S t_S and t_S (the end at the
tip). And so are

    kinetic energy    1/2 sum_kl G_kl dd_k/dt . dd_l/dt,   G = rho integral w(s) w(s)^T ds,  integrated exactly
    energy in gravity -g . sum_k W_k d_k,                  W = rho integral w(s) ds

(rho: mass per length; of the turning inertia of the sections only that about the tangent counts, and only where there
is twist: across it is 1 % of the tip's). All velocities, forces and velocity terms come from the exact derivatives of
these sums with respect to the coordinates: the discrete muscle has a Lagrangian of its own, hence an energy that it
keeps. Spin is not the rate of a coordinate: with W_i = d(turning)/dq_i and the turning rate w, the equations of its
energy 1/2 J (t . w)^2 are J [W_i.t d(t.w)/dt - (t.w) t.(w x W_i)].

Frame: the clamp's, z along the hanging muscle. Columns of Jacobians: q_0x, q_0y, q_1x, ..., c_0, ..., e_0, ...
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.plant.mechanics.kernel import kernel
from mbpam_ros.plant.mechanics.vectors import Array, Vector, combined, cross, dot, plus, times

_MAGNUS = math.sqrt(3.0) / 12.0
_GAUSS = 0.5 / math.sqrt(3.0)


LARGEST_STRETCH = 0.8
"""What |s - 1| may be anywhere; the contact search relies on it."""


class Rod(NamedTuple):
    """What does not change of a muscle with S segments, D = 2 m + m_c + m_e coordinates and N + 1 directors.

    Args:
        bends, twists: bend and twist of the segments at their two Gauss points per q_i and c_i, shapes (S, 2, m) and
            (S, 2, m_c).
        stretches: stretch at the Lobatto points per e_i, shape (S + 1, m_e).
        springs: stiffness of q_i over B and of c_i over GJ, 1 / (L (2 i + 1)) [1/m], shape (the most modes,).
        stretch_springs: stiffness of e_i over EA, L / (2 i + 1) [m], shape (m_e,).
        active_length: L [m].
        inertia: upper triangle C with C^T C = G [m sqrt(kg)], of the directors 1 to N, shape (N, N).
        spins: J, turning inertia about the tangent of points 1 to S [kg m2], shape (S,); without twist (0,).
        levers: W of the directors 1 to N [kg m], shape (N,).
        balls: w(s) of the balls that touch [m], shape (n, N + 1).
        turns: weights of the directors' sections in the turning of the balls, shape (n, N + 1).
        spacing, radius: of the balls [m]; the spacing is that of the unstretched muscle.
        farthest: what the spacing may become by stretch [m].
    """

    bends: Array
    twists: Array
    stretches: Array
    springs: Array
    stretch_springs: Array
    active_length: float
    inertia: Array
    spins: Array
    levers: Array
    balls: Array
    turns: Array
    spacing: float
    radius: float
    farthest: float


class Motion(NamedTuple):
    """Muscles in motion; the row of director 0, the clamp's, stays as it is.

    Args:
        tangent: directors d_k: t at the Lobatto points, or, with stretch, z, s t at these points, and t of the tip;
            shape (4, N + 1, 3). The last one is a unit vector, the tip's.
        turning: derivative of the turning of the directors' sections by the coordinates, shape (4, N + 1, 3, D).
        slope: derivative of the directors, shape (4, N + 1, 3, D).
        acceleration: d2/dt2 of the directors while the coordinates' rates are constant, shape (4, N + 1, 3).
        spin: derivative of the spin about the tangent of points 1 to S, W_i.t, shape (4, S, D); without twist none.
        spin_load: d(t.w)/dt while the coordinates' rates are constant, and (t.w) t.(w x W_i), shape (4, S, 1 + D).
    """

    tangent: Array
    turning: Array
    slope: Array
    acceleration: Array
    spin: Array
    spin_load: Array


def build_rod(
    geometry: MuscleGeometry, modes: int, segments: int, balls: int, twist_modes: int = 0, stretch_modes: int = 0
) -> Rod:
    """Return the rod with ``modes`` modes of curvature a plane, those of twist and stretch, and ``segments`` segments.

    At 170 deg, four segments place the tip to 0.05 % and have the mass matrix to 3e-4; each one more is ten times as
    good. ``balls`` of the muscle's radius stand evenly along it, the last one a radius before its end. About their axis
    sections turn like a solid cylinder's.
    """
    stretching = stretch_modes > 0
    shares = 0.5 * (1.0 + _lobatto_points(segments))
    widths = np.diff(shares)
    middles = shares[:-1] + 0.5 * widths
    at = middles[:, None] + widths[:, None] * np.array([-_GAUSS, _GAUSS])
    legendre_at_gauss = widths[:, None, None] * legendre.legvander(2.0 * at - 1.0, max(modes, twist_modes, 1) - 1)
    at_points = legendre.legvander(2.0 * shares - 1.0, max(stretch_modes, 1) - 1).astype(np.float64, copy=False)
    inertia, levers = _inertia_and_levers(geometry, segments, stretching)
    ball_at = np.linspace(0.0, geometry.length_m - geometry.outer_radius_m, balls)
    degrees = 2.0 * np.arange(max(modes, twist_modes, stretch_modes), dtype=np.float64) + 1.0
    return Rod(
        bends=np.ascontiguousarray(legendre_at_gauss[..., :modes]),
        twists=np.ascontiguousarray(legendre_at_gauss[..., :twist_modes]),
        stretches=np.ascontiguousarray(at_points[:, :stretch_modes]),
        springs=1.0 / (geometry.active_length_m * degrees[: max(modes, twist_modes)]),
        stretch_springs=geometry.active_length_m / degrees[:stretch_modes],
        active_length=geometry.active_length_m,
        inertia=inertia,
        spins=_spin_inertia(geometry, segments) if twist_modes else np.zeros(0),
        levers=levers,
        balls=position_weights(geometry, segments, ball_at, stretching),
        turns=_turn_weights(geometry, segments, ball_at, stretching),
        spacing=float(ball_at[1]),
        radius=geometry.outer_radius_m,
        farthest=float(ball_at[1]) * (1.0 + LARGEST_STRETCH if stretching else 1.0),
    )


def coordinates_of(rod: Rod) -> int:
    """Return D."""
    return 2 * int(rod.bends.shape[2]) + int(rod.twists.shape[2]) + int(rod.stretches.shape[1])


def motion_at_rest(rod: Rod, fingers: int) -> Motion:
    """Return the motion of straight muscles; what is not the clamp's is to be overwritten by :func:`move_rods`."""
    directors, columns, spins = len(rod.levers) + 1, coordinates_of(rod), len(rod.spins)
    tangent = np.zeros((fingers, directors, 3))
    tangent[..., 2] = 1.0
    return Motion(
        tangent,
        np.zeros((fingers, directors, 3, columns)),
        np.zeros((fingers, directors, 3, columns)),
        np.zeros_like(tangent),
        np.zeros((fingers, spins, columns)),
        np.zeros((fingers, spins, 1 + columns)),
    )


def room_for_loads(rod: Rod) -> Array:
    """Return the scratch of :func:`masses_and_loads`."""
    return np.zeros((1 + (coordinates_of(rod) + 1) // 2, 6 * len(rod.levers) + 2 * len(rod.spins)))


def position_weights(
    geometry: MuscleGeometry, segments: int, arc_length_m: ArrayLike, stretching: bool = False
) -> Array:
    """Return w(s) [m], shape (n, N + 1): the position at arc length s, unstretched, is w(s) @ directors (N + 1, 3)."""
    along = np.asarray(arc_length_m, dtype=float)
    active = np.clip(along - geometry.end_length_m, 0.0, geometry.active_length_m)
    integrals = legendre.legint(_lagrange_coefficients(segments), lbnd=-1.0)
    weights = legendre.legval(2.0 * active / geometry.active_length_m - 1.0, integrals).T
    weights = 0.5 * geometry.active_length_m * weights
    if stretching:  # the ends have directors of their own
        weights = np.pad(weights, ((0, 0), (1, 1)))
    weights[:, 0] += np.minimum(along, geometry.end_length_m)
    weights[:, -1] += np.maximum(along - geometry.end_length_m - geometry.active_length_m, 0.0)
    return np.ascontiguousarray(weights)


def _turn_weights(geometry: MuscleGeometry, segments: int, arc_length_m: Array, stretching: bool) -> Array:
    active = np.clip(arc_length_m - geometry.end_length_m, 0.0, geometry.active_length_m)
    values = legendre.legval(2.0 * active / geometry.active_length_m - 1.0, _lagrange_coefficients(segments)).T
    return np.ascontiguousarray(np.pad(values, ((0, 0), (1, 1))) if stretching else values)


def _spin_inertia(geometry: MuscleGeometry, segments: int) -> Array:
    """Return J of the points 1 to S: Lobatto's rule on the active part, and the end at the tip on the last one."""
    per_length = 0.5 * geometry.mass_per_length_kg_m * geometry.outer_radius_m**2
    integrals: Array = np.asarray(legendre.legval(1.0, legendre.legint(_lagrange_coefficients(segments), lbnd=-1.0)))
    spins: Array = 0.5 * geometry.active_length_m * per_length * integrals[1:]
    spins[-1] += geometry.end_length_m * per_length
    return spins


def _inertia_and_levers(geometry: MuscleGeometry, segments: int, stretching: bool) -> tuple[Array, Array]:
    """Return C and W; the rules are exact for the polynomials w: of degree S + 1 on the active part, 1 on the end."""
    directors = segments + 2 if stretching else segments
    inertia, levers = np.zeros((directors, directors)), np.zeros(directors)
    for count, start, length in (
        (segments + 2, geometry.end_length_m, geometry.active_length_m),
        (2, geometry.end_length_m + geometry.active_length_m, geometry.end_length_m),
    ):
        x, weight = legendre.leggauss(count)
        mass = 0.5 * length * weight * geometry.mass_per_length_kg_m
        positions = position_weights(geometry, segments, start + 0.5 * length * (1.0 + x), stretching)[:, 1:]
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


@kernel(forceinline=True)
def _write_column(turning: Array, slope: Array, f: int, row: int, n: int, w: Vector, t: Vector) -> None:
    turning[f, row, 0, n], turning[f, row, 1, n], turning[f, row, 2, n] = w
    slope[f, row, 0, n] = w[1] * t[2] - w[2] * t[1]
    slope[f, row, 1, n] = w[2] * t[0] - w[0] * t[2]
    slope[f, row, 2, n] = w[0] * t[1] - w[1] * t[0]


@kernel(forceinline=True)
def _write_spin(motion: Motion, f: int, k: int, row: int, columns: int, t: Vector, turn: Vector, gain: Vector) -> None:
    """Write spin and its load of point k + 1; the first ``columns`` coordinates turn it."""
    turning, spin, load = motion.turning[f, row], motion.spin[f, k], motion.spin_load[f, k]
    rate, across = dot(t, turn), cross(t, turn)
    load[0] = dot(t, gain)
    for n in range(columns):
        w = (turning[0, n], turning[1, n], turning[2, n])
        spin[n], load[1 + n] = dot(t, w), rate * dot(across, w)  # t.(w x W) = (t x w).W


@kernel(forceinline=True)
def _stretch_director(
    q: Array, rate: Array, rod: Rod, motion: Motion, f: int, k: int, row: int, t: Vector, swing: Vector
) -> None:
    """Make s t of the tangent t at point k + 1; after the last point stands t itself, the tip's."""
    stretches, tangent, acceleration, slope = rod.stretches, motion.tangent, motion.acceleration, motion.slope
    columns = slope.shape[3]
    first = columns - stretches.shape[1]
    if k == rod.bends.shape[0] - 1:
        for i in range(3):
            tangent[f, row + 1, i], acceleration[f, row + 1, i] = tangent[f, row, i], acceleration[f, row, i]
            for n in range(first):
                slope[f, row + 1, i, n] = slope[f, row, i, n]
                motion.turning[f, row + 1, i, n] = motion.turning[f, row, i, n]
    long, growth = 1.0, 0.0
    for i in range(stretches.shape[1]):
        long += stretches[k + 1, i] * q[f, first + i]
        growth += stretches[k + 1, i] * rate[f, first + i]
    for i in range(3):
        tangent[f, row, i] = long * t[i]
        acceleration[f, row, i] = long * acceleration[f, row, i] + 2.0 * growth * swing[i]
        for n in range(first):
            slope[f, row, i, n] *= long
        for n in range(first, columns):
            slope[f, row, i, n] = stretches[k + 1, n - first] * t[i]


def _mover(strained: bool) -> Callable[[Array, Array, Rod, Motion], None]:
    """Compile the motion of rods that only bend, or of all: one for all would cost the former a fifth more."""

    @kernel
    def move(q: Array, rate: Array, rod: Rod, motion: Motion) -> None:
        bends, twists, stretches = rod.bends, rod.twists, rod.stretches
        modes, twist_modes, stretch_modes = bends.shape[2], twists.shape[2], stretches.shape[1]
        first_twist, first_stretch = 2 * modes, 2 * modes + twist_modes
        stretching = strained and stretch_modes > 0
        tangent, acceleration, turning, slope = motion.tangent, motion.acceleration, motion.turning, motion.slope
        for f in range(q.shape[0]):
            rx, ry, rz = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)  # rows of R
            turn, gain = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)  # turning rate of the section, and its rate
            before = 0  # row of the section before
            if stretching:
                before = 1
                long = 1.0
                for i in range(stretch_modes):
                    long += stretches[0, i] * q[f, first_stretch + i]
                    slope[f, 1, 2, first_stretch + i] = stretches[0, i]
                tangent[f, 1, 2] = long
            for k in range(bends.shape[0]):
                b1x, b1y, b2x, b2y, d1x, d1y, d2x, d2y = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                for i in range(modes):
                    x, y, one, two = 2 * i, 2 * i + 1, bends[k, 0, i], bends[k, 1, i]
                    b1x, b1y, b2x, b2y = (
                        b1x + one * q[f, x],
                        b1y + one * q[f, y],
                        b2x + two * q[f, x],
                        b2y + two * q[f, y],
                    )
                    d1x, d1y, d2x, d2y = (
                        d1x + one * rate[f, x],
                        d1y + one * rate[f, y],
                        d2x + two * rate[f, x],
                        d2y + two * rate[f, y],
                    )
                o = (-0.5 * (b1y + b2y), 0.5 * (b1x + b2x), _MAGNUS * (b1x * b2y - b1y * b2x))
                do = (-0.5 * (d1y + d2y), 0.5 * (d1x + d2x), _MAGNUS * (d1x * b2y + b1x * d2y - d1y * b2x - b1y * d2x))
                ddo = (0.0, 0.0, 2.0 * _MAGNUS * (d1x * d2y - d1y * d2x))
                t1, t2, e1, e2 = 0.0, 0.0, 0.0, 0.0  # twist and its rate at the Gauss points
                if strained:
                    for i in range(twist_modes):
                        n, one, two = first_twist + i, twists[k, 0, i], twists[k, 1, i]
                        t1, t2 = t1 + one * q[f, n], t2 + two * q[f, n]
                        e1, e2 = e1 + one * rate[f, n], e2 + two * rate[f, n]
                    o = plus(o, (_MAGNUS * (b1x * t2 - t1 * b2x), _MAGNUS * (b1y * t2 - t1 * b2y), 0.5 * (t1 + t2)))
                    do = plus(
                        do,
                        (
                            _MAGNUS * (d1x * t2 + b1x * e2 - e1 * b2x - t1 * d2x),
                            _MAGNUS * (d1y * t2 + b1y * e2 - e1 * b2y - t1 * d2y),
                            0.5 * (e1 + e2),
                        ),
                    )
                    ddo = (2.0 * _MAGNUS * (d1x * e2 - e1 * d2x), 2.0 * _MAGNUS * (d1y * e2 - e1 * d2y), ddo[2])
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
                own_gain = (dot(rx, r) + dot(tx, ddo), dot(ry, r) + dot(ty, ddo), dot(rz, r) + dot(tz, ddo))
                gain = combined(1.0, gain, 1.0, own_gain, 1.0, cross(turn, own))
                turn = plus(turn, own)
                rx = combined(1.0, rx, c1, ax, c2, bx)
                ry = combined(1.0, ry, c1, ay, c2, by)
                rz = combined(1.0, rz, c1, az, c2, bz)
                t = (rx[2], ry[2], rz[2])
                here = before + 1
                swing = cross(turn, t)
                change = plus(cross(gain, t), cross(turn, swing))
                for i in range(3):
                    tangent[f, here, i], acceleration[f, here, i] = t[i], change[i]
                for i in range(modes):
                    one, two = bends[k, 0, i], bends[k, 1, i]
                    mean, one, two = 0.5 * (one + two), _MAGNUS * one, _MAGNUS * two
                    x_along, y_along = (
                        one * b2y - two * b1y,
                        two * b1x - one * b2x,
                    )  # do/dq along z; across it is z x mean
                    for j in range(2):
                        n, p, y, z = 2 * i + j, 1 - j, (mean if j == 0 else -mean), (x_along if j == 0 else y_along)
                        wx = turning[f, before, 0, n] + tx[p] * y + tx[2] * z
                        wy = turning[f, before, 1, n] + ty[p] * y + ty[2] * z
                        wz = turning[f, before, 2, n] + tz[p] * y + tz[2] * z
                        if strained:
                            aside = one * t2 - two * t1
                            wx, wy, wz = wx + tx[j] * aside, wy + ty[j] * aside, wz + tz[j] * aside
                        _write_column(turning, slope, f, here, n, (wx, wy, wz), t)
                if strained:
                    for i in range(twist_modes):
                        n, one, two = first_twist + i, twists[k, 0, i], twists[k, 1, i]
                        mean, one, two = 0.5 * (one + two), _MAGNUS * one, _MAGNUS * two
                        v = (two * b1x - one * b2x, two * b1y - one * b2y, mean)
                        w = (
                            turning[f, before, 0, n] + dot(tx, v),
                            turning[f, before, 1, n] + dot(ty, v),
                            turning[f, before, 2, n] + dot(tz, v),
                        )
                        _write_column(turning, slope, f, here, n, w, t)
                if strained and twist_modes > 0:
                    _write_spin(motion, f, k, here, first_stretch, t, turn, gain)
                if stretching:
                    _stretch_director(q, rate, rod, motion, f, k, here, t, swing)
                before = here

    return move


_move_bending, _move_strained = _mover(False), _mover(True)


@kernel(forceinline=True)
def move_rods(q: Array, rate: Array, rod: Rod, motion: Motion) -> None:
    """Write the motion of all muscles with coordinates q and their rates, shapes (4, D).

    A segment turns at T do/dt seen from its start, T = 1 + c_2 [o] + c_3 [o]^2, and while dq/dt is constant this grows
    at dT/dt do/dt + T d2o/dt2; only the Magnus term has a second derivative then.
    """
    if rod.twists.shape[2] + rod.stretches.shape[1] > 0:
        _move_strained(q, rate, rod, motion)
    else:
        _move_bending(q, rate, rod, motion)


@kernel
def masses_and_loads(rod: Rod, motion: Motion, gravity: Vector, work: Array, mass: Array, load: Array) -> None:
    """Write mass matrices (4, D, D) and loads (4, D) of gravity less velocity terms of all muscles, SI.

    ``gravity`` [m/s2] is that in the (accelerated) clamp frame. With J_k = dd_k/dq, a_k the acceleration of d_k while
    dq/dt is constant and the factor C of G: mass = Z^T Z, load = sum_k W_k g^T J_k - Z^T C a, Z = C J; a spin is a row
    of Z with sqrt(J) for C. Columns are taken in pairs, whose sums do not wait for each other; of an odd number of
    columns the last one is its own neighbour.

    Args:
        work: scratch, of :func:`room_for_loads`.
    """
    directors, inertia, levers, spins = rod.inertia.shape[0], rod.inertia, rod.levers, rod.spins
    slope, acceleration, columns = motion.slope, motion.acceleration, load.shape[1]
    pairs = (columns + 1) // 2
    rows = 6 * directors + 2 * spins.shape[0]
    for finger in range(load.shape[0]):
        for k in range(directors):
            ax, ay, az = 0.0, 0.0, 0.0
            for n in range(k, directors):
                share = inertia[k, n]
                ax += share * acceleration[finger, n + 1, 0]
                ay += share * acceleration[finger, n + 1, 1]
                az += share * acceleration[finger, n + 1, 2]
            work[pairs, 3 * k], work[pairs, 3 * k + 1], work[pairs, 3 * k + 2] = ax, ay, az
        for i in range(pairs):
            x, load_x, load_y = 2 * i, 0.0, 0.0
            y = min(x + 1, columns - 1)
            for k in range(directors):
                xx, yx, zx, xy, yy, zy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0  # rows of Z: axis, column
                for n in range(k, directors):
                    share = inertia[k, n]
                    xx, xy = xx + share * slope[finger, n + 1, 0, x], xy + share * slope[finger, n + 1, 0, y]
                    yx, yy = yx + share * slope[finger, n + 1, 1, x], yy + share * slope[finger, n + 1, 1, y]
                    zx, zy = zx + share * slope[finger, n + 1, 2, x], zy + share * slope[finger, n + 1, 2, y]
                work[i, 6 * k], work[i, 6 * k + 1], work[i, 6 * k + 2] = xx, xy, yx
                work[i, 6 * k + 3], work[i, 6 * k + 4], work[i, 6 * k + 5] = yy, zx, zy
                ax, ay, az = work[pairs, 3 * k], work[pairs, 3 * k + 1], work[pairs, 3 * k + 2]
                weight = times(levers[k], gravity)
                load_x += _work_of(weight, slope[finger, k + 1], x) - xx * ax - yx * ay - zx * az
                load_y += _work_of(weight, slope[finger, k + 1], y) - xy * ax - yy * ay - zy * az
            for k in range(spins.shape[0]):
                root, spin, spin_load = math.sqrt(spins[k]), motion.spin[finger, k], motion.spin_load[finger, k]
                work[i, 6 * directors + 2 * k], work[i, 6 * directors + 2 * k + 1] = root * spin[x], root * spin[y]
                load_x -= spins[k] * (spin[x] * spin_load[0] - spin_load[1 + x])
                load_y -= spins[k] * (spin[y] * spin_load[0] - spin_load[1 + y])
            load[finger, x], load[finger, y] = load_x, load_y
            for j in range(i + 1):
                xx, xy, yx, yy = 0.0, 0.0, 0.0, 0.0
                for r in range(0, rows, 2):
                    ix, iy, jx, jy = work[i, r], work[i, r + 1], work[j, r], work[j, r + 1]
                    xx, xy, yx, yy = xx + ix * jx, xy + ix * jy, yx + iy * jx, yy + iy * jy
                v = 2 * j
                w = min(v + 1, columns - 1)
                mass[finger, x, v], mass[finger, x, w], mass[finger, y, v], mass[finger, y, w] = xx, xy, yx, yy
                mass[finger, v, x], mass[finger, w, x], mass[finger, v, y], mass[finger, w, y] = xx, xy, yx, yy


@kernel(forceinline=True)
def _work_of(weight: Vector, slope: Array, column: int) -> float:
    """Along z first: where gravity is along it, no digit changes."""
    work: float = weight[2] * slope[2, column] + (weight[0] * slope[0, column] + weight[1] * slope[1, column])
    return work


@kernel(forceinline=True)
def ball_position(rod: Rod, tangent: Array, ball: int) -> Vector:
    """Return the position of a ball of the muscle with these directors, shape (N + 1, 3), from its clamp."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(tangent.shape[0]):
        weight = rod.balls[ball, k]
        x, y, z = x + weight * tangent[k, 0], y + weight * tangent[k, 1], z + weight * tangent[k, 2]
    return x, y, z


@kernel(forceinline=True)
def ball_jacobian(rod: Rod, motion: Motion, finger: int, ball: int, sign: float, arm: Vector, jacobian: Array) -> None:
    """Write sign d(position, turning)/dq of the material at ``arm`` from a ball's centre.

    It goes into columns 0 to D - 1 of ``jacobian`` (6, D or more).
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
