"""What acts on a whole muscle: chamber pressures, a force and a moment at its tip, gravity in any direction.

Muscle frame: origin at the clamp, z from the clamp to the tip of the straight muscle, the cross's arms along x and y;
chambers 1 to 4 at azimuth 45, 135, 225 and 315 deg.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.errors import MbpamError
from mbpam_ros.study.muscle_states import PATTERN_SHARES

Vector = tuple[float, float, float]

NOTHING: Vector = (0.0, 0.0, 0.0)
UPRIGHT: Vector = (0.0, 0.0, -GRAVITY_M_S2)
LEVEL: Vector = (GRAVITY_M_S2, 0.0, 0.0)

_ROUNDING = 1e-12


class MuscleLoadError(MbpamError, ValueError):
    """Loads that are not finite, or that this model of the muscle cannot take."""


@dataclass(frozen=True)
class MuscleLoads:
    """Loads on a muscle.

    Args:
        pressures_gauge_mpa: of chambers 1 to 4.
        tip_force_n: dead force on the muscle at the centre of the tip's face.
        tip_torque_n_mm: moment about the tip's direction, right-handed; it follows the tip.
        gravity_m_s2: acceleration of gravity; (0, 0, 9.81) hangs the muscle.

    Raises:
        MuscleLoadError: a value is missing or not finite.
    """

    pressures_gauge_mpa: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    tip_force_n: Vector = NOTHING
    tip_torque_n_mm: float = 0.0
    gravity_m_s2: Vector = NOTHING

    def __post_init__(self) -> None:
        sizes = len(self.pressures_gauge_mpa), len(self.tip_force_n), len(self.gravity_m_s2)
        if sizes != (4, 3, 3) or not np.all(np.isfinite(self.values)):
            raise MuscleLoadError(f"loads want 4 pressures, 3 forces, a torque and 3 of gravity, all finite: {self}")

    @property
    def values(self) -> NDArray[np.float64]:
        """All of them in the order of the arguments, shape (11,)."""
        return np.array([*self.pressures_gauge_mpa, *self.tip_force_n, self.tip_torque_n_mm, *self.gravity_m_s2])

    def toward(self, end: MuscleLoads, part: float) -> MuscleLoads:
        """Return the loads at ``part`` of the straight way to ``end``."""
        values = (self.values + part * (end.values - self.values)).tolist()
        return MuscleLoads(tuple(values[:4]), tuple(values[4:7]), values[7], tuple(values[8:]))

    def turned(self, angle_rad: float) -> MuscleLoads:
        """The force and gravity turned about z; pressures and torque as they are.

        Components that would be zero but for rounding are zero.
        """
        cosine, sine = math.cos(angle_rad), math.sin(angle_rad)

        def turn(vector: Vector) -> Vector:
            x, y, z = vector
            flat = cosine * x - sine * y, sine * x + cosine * y
            size = math.hypot(*flat)
            x, y = (value if abs(value) > _ROUNDING * size else 0.0 for value in flat)
            return x, y, z

        return MuscleLoads(
            self.pressures_gauge_mpa, turn(self.tip_force_n), self.tip_torque_n_mm, turn(self.gravity_m_s2)
        )

    def __str__(self) -> str:
        pressures = ", ".join(f"{1e3 * pressure:g}" for pressure in self.pressures_gauge_mpa)
        force, gravity = (
            ", ".join(f"{value:g}" for value in vector) for vector in (self.tip_force_n, self.gravity_m_s2)
        )
        return f"({pressures}) kPa, ({force}) N and {self.tip_torque_n_mm:g} N mm at the tip, gravity ({gravity}) m/s2"


def pattern_pressures_mpa(pattern: str, pressure_gauge_mpa: float) -> tuple[float, float, float, float]:
    """Return the four chamber pressures of a pattern.

    Raises:
        MuscleLoadError: there is no such pattern.
    """
    if pattern not in PATTERN_SHARES:
        raise MuscleLoadError(f"unknown pattern {pattern!r}; known: {', '.join(PATTERN_SHARES)}")
    first, second, third, fourth = (share * pressure_gauge_mpa for share in PATTERN_SHARES[pattern])
    return first, second, third, fourth
