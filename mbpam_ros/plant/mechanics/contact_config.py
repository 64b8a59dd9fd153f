"""Constants of a kind of contact; what they mean is in :mod:`~mbpam_ros.plant.mechanics.contact_law`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.configuration import require_positive


class ContactKind(IntEnum):
    """What touches what; the palm moves with the hand, a support does not."""

    FINGER_OBJECT = 0
    OBJECT_SUPPORT = 1
    FINGER_SUPPORT = 2
    OBJECT_PALM = 3
    FINGER_FINGER = 4
    OBJECT_OBJECT = 5


class ContactLaw(NamedTuple):
    """Coefficients of the force law: k, c, mu, mu l_spin, l_roll, and the radius of the patch."""

    stiffness: float
    damping: float
    friction: float
    spin: float
    roll: float
    patch: float


@dataclass(frozen=True)
class ContactConfig:
    """One kind of contact.

    Args:
        stiffness_n_m: penalty stiffness of the pair; with a muscle, of each length of its radius that touches.
        damping_n_s_m: viscous damping of the pair along the normal, likewise.
        friction_coefficient: Coulomb's mu.
        spin_length_m: largest torque about the normal over mu times the normal force; 2/3 of the patch radius.
        roll_length_m: largest rolling torque over the normal force; 0 for none.
    """

    stiffness_n_m: float
    damping_n_s_m: float
    friction_coefficient: float
    spin_length_m: float
    roll_length_m: float

    def __post_init__(self) -> None:
        require_positive(self, "stiffness_n_m")
        for name in ("damping_n_s_m", "friction_coefficient", "spin_length_m", "roll_length_m"):
            if getattr(self, name) < 0.0:
                raise ValueError(f"{name} must not be negative, found {getattr(self, name)}")

    def law(self) -> ContactLaw:
        """Return the coefficients that the compiled force law reads."""
        return ContactLaw(
            stiffness=self.stiffness_n_m,
            damping=self.damping_n_s_m,
            friction=self.friction_coefficient,
            spin=self.friction_coefficient * self.spin_length_m,
            roll=self.roll_length_m,
            patch=1.5 * max(self.spin_length_m, self.roll_length_m),
        )


def law_table(configs: Mapping[ContactKind, ContactConfig]) -> NDArray[np.float64]:
    """Return the laws of all kinds, a row a kind, shape (6, 6); :func:`~.contact_law.law_of` reads them.

    Raises:
        KeyError: a kind is missing.
    """
    return np.array([configs[kind].law() for kind in ContactKind])
