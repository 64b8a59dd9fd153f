"""The face of all tiers, and what passes through it.

A tier moves the muscles (and an object, if it can) for given intrinsic moments and stiffnesses and a given motion of
the hand. It knows no pressures, no scene's name and no clock.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.rod_law import StrainLaw
from mbpam_ros.configuration import require_positive
from mbpam_ros.errors import MbpamError
from mbpam_ros.geometry.solids import Shape
from mbpam_ros.plant.mechanics.contact_config import ContactConfig

Array = NDArray[np.float64]


CENTRELINE_POINTS = 14
"""Points of a centre line, evenly from clamp to tip."""


class TierError(MbpamError, ValueError):
    """No such tier, or one that cannot compute what the scene holds."""


class PlantDivergedError(MbpamError, RuntimeError):
    """A step left the range of what can be; the state before it is kept. The message says what to change."""


@dataclass(frozen=True)
class PlantConfig:
    """Constants of the simulated muscles and contacts (``plant.yaml``).

    Args:
        retardation_time_s: Kelvin-Voigt damping of the muscle over its stiffness.
        static_lag_s: time constant of the tier ``static``.
        finger_object, object_support, finger_support, finger_finger: the kinds of contact; the palm is a support.
    """

    retardation_time_s: float
    static_lag_s: float
    finger_object: ContactConfig
    object_support: ContactConfig
    finger_support: ContactConfig
    finger_finger: ContactConfig

    def __post_init__(self) -> None:
        require_positive(self, "static_lag_s")
        if self.retardation_time_s < 0.0:
            raise ValueError(f"retardation_time_s must not be negative, found {self.retardation_time_s}")


@dataclass(frozen=True)
class RigidBody:
    """A free solid and where and how fast it starts, world frame."""

    shape: Shape
    size_m: tuple[float, float, float]
    mass_kg: float
    position_m: Array
    orientation_xyzw: Array
    velocity_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    angular_velocity_rad_s: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TierSetup:
    """What there is for a tier to move, and what it may touch.

    Args:
        geometry: of the muscles.
        finger_base_m: clamp points in ``gripper_base``, shape (4, 3), or of fewer muscles.
        gravity_m_s2: acceleration of gravity.
        gravity_direction: unit vector along which it acts, ``gripper_base``; +z where the muscles hang.
        body: the object, or none.
        others: further objects; none without ``body``.
        planes_m: rows (depth, half size x, half size y) of level supports; an endless one has infinite half sizes.
        config: constants of muscles and contacts.
        fingers_touch: whether muscles touch each other; otherwise they pass through each other.
    """

    geometry: MuscleGeometry
    finger_base_m: Array
    gravity_m_s2: float
    body: RigidBody | None
    planes_m: Array
    config: PlantConfig
    fingers_touch: bool = False
    gravity_direction: tuple[float, float, float] = (0.0, 0.0, 1.0)
    others: tuple[RigidBody, ...] = ()

    @property
    def bodies(self) -> tuple[RigidBody, ...]:
        """All objects, ``body`` first."""
        return () if self.body is None else (self.body, *self.others)

    @property
    def gravity_vector_m_s2(self) -> Array:
        """Gravity as a vector, ``gripper_base``, shape (3,)."""
        vector: Array = self.gravity_m_s2 * np.array(self.gravity_direction)
        return vector


@dataclass(frozen=True)
class Actuation:
    """What the air does to the muscles at one instant.

    Args:
        moment_n_m: intrinsic moment M0, shape (4, 2).
        stiffness_n_m2: bending stiffness B, shape (4,).
        strain: what it does to stretch and twist; none where the tier has neither.
    """

    moment_n_m: Array
    stiffness_n_m2: Array
    strain: StrainLaw | None = None


@dataclass(frozen=True)
class BodyState:
    """Pose and velocity of an object, world frame: (3,) [m], (4,), (3,) [m/s], (3,) [rad/s]."""

    position_m: Array
    orientation_xyzw: Array
    velocity_m_s: Array
    angular_velocity_rad_s: Array


@dataclass(frozen=True)
class BodyForces:
    """Forces on one object, world frame [N].

    Args:
        finger_n: of each finger, shape (4, 3).
        support_n, palm_n, objects_n: of its supports, the palm and all other objects, shape (3,).
    """

    finger_n: Array
    support_n: Array
    palm_n: Array
    objects_n: Array

    @classmethod
    def none(cls, fingers: int) -> BodyForces:
        """Return those on what so many fingers, and all else, leave alone."""
        return cls(np.zeros((fingers, 3)), *np.zeros((3, 3)))


@dataclass(frozen=True)
class TierState:
    """What a tier has computed.

    Args:
        bend_rad, bend_rate_rad_s: of the four muscles, shape (4, 2): the rotation vector (without twist) that turns
            the clamp's tangent z into the tip's, t = (sin|bend| bend / |bend|, cos|bend|), its two components toward x
            and y. Of all such vectors the one nearest to the curvature added up along the muscle, so that it goes on
            beyond 180 deg; with constant curvature it is that sum.
        centreline_m: points of the centre lines in ``gripper_base``, evenly from clamp to tip, shape (4, n, 3).
        bodies: the objects.
        body_forces: on each of them.
        between_fingers_force_n: force on each finger of the other fingers, world frame, shape (4, 3).
    """

    bend_rad: Array
    bend_rate_rad_s: Array
    centreline_m: Array
    bodies: tuple[BodyState, ...]
    body_forces: tuple[BodyForces, ...]
    between_fingers_force_n: Array

    @property
    def body(self) -> BodyState | None:
        """The first object, or none."""
        return self.bodies[0] if self.bodies else None

    @property
    def finger_force_n(self) -> Array:
        """Force of each finger on the first object, shape (4, 3); zero without one."""
        return self._forces.finger_n

    @property
    def support_force_n(self) -> Array:
        """Force of the support on the first object, shape (3,); zero without one."""
        return self._forces.support_n

    @property
    def palm_force_n(self) -> Array:
        """Force of the palm on the first object, shape (3,); zero without one."""
        return self._forces.palm_n

    @property
    def _forces(self) -> BodyForces:
        return self.body_forces[0] if self.body_forces else BodyForces.none(len(self.bend_rad))


class Tier(ABC):
    """Reset, step, state.

    A tier keeps the actuation that acts at the present instant: a reset gives it, and the end of each step. It reads
    what it is given at once and keeps no reference, so that a caller may use its arrays again. Nothing but
    :meth:`reset` may be asked of a tier that was never reset.
    """

    @abstractmethod
    def reset(self, actuation: Actuation) -> None:
        """Hang the muscles straight and at rest, put the object where it starts.

        Args:
            actuation: what acts at this instant, and from which the first step's runs on.
        """

    @abstractmethod
    def step(self, actuation: Actuation, hand_height_m: Array, hand_velocity_m_s: Array) -> None:
        """Advance by ``len(hand_height_m) - 1`` sub-steps; without any, only the actuation changes.

        Args:
            actuation: what acts at the end; it runs straight there from what acts now.
            hand_height_m, hand_velocity_m_s: rise of the hand (up positive) at every end of a sub-step, shape (n + 1,).

        Raises:
            PlantDivergedError: the step left what can be; the state, the actuation with it, is as it was before.
        """

    @abstractmethod
    def state(self) -> TierState:
        """Return copies of what was computed."""

    @property
    def has_strain(self) -> bool:
        """Whether muscles stretch or twist, so that an actuation has to say how."""
        return False

    def set_gravity(self, gravity_m_s2: Array) -> None:
        """Let gravity act as this vector from now on, ``gripper_base``, shape (3,).

        Raises:
            TierError: it acts otherwise than along +z, and the tier knows no other.
        """
        raise TierError("this tier keeps the gravity it was built with: use tier 'arc' or 'rod'")
