"""Grasp modes: toward which of the eight directions each finger bends, and the set-points that make it so.

A mode exists in every turn by 90 deg and as its mirror image, because the fingers stand at the corners of a square
with parallel muscle frames: a turn moves finger i's bend to finger i + 1 and adds 90 deg to its azimuth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, FINGER_COUNT, pressurised_chambers
from mbpam_ros.configuration import load_config

_MIRROR_IMAGE_OF_FINGER = (3, 2, 1, 0)
"""Index of the finger that stands at the mirror image (y -> -y) of each finger."""


@dataclass(frozen=True)
class GraspMode:
    """One grasp mode. Rod modes hold an object that lies along gripper Y.

    Args:
        name: the mode's name, as in its service.
        bend_azimuth_deg: azimuth in ``gripper_base`` toward which fingers 1 to 4 bend [deg], multiples of 45;
            kept in [0, 360).

    Raises:
        ValueError: an azimuth is none of the eight directions.
    """

    name: str
    bend_azimuth_deg: tuple[float, float, float, float]

    def __post_init__(self) -> None:
        for finger, azimuth in enumerate(self.bend_azimuth_deg, start=1):
            if azimuth % 45.0 != 0.0:
                raise ValueError(f"{self.name}: finger {finger}: azimuth {azimuth:g} deg is not a multiple of 45")
        object.__setattr__(self, "bend_azimuth_deg", tuple(azimuth % 360.0 for azimuth in self.bend_azimuth_deg))

    def turned(self, quarter_turns: int) -> GraspMode:
        """Return the mode turned by ``quarter_turns`` times 90 deg about gripper Z; a rod along Y then lies along X."""
        azimuth = np.roll(self.bend_azimuth_deg, quarter_turns) + 90.0 * quarter_turns
        return replace(self, bend_azimuth_deg=tuple(azimuth.tolist()))

    def mirrored(self) -> GraspMode:
        """Return the mirror image about the XZ plane (y -> -y); a rod along Y stays along Y."""
        first, second, third, fourth = (-self.bend_azimuth_deg[finger] for finger in _MIRROR_IMAGE_OF_FINGER)
        return replace(self, bend_azimuth_deg=(first, second, third, fourth))

    @property
    def yaw_couple(self) -> float:
        """Sense in which the closing fingers turn an object about gripper Z.

        Sum over the fingers of the moment about Z of a unit force along the bend direction, applied at the finger's
        base, per radius of the finger circle: sum_i sin(bend azimuth_i - base azimuth_i). Zero: they only pinch.
        """
        return sum(
            math.sin(math.radians(azimuth - 45.0 - 90.0 * finger))
            for finger, azimuth in enumerate(self.bend_azimuth_deg)
        )

    def setpoints(
        self, pressure_gauge_pa: float, quarter_turns: int = 0, mirrored: bool = False
    ) -> NDArray[np.float64]:
        """Return the pressures of the 16 channels, shape (16,) [Pa gauge]; the mode is mirrored first, then turned.

        Raises:
            ValueError: the pressure is negative or not finite.
        """
        if not (math.isfinite(pressure_gauge_pa) and pressure_gauge_pa >= 0.0):
            raise ValueError(f"{self.name}: grip pressure must be finite and not negative, found {pressure_gauge_pa}")
        posed = (self.mirrored() if mirrored else self).turned(quarter_turns)
        chambers = [pressurised_chambers(math.radians(azimuth)) for azimuth in posed.bend_azimuth_deg]
        return pressure_gauge_pa * np.array(chambers, dtype=float).reshape(FINGER_COUNT * CHAMBERS_PER_FINGER)


@dataclass(frozen=True)
class _BendAzimuths:
    envelope: tuple[float, float, float, float]
    short_rod: tuple[float, float, float, float]
    slender_rod: tuple[float, float, float, float]
    mid_rod: tuple[float, float, float, float]

    def __post_init__(self) -> None:
        for name in MODE_NAMES:
            GraspMode(name, getattr(self, name))


@dataclass(frozen=True)
class _ModeFile:
    bend_azimuth_deg: _BendAzimuths


MODE_NAMES: tuple[str, ...] = tuple(field.name for field in fields(_BendAzimuths))
"""The modes of the gripper, each with a service of that name."""


def load_modes(name: str | Path = "modes.yaml") -> dict[str, GraspMode]:
    """Read the mode file ``name`` into the modes by name, in the order of :data:`MODE_NAMES`.

    Raises:
        ConfigError: a mode is missing or unknown, or an azimuth is none of the eight directions.
    """
    azimuths = load_config(_ModeFile, name).bend_azimuth_deg
    return {mode: GraspMode(mode, getattr(azimuths, mode)) for mode in MODE_NAMES}
