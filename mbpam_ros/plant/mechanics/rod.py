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

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.plant.mechanics.kernel import kernel, piece
from mbpam_ros.plant.mechanics.lanes import (
    WIDTH,
    Lanes,
    LaneVector,
    any_above,
    lane,
    load,
    splat,
    store,
    with_lane,
)
from mbpam_ros.plant.mechanics.vectors import Array, Number, Vector, combined, cross, dot, plus, times

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
    """Muscles in motion, one a lane; the row of director 0, the clamp's, stays as it is.

    Args:
        tangent: directors d_k: t at the Lobatto points, or, with stretch, z, s t at these points, and t of the tip;
            shape (N + 1, 3, 4). The last one is a unit vector, the tip's.
        turning: derivative of the turning of the directors' sections by the coordinates, shape (N + 1, 3, D, 4).
        slope: derivative of the directors, shape (N + 1, 3, D, 4).
        acceleration: d2/dt2 of the directors while the coordinates' rates are constant, shape (N + 1, 3, 4).
        spin: derivative of the spin about the tangent of points 1 to S, W_i.t, shape (S, D, 4); without twist none.
        spin_load: d(t.w)/dt while the coordinates' rates are constant, and (t.w) t.(w x W_i), shape (S, 1 + D, 4).
    """

    tangent: Array
    turning: Array
    slope: Array
    acceleration: Array
    spin: Array
    spin_load: Array

    def of(self, finger: int) -> Motion:
        """Return that of one muscle, as views without the last axis."""
        return Motion(*(part[..., finger] for part in self))


@functools.lru_cache(maxsize=32)
def build_rod(
    geometry: MuscleGeometry, modes: int, segments: int, balls: int, twist_modes: int = 0, stretch_modes: int = 0
) -> Rod:
    """Return the rod with ``modes`` modes of curvature a plane, those of twist and stretch, and ``segments`` segments.

    At 170 deg, four segments place the tip to 0.05 % and have the mass matrix to 3e-4; each one more is ten times as
    good. ``balls`` of the muscle's radius stand evenly along it, the last one a radius before its end. About their axis
    sections turn like a solid cylinder's. Cached: equal arguments give the same object.
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


def motion_at_rest(rod: Rod) -> Motion:
    """Return the motion of straight muscles; what is not the clamp's is to be overwritten by :func:`move_rods`."""
    directors, columns, spins = len(rod.levers) + 1, coordinates_of(rod), len(rod.spins)
    tangent = np.zeros((directors, 3, WIDTH))
    tangent[:, 2] = 1.0
    return Motion(
        tangent,
        np.zeros((directors, 3, columns, WIDTH)),
        np.zeros((directors, 3, columns, WIDTH)),
        np.zeros_like(tangent),
        np.zeros((spins, columns, WIDTH)),
        np.zeros((spins, 1 + columns, WIDTH)),
    )


def room_for_loads(rod: Rod) -> Array:
    """Return the scratch of :func:`masses_and_loads`."""
    return np.zeros((1 + coordinates_of(rod), 3 * len(rod.levers) + len(rod.spins), WIDTH))


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


@functools.lru_cache(maxsize=16)
def _lagrange_coefficients(segments: int) -> Array:
    """Legendre coefficients of the polynomials that are 1 at one Lobatto point and 0 at the others, in columns."""
    inverse = np.linalg.inv(legendre.legvander(_lobatto_points(segments), segments))
    return inverse.astype(np.float64, copy=False)


@piece
def stumpff(u: float) -> tuple[float, float, float, float, float]:
    """Return c_1 .. c_5 at u = x^2 >= 0: c_1 = sin x / x, c_2 = (1 - cos x) / u, c_{k+2} = (1 / k! - c_k) / u."""
    if u > 1.0:
        angle = math.sqrt(u)
        c1, c2 = math.sin(angle) / angle, (1.0 - math.cos(angle)) / u
        c3 = (1.0 - c1) / u
        return c1, c2, c3, (0.5 - c2) / u, (1.0 / 6.0 - c3) / u
    return _stumpff_series(u)


@piece
def _stumpff_series(u: Number) -> tuple[Number, Number, Number, Number, Number]:
    """Return the series of c_1 .. c_5, to the last digit up to u = 1."""
    c4, c5 = 1.0 - u * (1.0 / 240.0), 1.0 - u * (1.0 / 272.0)
    c4, c5 = 1.0 - u * (1.0 / 182.0) * c4, 1.0 - u * (1.0 / 210.0) * c5
    c4, c5 = 1.0 - u * (1.0 / 132.0) * c4, 1.0 - u * (1.0 / 156.0) * c5
    c4, c5 = 1.0 - u * (1.0 / 90.0) * c4, 1.0 - u * (1.0 / 110.0) * c5
    c4, c5 = 1.0 - u * (1.0 / 56.0) * c4, 1.0 - u * (1.0 / 72.0) * c5
    c4, c5 = (1.0 / 24.0) * (1.0 - u * (1.0 / 30.0) * c4), (1.0 / 120.0) * (1.0 - u * (1.0 / 42.0) * c5)
    c3 = 1.0 / 6.0 - u * c5
    return 1.0 - u * c3, 0.5 - u * c4, c3, c4, c5


@piece
def stumpff_of_lanes(u: Lanes) -> tuple[Lanes, Lanes, Lanes, Lanes, Lanes]:
    """Return what :func:`stumpff` does of each lane."""
    c1, c2, c3, c4, c5 = _stumpff_series(u)
    if any_above(u, 1.0):
        for f in range(WIDTH):
            if lane(u, f) > 1.0:
                far = stumpff(lane(u, f))
                c1, c2, c3 = with_lane(c1, f, far[0]), with_lane(c2, f, far[1]), with_lane(c3, f, far[2])
                c4, c5 = with_lane(c4, f, far[3]), with_lane(c5, f, far[4])
    return c1, c2, c3, c4, c5


@piece
def _load_vector(values: Array, row: int) -> LaneVector:
    return load(values, (row, 0)), load(values, (row, 1)), load(values, (row, 2))


@piece
def _store_vector(values: Array, row: int, vector: LaneVector) -> None:
    store(values, (row, 0), vector[0])
    store(values, (row, 1), vector[1])
    store(values, (row, 2), vector[2])


@piece
def _load_column(values: Array, row: int, n: int) -> LaneVector:
    return load(values, (row, 0, n)), load(values, (row, 1, n)), load(values, (row, 2, n))


@piece
def _store_column(values: Array, row: int, n: int, column: LaneVector) -> None:
    store(values, (row, 0, n), column[0])
    store(values, (row, 1, n), column[1])
    store(values, (row, 2, n), column[2])


@piece
def _write_spin(
    motion: Motion, k: int, row: int, columns: int, t: LaneVector, turn: LaneVector, gain: LaneVector
) -> None:
    """Write spin and its load of point k + 1; the first ``columns`` coordinates turn it."""
    rate, across = dot(t, turn), cross(t, turn)
    store(motion.spin_load, (k, 0), dot(t, gain))
    for n in range(columns):
        w = _load_column(motion.turning, row, n)
        store(motion.spin, (k, n), dot(t, w))
        store(motion.spin_load, (k, 1 + n), rate * dot(across, w))  # t.(w x W) = (t x w).W


@piece
def _stretch_director(
    q: Array, rate: Array, rod: Rod, motion: Motion, k: int, row: int, t: LaneVector, swing: LaneVector
) -> None:
    """Make s t of the tangent t at point k + 1; after the last point stands t itself, the tip's."""
    stretches, tangent, acceleration, slope = rod.stretches, motion.tangent, motion.acceleration, motion.slope
    columns = slope.shape[2]
    first = columns - stretches.shape[1]
    change = _load_vector(acceleration, row)
    if k == rod.bends.shape[0] - 1:
        _store_vector(tangent, row + 1, t)
        _store_vector(acceleration, row + 1, change)
        for n in range(first):
            _store_column(slope, row + 1, n, _load_column(slope, row, n))
            _store_column(motion.turning, row + 1, n, _load_column(motion.turning, row, n))
    long, growth = splat(1.0), splat(0.0)
    for i in range(stretches.shape[1]):
        long = long + stretches[k + 1, i] * load(q, (first + i,))
        growth = growth + stretches[k + 1, i] * load(rate, (first + i,))
    twice = 2.0 * growth
    _store_vector(tangent, row, (long * t[0], long * t[1], long * t[2]))
    change = (
        long * change[0] + twice * swing[0],
        long * change[1] + twice * swing[1],
        long * change[2] + twice * swing[2],
    )
    _store_vector(acceleration, row, change)
    for n in range(first):
        x, y, z = _load_column(slope, row, n)
        _store_column(slope, row, n, (long * x, long * y, long * z))
    for n in range(first, columns):
        share = stretches[k + 1, n - first]
        _store_column(slope, row, n, (share * t[0], share * t[1], share * t[2]))


@kernel(forceinline=True)
def move_rods(q: Array, rate: Array, rod: Rod, motion: Motion) -> None:
    """Write the motion of all muscles with coordinates q and their rates, shapes (D, 4).

    A segment turns at T do/dt seen from its start, T = 1 + c_2 [o] + c_3 [o]^2, and while dq/dt is constant this grows
    at dT/dt do/dt + T d2o/dt2; only the Magnus term has a second derivative then.
    """
    bends, twists, stretches = rod.bends, rod.twists, rod.stretches
    modes, twist_modes, stretch_modes = bends.shape[2], twists.shape[2], stretches.shape[1]
    first_twist, first_stretch = 2 * modes, 2 * modes + twist_modes
    turning, slope = motion.turning, motion.slope
    none, one = splat(0.0), splat(1.0)
    rx, ry, rz = (one, none, none), (none, one, none), (none, none, one)  # rows of R
    turn, gain = (none, none, none), (none, none, none)  # turning rate of the section, and its rate
    before = 0  # row of the section before
    if stretch_modes > 0:
        before = 1
        long = one
        for i in range(stretch_modes):
            long = long + stretches[0, i] * load(q, (first_stretch + i,))
            store(slope, (1, 2, first_stretch + i), splat(stretches[0, i]))
        store(motion.tangent, (1, 2), long)
    for k in range(bends.shape[0]):
        # bend and twist at the two Gauss points, and their rates
        b1x, b1y, b2x, b2y, d1x, d1y, d2x, d2y = none, none, none, none, none, none, none, none
        for i in range(modes):
            at1, at2 = bends[k, 0, i], bends[k, 1, i]
            x, y, dx, dy = load(q, (2 * i,)), load(q, (2 * i + 1,)), load(rate, (2 * i,)), load(rate, (2 * i + 1,))
            b1x, b1y, b2x, b2y = b1x + at1 * x, b1y + at1 * y, b2x + at2 * x, b2y + at2 * y
            d1x, d1y, d2x, d2y = d1x + at1 * dx, d1y + at1 * dy, d2x + at2 * dx, d2y + at2 * dy
        o = (-0.5 * (b1y + b2y), 0.5 * (b1x + b2x), _MAGNUS * (b1x * b2y - b1y * b2x))
        do = (-0.5 * (d1y + d2y), 0.5 * (d1x + d2x), _MAGNUS * (d1x * b2y + b1x * d2y - d1y * b2x - b1y * d2x))
        ddo = 2.0 * _MAGNUS * (d1x * d2y - d1y * d2x)  # along z; only twist adds to it across
        t1, t2, e1, e2 = none, none, none, none
        if twist_modes > 0:
            for i in range(twist_modes):
                at1, at2 = twists[k, 0, i], twists[k, 1, i]
                c, dc = load(q, (first_twist + i,)), load(rate, (first_twist + i,))
                t1, t2, e1, e2 = t1 + at1 * c, t2 + at2 * c, e1 + at1 * dc, e2 + at2 * dc
            o = plus(o, (_MAGNUS * (b1x * t2 - t1 * b2x), _MAGNUS * (b1y * t2 - t1 * b2y), 0.5 * (t1 + t2)))
            do = plus(
                do,
                (
                    _MAGNUS * (d1x * t2 + b1x * e2 - e1 * b2x - t1 * d2x),
                    _MAGNUS * (d1y * t2 + b1y * e2 - e1 * b2y - t1 * d2y),
                    0.5 * (e1 + e2),
                ),
            )
        u, du = dot(o, o), 2.0 * dot(o, do)
        c1, c2, c3, c4, c5 = stumpff_of_lanes(u)
        # rows of R [o] and R [o]^2, then of R T
        ax, ay, az = cross(rx, o), cross(ry, o), cross(rz, o)
        bx, by, bz = cross(ax, o), cross(ay, o), cross(az, o)
        tx = combined(one, rx, c2, ax, c3, bx)
        ty = combined(one, ry, c2, ay, c3, by)
        tz = combined(one, rz, c2, az, c3, bz)
        # r = dT/dt do/dt, with dc_k/du = (k c_{k+2} - c_{k+1}) / 2
        e = cross(o, do)
        r = combined(c3, cross(do, e), 0.5 * (2.0 * c4 - c3) * du, e, 0.5 * (3.0 * c5 - c4) * du, cross(o, e))
        own = (dot(tx, do), dot(ty, do), dot(tz, do))
        more = (tx[2] * ddo, ty[2] * ddo, tz[2] * ddo)
        if twist_modes > 0:
            across = (2.0 * _MAGNUS * (d1x * e2 - e1 * d2x), 2.0 * _MAGNUS * (d1y * e2 - e1 * d2y), ddo)
            more = (dot(tx, across), dot(ty, across), dot(tz, across))
        own_gain = plus((dot(rx, r), dot(ry, r), dot(rz, r)), more)
        gain = plus(plus(gain, own_gain), cross(turn, own))
        turn = plus(turn, own)
        rx = combined(one, rx, c1, ax, c2, bx)
        ry = combined(one, ry, c1, ay, c2, by)
        rz = combined(one, rz, c1, az, c2, bz)
        t = (rx[2], ry[2], rz[2])
        here = before + 1
        swing = cross(turn, t)
        _store_vector(motion.tangent, here, t)
        _store_vector(motion.acceleration, here, plus(cross(gain, t), cross(turn, swing)))
        for i in range(modes):
            at1, at2 = bends[k, 0, i], bends[k, 1, i]
            mean, at1, at2 = 0.5 * (at1 + at2), _MAGNUS * at1, _MAGNUS * at2
            # do/dq by q_x and q_y: along z; across it is z x mean
            x_along, y_along = at1 * b2y - at2 * b1y, at2 * b1x - at1 * b2x
            by_x, by_y = _load_column(turning, before, 2 * i), _load_column(turning, before, 2 * i + 1)
            by_x = (
                by_x[0] + tx[1] * mean + tx[2] * x_along,
                by_x[1] + ty[1] * mean + ty[2] * x_along,
                by_x[2] + tz[1] * mean + tz[2] * x_along,
            )
            by_y = (
                by_y[0] + tx[0] * -mean + tx[2] * y_along,
                by_y[1] + ty[0] * -mean + ty[2] * y_along,
                by_y[2] + tz[0] * -mean + tz[2] * y_along,
            )
            if twist_modes > 0:
                aside = at1 * t2 - at2 * t1
                by_x = (by_x[0] + tx[0] * aside, by_x[1] + ty[0] * aside, by_x[2] + tz[0] * aside)
                by_y = (by_y[0] + tx[1] * aside, by_y[1] + ty[1] * aside, by_y[2] + tz[1] * aside)
            _store_column(turning, here, 2 * i, by_x)
            _store_column(turning, here, 2 * i + 1, by_y)
            _store_column(slope, here, 2 * i, cross(by_x, t))
            _store_column(slope, here, 2 * i + 1, cross(by_y, t))
        for i in range(twist_modes):
            n, at1, at2 = first_twist + i, twists[k, 0, i], twists[k, 1, i]
            mean, at1, at2 = 0.5 * (at1 + at2), _MAGNUS * at1, _MAGNUS * at2
            v = (at2 * b1x - at1 * b2x, at2 * b1y - at1 * b2y, splat(mean))
            w = plus(_load_column(turning, before, n), (dot(tx, v), dot(ty, v), dot(tz, v)))
            _store_column(turning, here, n, w)
            _store_column(slope, here, n, cross(w, t))
        if twist_modes > 0:
            _write_spin(motion, k, here, first_stretch, t, turn, gain)
        if stretch_modes > 0:
            _stretch_director(q, rate, rod, motion, k, here, t, swing)
        before = here


@kernel
def masses_and_loads(rod: Rod, motion: Motion, gravity: Vector, work: Array, mass: Array, load_of: Array) -> None:
    """Write mass matrices (D, D, 4) and loads (D, 4) of gravity less velocity terms of all muscles, SI.

    ``gravity`` [m/s2] is that in the (accelerated) clamp frame. With J_k = dd_k/dq, a_k the acceleration of d_k while
    dq/dt is constant and the factor C of G: mass = Z^T Z, load = sum_k W_k g^T J_k - Z^T C a, Z = C J; a spin is a row
    of Z with sqrt(J) for C. Columns are taken in pairs, whose sums do not wait for each other; of an odd number of
    columns the last one is its own neighbour.

    Args:
        work: scratch, of :func:`room_for_loads`.
    """
    directors, inertia, levers, spins = rod.inertia.shape[0], rod.inertia, rod.levers, rod.spins
    slope, acceleration, columns, none = motion.slope, motion.acceleration, load_of.shape[0], splat(0.0)
    rows = 3 * directors + spins.shape[0]
    for k in range(directors):
        ax, ay, az = none, none, none
        for n in range(k, directors):
            share, (x, y, z) = inertia[k, n], _load_vector(acceleration, n + 1)
            ax, ay, az = ax + share * x, ay + share * y, az + share * z
        store(work, (columns, 3 * k), ax)
        store(work, (columns, 3 * k + 1), ay)
        store(work, (columns, 3 * k + 2), az)
    for i in range(columns):
        total = none
        for k in range(directors):
            zx, zy, zz = none, none, none
            for n in range(k, directors):
                share, (x, y, z) = inertia[k, n], _load_column(slope, n + 1, i)
                zx, zy, zz = zx + share * x, zy + share * y, zz + share * z
            store(work, (i, 3 * k), zx)
            store(work, (i, 3 * k + 1), zy)
            store(work, (i, 3 * k + 2), zz)
            ax, ay, az = (
                load(work, (columns, 3 * k)),
                load(work, (columns, 3 * k + 1)),
                load(work, (columns, 3 * k + 2)),
            )
            wx, wy, wz = times(levers[k], gravity)
            x, y, z = _load_column(slope, k + 1, i)
            # along z first: where gravity is along it, no digit changes
            total = total + (wz * z + (wx * x + wy * y) - zx * ax - zy * ay - zz * az)
        for k in range(spins.shape[0]):
            spin = load(motion.spin, (k, i))
            store(work, (i, 3 * directors + k), math.sqrt(spins[k]) * spin)
            total = total - spins[k] * (spin * load(motion.spin_load, (k, 0)) - load(motion.spin_load, (k, 1 + i)))
        store(load_of, (i,), total)
    for i in range(0, columns, 2):
        next_i = min(i + 1, columns - 1)
        for j in range(0, i + 1, 2):
            next_j = min(j + 1, columns - 1)
            xx, xy, yx, yy = none, none, none, none
            for r in range(rows):
                ix, iy, jx, jy = (
                    load(work, (i, r)),
                    load(work, (next_i, r)),
                    load(work, (j, r)),
                    load(work, (next_j, r)),
                )
                xx, xy, yx, yy = xx + ix * jx, xy + ix * jy, yx + iy * jx, yy + iy * jy
            store(mass, (i, j), xx)
            store(mass, (i, next_j), xy)
            store(mass, (next_i, j), yx)
            store(mass, (next_i, next_j), yy)
            store(mass, (j, i), xx)
            store(mass, (next_j, i), xy)
            store(mass, (j, next_i), yx)
            store(mass, (next_j, next_i), yy)


@kernel(forceinline=True)
def ball_positions(rod: Rod, motion: Motion, ball: int) -> LaneVector:
    """Return the positions of a ball of each muscle, from its clamp."""
    tangent, x, y, z = motion.tangent, splat(0.0), splat(0.0), splat(0.0)
    for k in range(tangent.shape[0]):
        weight = rod.balls[ball, k]
        x = x + weight * load(tangent, (k, 0))
        y = y + weight * load(tangent, (k, 1))
        z = z + weight * load(tangent, (k, 2))
    return x, y, z


@kernel(forceinline=True)
def ball_position(rod: Rod, motion: Motion, finger: int, ball: int) -> Vector:
    """Return the position of a ball of a muscle, from its clamp."""
    tangent, x, y, z = motion.tangent, 0.0, 0.0, 0.0
    for k in range(tangent.shape[0]):
        weight = rod.balls[ball, k]
        x, y, z = (
            x + weight * tangent[k, 0, finger],
            y + weight * tangent[k, 1, finger],
            z + weight * tangent[k, 2, finger],
        )
    return x, y, z


@kernel(forceinline=True)
def ball_jacobian(rod: Rod, motion: Motion, finger: int, ball: int, sign: float, arm: Vector, jacobian: Array) -> None:
    """Write sign d(position, turning)/dq of the material at ``arm`` from a ball's centre.

    It goes into columns 0 to D - 1 of ``jacobian`` (6, D or more).
    """
    slope, turning, f = motion.slope, motion.turning, finger
    for j in range(slope.shape[2]):
        px, py, pz, wx, wy, wz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(1, slope.shape[0]):
            far, near = rod.balls[ball, k], rod.turns[ball, k]
            px, py, pz = px + far * slope[k, 0, j, f], py + far * slope[k, 1, j, f], pz + far * slope[k, 2, j, f]
            wx, wy, wz = (
                wx + near * turning[k, 0, j, f],
                wy + near * turning[k, 1, j, f],
                wz + near * turning[k, 2, j, f],
            )
        jacobian[0, j] = sign * (px + wy * arm[2] - wz * arm[1])
        jacobian[1, j] = sign * (py + wz * arm[0] - wx * arm[2])
        jacobian[2, j] = sign * (pz + wx * arm[1] - wy * arm[0])
        jacobian[3, j], jacobian[4, j], jacobian[5, j] = sign * wx, sign * wy, sign * wz
