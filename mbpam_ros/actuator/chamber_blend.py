"""The compiled blends of four chamber pressures into a rod law; :mod:`~mbpam_ros.actuator.rod_law` explains.

It runs at every tick of the plant and nine times a finger in every estimate: compiled it takes a microsecond, where
array operations on so few numbers took a quarter of a millisecond.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEIGHBOUR_SHARE = 0.38
"""How far the pressure that decides what a neighbour adds to a chamber's moment lies from the chamber's to its own."""

_ROOT_HALF = math.sqrt(0.5)


class BlendTables(NamedTuple):
    """What the blend looks up over pressure.

    Args:
        step_pa: of the uniform grid, which starts at 0 gauge.
        rows: on the grid, shape (n, 5): the moment of a chamber alone [N m]; its gain by another's pressure [N m/Pa];
            mean and half difference of what it adds to the logarithm of the stiffness along and across it; that mean's
            gain by a neighbour's pressure [1/Pa].
        rest_stiffness_n_m2: stiffness without pressure.
    """

    step_pa: float
    rows: Array
    rest_stiffness_n_m2: float


class StrainTables(NamedTuple):
    """What the blend of stretch and twist looks up over pressure.

    Args:
        step_pa: of the uniform grid, which starts at 0 gauge.
        rows: on the grid, shape (n, 8): what a chamber alone does to the free stretch when straight, to its slope over
            the curvature [m], and to the logarithms of EA and GJ; then the gains of these four by a neighbour's
            pressure [1/Pa].
        rest_axial_n, rest_torsion_n_m2: EA and GJ without pressure.
    """

    step_pa: float
    rows: Array
    rest_axial_n: float
    rest_torsion_n_m2: float


@njit(cache=True)
def blend(pressure_gauge_pa: Array, tables: BlendTables) -> tuple[Array, Array]:
    """Return M0 (n, 2) [N m] and B (n,) [N m2] for pressures (n, 4); NaN in a row where a pressure is NaN.

    Pressures below 0 count as 0, those above the grid as its end. Sums are taken of two numbers, then of two sums: a
    turn or a mirror of the pressures changes no digit.
    """
    count, last = pressure_gauge_pa.shape[0], tables.rows.shape[0] - 2
    end_pa = (last + 1) * tables.step_pa
    moment, stiffness = np.full((count, 2), np.nan), np.full(count, np.nan)
    pressure, push, looked_up = np.empty(4), np.empty(4), np.empty((5, 4))
    # The columns of the tables, a number for each chamber.
    alone, gain, mean, half_difference, rise = looked_up[0], looked_up[1], looked_up[2], looked_up[3], looked_up[4]
    for row in range(count):
        if np.isnan(pressure_gauge_pa[row]).any():
            continue
        for chamber in range(4):
            pressure[chamber] = max(pressure_gauge_pa[row, chamber], 0.0)
            place = min(pressure[chamber], end_pa) / tables.step_pa
            index = min(int(place), last)
            for column in range(5):
                low, high = tables.rows[index, column], tables.rows[index + 1, column]
                looked_up[column, chamber] = low + (place - index) * (high - low)
        for chamber in range(4):
            own = pressure[chamber]
            before = min(own, pressure[(chamber + 3) % 4])
            across = min(own, pressure[(chamber + 2) % 4])
            after = min(own, pressure[(chamber + 1) % 4])
            push[chamber] = alone[chamber] + min(gain[chamber], 0.0) * max(max(before, after), across)
            if own > 0.0:
                none = _helped(own * (1.0 - NEIGHBOUR_SHARE), tables)
                help_before = _helped(own - NEIGHBOUR_SHARE * (own - before), tables) - (1.0 - before / own) * none
                help_after = _helped(own - NEIGHBOUR_SHARE * (own - after), tables) - (1.0 - after / own) * none
                push[chamber] += (help_before + help_after) + max(gain[chamber], 0.0) * across * (across / own)
            mean[chamber] += rise[chamber] * (before + after)
        # Along the diagonals at azimuth 45 and 135 deg.
        first, second = push[2] - push[0], push[3] - push[1]
        moment[row, 0] = _ROOT_HALF * (first - second)
        moment[row, 1] = _ROOT_HALF * (first + second)
        # What cancels is left to be isotropic; it is 0 in PSC and PDC.
        cancelled = min(alone[0], alone[2]) ** 2 + min(alone[1], alone[3]) ** 2
        size = first**2 + second**2 + cancelled
        double_cosine = (first**2 - second**2) / size if size > 0.0 else 0.0
        log_rise = (mean[0] + mean[2]) + (mean[1] + mean[3])
        anisotropy = (half_difference[0] + half_difference[2]) - (half_difference[1] + half_difference[3])
        stiffness[row] = tables.rest_stiffness_n_m2 * math.exp(log_rise + anisotropy * double_cosine)
    return moment, stiffness


@njit(cache=True)
def _helped(pressure_gauge_pa: float, tables: BlendTables) -> float:
    """Return what a neighbour of equal pressure adds to a chamber's moment [N m]; 0 where it takes from it."""
    last = tables.rows.shape[0] - 2
    place = min(pressure_gauge_pa / tables.step_pa, last + 1.0)
    index = min(int(place), last)
    low, high = tables.rows[index, 1], tables.rows[index + 1, 1]
    gain: float = low + (place - index) * (high - low)
    return max(gain, 0.0) * pressure_gauge_pa


@njit(cache=True)
def blend_strains(pressure_gauge_pa: Array, tables: StrainTables) -> tuple[Array, Array, Array, Array]:
    """Return free stretch (n,), its slopes over the curvature (n, 2) [m], EA [N] and GJ [N m2] (n,).

    For pressures (n, 4); NaN in a row where a pressure is NaN. Pressures outside the grid and the order of the sums: as
    in :func:`blend`.
    """
    count = pressure_gauge_pa.shape[0]
    stretch, slope = np.full(count, np.nan), np.full((count, 2), np.nan)
    axial, torsion = np.full(count, np.nan), np.full(count, np.nan)
    share = np.empty((4, 4))
    for row in range(count):
        if np.isnan(pressure_gauge_pa[row]).any():
            continue
        _share_out(pressure_gauge_pa[row], tables.step_pa, tables.rows, share)
        slope[row, 0], slope[row, 1] = _away(share[1])
        stretch[row] = (share[0, 0] + share[0, 2]) + (share[0, 1] + share[0, 3])
        axial[row] = tables.rest_axial_n * math.exp((share[2, 0] + share[2, 2]) + (share[2, 1] + share[2, 3]))
        torsion[row] = tables.rest_torsion_n_m2 * math.exp((share[3, 0] + share[3, 2]) + (share[3, 1] + share[3, 3]))
    return stretch, slope, axial, torsion


@njit(cache=True)
def blend_curve(pressure_gauge_pa: Array, step_pa: float, rows: Array) -> tuple[Array, Array]:
    """Return the stiffening Q along the bend's components (n, 2) [N m3] and the side stiffness S (n,) [N m2].

    Args:
        pressure_gauge_pa: shape (n, 4); NaN in a row where a pressure is NaN.
        step_pa: of the uniform grid, which starts at 0 gauge.
        rows: on the grid, shape (n, 4): Q and S of a chamber alone; then the gains of both by a neighbour's pressure.
    """
    count = pressure_gauge_pa.shape[0]
    stiffening, side, share = np.full((count, 2), np.nan), np.full(count, np.nan), np.empty((2, 4))
    pressure = np.empty(4)
    for row in range(count):
        if np.isnan(pressure_gauge_pa[row]).any():
            continue
        _share_out(pressure_gauge_pa[row], step_pa, rows, share)
        stiffening[row, 0], stiffening[row, 1] = _away(share[0])
        for chamber in range(4):
            pressure[chamber] = max(pressure_gauge_pa[row, chamber], 0.0)
        # What cancels has no side; it is 0 in PSC and PDC.
        first, second = pressure[2] - pressure[0], pressure[3] - pressure[1]
        cancelled = min(pressure[0], pressure[2]) ** 2 + min(pressure[1], pressure[3]) ** 2
        size = first**2 + second**2
        sided = size / (size + cancelled) if size > 0.0 else 0.0
        side[row] = sided * ((share[1, 0] + share[1, 2]) + (share[1, 1] + share[1, 3]))
    return stiffening, side


@njit(cache=True)
def blend_joint(pressure_gauge_pa: Array, step_pa: float, rows: Array) -> Array:
    """Return turn in bend components [rad], length, shift [m] and compliance of an end's joint, and 1 / GA, shape (7,).

    Args:
        pressure_gauge_pa: shape (4,); NaN where a pressure is NaN.
        step_pa: of the uniform grid, which starts at 0 gauge.
        rows: on the grid, shape (n, 10): turn, length, shift of a chamber alone, and what it adds to the compliances;
            then their gains by a neighbour's pressure.
    """
    joint, share = np.full(7, np.nan), np.empty((5, 4))
    if not np.isnan(pressure_gauge_pa).any():
        _share_out(pressure_gauge_pa, step_pa, rows, share)
        joint[0], joint[1] = _away(share[0])
        joint[2] = (share[1, 0] + share[1, 2]) + (share[1, 1] + share[1, 3])
        joint[3], joint[4] = _away(share[2])
        joint[5] = (share[3, 0] + share[3, 2]) + (share[3, 1] + share[3, 3])
        joint[6] = (share[4, 0] + share[4, 2]) + (share[4, 1] + share[4, 3])
    return joint


@njit(cache=True)
def _share_out(pressure_gauge_pa: Array, step_pa: float, rows: Array, share: Array) -> None:
    """Look up what each chamber has to do with each quantity, (quantities, 4): alone, and by its two neighbours."""
    last, quantities = rows.shape[0] - 2, share.shape[0]
    for chamber in range(4):
        own = max(pressure_gauge_pa[chamber], 0.0)
        before = min(own, max(pressure_gauge_pa[(chamber + 3) % 4], 0.0))
        after = min(own, max(pressure_gauge_pa[(chamber + 1) % 4], 0.0))
        place = min(own, (last + 1) * step_pa) / step_pa
        index = min(int(place), last)
        low, high = rows[index], rows[index + 1]
        for column in range(quantities):
            alone = low[column] + (place - index) * (high[column] - low[column])
            gained = quantities + column
            gain = low[gained] + (place - index) * (high[gained] - low[gained])
            share[column, chamber] = alone + gain * (before + after)


@njit(cache=True)
def _away(share: Array) -> tuple[float, float]:
    """Sum of the chambers' shares (4,), each away from its chamber."""
    # Along the diagonals at azimuth 45 and 135 deg.
    first, second = share[2] - share[0], share[3] - share[1]
    return _ROOT_HALF * (first - second), _ROOT_HALF * (first + second)
