"""The force an upright muscle exerts on a plate that blocks its tip, with Coulomb friction and large deflection.

The posture of the paper's force test (section 2.3): base clamped, weight on, a plate parallel to the axis that touches
the tip's rim, friction coefficient 0.6. The boundary-value problem of :mod:`~mbpam_ros.actuator.planar_rod` in the
unknowns theta_tip and N is closed by theta = 0 at the clamp and x = 0 at the rim, and, for the friction T, by one of

    slides up:     T = -mu N  and the rim is not below where it was,
    slides down:   T = +mu N  and the rim is not above where it was,
    sticks:        |T| <= mu N, the rim is where it was.

Which one depends on the past, so the pressure is raised in steps from zero. Under pressure the axis stretches: the tip
slides up at first, against friction that presses the rod together and pushes the rim over; when the bulge between
clamp and plate takes the length up again, it sticks. At each step, the rim's height rises with T, so the three cases
exclude each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.actuator.planar_rod import (
    INEXTENSIBLE,
    AxisStretch,
    RodSolutionError,
    Shot,
    blocked_tip_force_per_moment,
    shoot,
)

FRICTION_COEFFICIENT = 0.6
"""Between plate and muscle; paper, section 2.3."""

_SLIDING = 1e-9
"""Friction this close to its limit, relative to it, is that of sliding."""

_LARGEST_RESIDUAL = 1e-8
"""Of the closing conditions [rad, muscle lengths]: 1e-9 m."""


class RodLoad(NamedTuple):
    """The rod at one pressure: M0 [N m] > 0, B [N m2], stretch of the axis."""

    moment_n_m: float
    stiffness_n_m2: float
    stretch: AxisStretch = INEXTENSIBLE


class PlateContact(NamedTuple):
    """The blocked tip in equilibrium.

    Args:
        push_n: N, what the plate and the tip push each other with; the paper's output force.
        friction_n: T on the tip, positive away from the clamp.
        tip_angle_rad: theta_tip.
        rim_z_m: height of the touching rim over the clamp.
    """

    push_n: float
    friction_n: float
    tip_angle_rad: float
    rim_z_m: float


def blocked_path(
    loads: Sequence[RodLoad],
    geometry: MuscleGeometry,
    friction_coefficient: float = FRICTION_COEFFICIENT,
    gravity_m_s2: float = GRAVITY_M_S2,
) -> list[PlateContact]:
    """Return the contact at each load, the loads following each other from the unpressurised, straight muscle.

    Raises:
        RodSolutionError: no equilibrium with a pushing plate was found; the message says at which load.
    """
    tip = BlockedTip(geometry, friction_coefficient, gravity_m_s2)
    return [tip.follow(load) for load in loads]


class BlockedTip:
    """A tip on its plate, whose friction remembers the loads that came before; the arguments of :func:`blocked_path`.

    It begins at the unpressurised, straight muscle.
    """

    def __init__(
        self,
        geometry: MuscleGeometry,
        friction_coefficient: float = FRICTION_COEFFICIENT,
        gravity_m_s2: float = GRAVITY_M_S2,
    ) -> None:
        self._geometry, self._friction = geometry, friction_coefficient
        self._weight = geometry.mass_per_length_kg_m * gravity_m_s2
        self._last: PlateContact | None = None
        self._before = 0.0

    def follow(self, load: RodLoad) -> PlateContact:
        """Return the contact at the next load.

        Raises:
            RodSolutionError: no equilibrium with a pushing plate was found; the contact stays that before.
        """
        last, before = self._last, self._before
        if last is None:
            last, before = _small_deflection(load, self._geometry, self._friction, self._weight), load.moment_n_m
        plate = _Plate(load, self._geometry, self._friction, self._weight)
        self._last, self._before = plate.contact(last, load.moment_n_m / before), load.moment_n_m
        return self._last


def _small_deflection(load: RodLoad, geometry: MuscleGeometry, friction: float, weight_n_m: float) -> PlateContact:
    """Where the first load is looked for: the straight propped rod, sliding up, its rim where its weight has put it."""
    push = load.moment_n_m * blocked_tip_force_per_moment(geometry)
    weightless = load.moment_n_m * geometry.active_length_m / load.stiffness_n_m2
    carried = weight_n_m * (0.5 * geometry.active_length_m + geometry.end_length_m)
    shorter = load.stretch.compliance_per_n * carried * geometry.active_length_m
    return PlateContact(push, -friction * push, 0.15 * weightless, geometry.length_m - shorter)


class _Plate:
    """Closing conditions at one load, and their solution in each of the three cases."""

    def __init__(self, load: RodLoad, geometry: MuscleGeometry, friction: float, weight_n_m: float) -> None:
        self._load, self._geometry, self._friction, self._weight = load, geometry, friction, weight_n_m

    def contact(self, last: PlateContact, growth: float) -> PlateContact:
        """Return the contact after ``last``; ``growth`` is that of M0 since then, from which it is looked for.

        What it did last is tried first. A case may have no solution at all; then it is not the one.

        Raises:
            RodSolutionError: none of the three cases has a solution.
        """
        angle, push, friction = growth * last.tip_angle_rad, growth * last.push_n, growth * last.friction_n
        direction = math.copysign(1.0, last.friction_n)
        stuck = (self._sticking, ([angle, push, friction], last.rim_z_m))
        same, other = ((self._sliding, ([angle, push], sign * self._friction)) for sign in (direction, -direction))
        is_stuck = abs(last.friction_n) < self._friction * last.push_n * (1.0 - _SLIDING)
        failure = RodSolutionError(
            f"the blocked rod neither slides nor sticks with M0 = {self._load.moment_n_m:.4g} N m"
        )
        for solve, arguments in (stuck, same, other) if is_stuck else (same, stuck, other):
            try:
                found = solve(*arguments)
            except RodSolutionError as error:
                failure = error
            else:
                if self._is_admissible(found, last.rim_z_m):
                    return found
        raise failure

    def _is_admissible(self, contact: PlateContact, last_rim_z_m: float) -> bool:
        """Friction within its cone, and against the motion, if any."""
        within = abs(contact.friction_n) <= self._friction * contact.push_n * (1.0 + _SLIDING)
        return within and contact.friction_n * (contact.rim_z_m - last_rim_z_m) <= 0.0

    def _sliding(self, guess: list[float], upright_per_push: float) -> PlateContact:
        def residual(unknowns: NDArray[np.float64]) -> list[float]:
            angle, push = unknowns.tolist()
            shot = self._shot(angle, push, upright_per_push * push)
            return [shot.clamp_angle_rad, shot.rim_x_m / self._geometry.length_m]

        angle, push = self._solved(residual, guess)
        friction = upright_per_push * push
        return PlateContact(push, friction, angle, self._shot(angle, push, friction).rim_z_m)

    def _sticking(self, guess: list[float], rim_z_m: float) -> PlateContact:
        def residual(unknowns: NDArray[np.float64]) -> list[float]:
            shot = self._shot(*unknowns.tolist())
            length = self._geometry.length_m
            return [shot.clamp_angle_rad, shot.rim_x_m / length, (shot.rim_z_m - rim_z_m) / length]

        angle, push, friction = self._solved(residual, guess)
        return PlateContact(push, friction, angle, rim_z_m)

    def _shot(self, angle: float, push: float, friction: float) -> Shot:
        load = self._load
        compliance = 1.0 / load.stiffness_n_m2
        return shoot(angle, load.moment_n_m, compliance, self._geometry, self._weight, load.stretch, push, friction)

    def _solved(self, residual: Callable[[NDArray[np.float64]], list[float]], guess: list[float]) -> list[float]:
        found = root(residual, guess, tol=1e-11)
        if np.abs(found.fun).max() > _LARGEST_RESIDUAL or found.x[1] <= 0.0:
            raise RodSolutionError(
                f"no equilibrium of the blocked rod with M0 = {1e3 * self._load.moment_n_m:.4g} N mm, "
                f"B = {1e6 * self._load.stiffness_n_m2:.4g} N mm2: {' '.join(found.message.split())}"
            )
        unknowns: list[float] = found.x.tolist()
        return unknowns
