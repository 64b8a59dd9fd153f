r"""The hanging rod at rest as a boundary-value problem: an independent check of the reference.

With the angle theta(s) from the vertical, the active length L, the end d, the weight per length w and the law
M = B kappa - M0, a rod that hangs from its clamp obeys

    B theta'' = w (L + d - s) sin theta,   theta(0) = 0,   B theta'(L) = M0 - w d^2 / 2 sin theta(L),

solved by SciPy's collocation (``solve_bvp``), which shares nothing with the modes, the Magnus expansion or the time
steps of the plant.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_bvp

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, FINGER_COUNT
from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.errors import MbpamError
from mbpam_ros.gripper import Gripper
from mbpam_ros.study.fidelity.cases import Case
from mbpam_ros.study.fidelity.runs import TICK_S, Record

Array = NDArray[np.float64]

_TOLERANCE = 1e-9


class BoundaryValueError(MbpamError, RuntimeError):
    """The boundary-value problem was not solved."""


def hanging_tip_m(moment_n_m: Array, stiffness_n_m2: float, geometry: MuscleGeometry) -> Array:
    """Return the tip (3,) of a hanging muscle from its clamp, for M0 (2,) and B.

    Raises:
        BoundaryValueError: no solution.
    """
    length, end = geometry.active_length_m, geometry.end_length_m
    weight, size = GRAVITY_M_S2 * geometry.mass_per_length_kg_m, float(np.linalg.norm(moment_n_m))

    def slope(s: Array, y: Array) -> Array:
        bending = weight * (length + end - s) * np.sin(y[0]) / stiffness_n_m2
        return np.array([y[1], bending, np.sin(y[0]), np.cos(y[0])])

    def ends(clamp: Array, tip: Array) -> Array:
        curvature = (size - 0.5 * weight * end**2 * np.sin(tip[0])) / stiffness_n_m2
        return np.array([clamp[0], tip[1] - curvature, clamp[2], clamp[3] - end])

    s, kappa = np.linspace(0.0, length, 41), size / stiffness_n_m2
    start = np.array([kappa * s, np.full_like(s, kappa), np.zeros_like(s), end + s])
    solution = solve_bvp(slope, ends, s, start, tol=_TOLERANCE, max_nodes=20000)
    if not solution.success:
        raise BoundaryValueError(f"the hanging rod with M0 = {size:g} N m was not solved: {solution.message}")
    angle, _, across, down = solution.y[:, -1]
    toward = moment_n_m / size if size > 0.0 else np.array([1.0, 0.0])
    return np.array([*((across + end * np.sin(angle)) * toward), down + end * np.cos(angle)])


def boundary_value_error_pct(case: Case, found: Record, gripper: Gripper) -> float:
    """Return the largest distance of a tip from the boundary-value problem's at the first rest, over the active length.

    Args:
        case: one without an object.
        found: a run of it.
    """
    law = gripper.rod_law()
    rest = round(case.rest_s[0] / TICK_S)
    pressure = found.pressure_gauge_pa[rest].reshape(FINGER_COUNT, CHAMBERS_PER_FINGER)
    exact = [
        hanging_tip_m(moment, stiffness, gripper.rod_geometry)
        for moment, stiffness in zip(*law.moment_and_stiffness(pressure), strict=True)
    ]
    off = found.tip_m[rest] - gripper.finger_base_m - exact
    return 100.0 * float(np.linalg.norm(off, axis=1).max()) / gripper.geometry.active_length_m
