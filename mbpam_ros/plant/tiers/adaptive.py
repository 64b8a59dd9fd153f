"""Tier ``rod`` with fewer modes, and without the objects, while nothing is within the muscles' reach.

Before each step in the air the gap between muscles and objects is set beside how far the muscles may come within it.
Stepping up adds modes that start at zero, which moves nothing but what the number of points along a rod changes.
Stepping down drops modes; ten times a second it is tried, and done if no tip moves by more than what is allowed and the
objects are at rest, where they then stay. Every change is logged.
"""

from __future__ import annotations

import dataclasses
import logging

import numpy as np

from mbpam_ros.geometry.rotations import rotation_matrix
from mbpam_ros.geometry.solids import distance_m
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.tiers.base import Actuation, Array, Tier, TierError, TierSetup, TierState
from mbpam_ros.plant.tiers.rod import RodTier

LEAST_GAP_M = 0.004
"""Nearer than this counts as within reach: points of a centre line are 10 mm apart."""

_STEP_DOWN_GAP = 1.5
"""Over the gap at which it steps up, so that it does not step back and forth."""

_FASTEST_M_S = 5.0
"""Muscles in the air stay far below it: until they could have come within reach, nothing need be looked at."""

_REST_M_S, _REST_RAD_S = 1e-3, 1e-2
_LOOK_DOWN_EVERY_S = 0.1

_log = logging.getLogger(__name__)


class AdaptiveTier(Tier):
    """Two tiers ``rod`` of which one moves the muscles: that of the air, or that of contact.

    Args:
        air: the muscles alone.
        contact: the muscles, the objects and all that they may touch.
        setup, fidelity: of ``contact``.

    Raises:
        TierError: there is no object.
    """

    def __init__(self, air: RodTier, contact: RodTier, setup: TierSetup, fidelity: Fidelity) -> None:
        if setup.body is None:
            raise TierError("a number of modes that changes is for a scene with an object")
        self._air, self._contact = air, contact
        self._setup, self._sub_step_s = setup, fidelity.sub_step_s
        self._gravity_m_s2 = setup.gravity_vector_m_s2
        self._largest_jump_m = 1e-2 * fidelity.largest_jump_pct * setup.geometry.active_length_m

    @property
    def in_contact_tier(self) -> bool:
        """Whether the tier of contact moves the muscles."""
        return self._active is self._contact

    def reset(self, actuation: Actuation) -> None:
        self._air.reset(actuation)
        self._contact.reset(actuation)
        self._active = self._contact
        self._time_s = self._look_s = 0.0
        self._places = self._object_places()

    def step(self, actuation: Actuation, hand_height_m: Array, hand_velocity_m_s: Array) -> None:
        duration_s = (len(hand_height_m) - 1) * self._sub_step_s
        if self._time_s >= self._look_s:
            look = self._look_down if self.in_contact_tier else self._look_up
            look(duration_s, hand_height_m, hand_velocity_m_s)
        self._active.step(actuation, hand_height_m, hand_velocity_m_s)
        self._time_s += duration_s

    @property
    def has_strain(self) -> bool:
        return self._contact.has_strain

    def set_gravity(self, gravity_m_s2: Array) -> None:
        self._gravity_m_s2 = np.array(gravity_m_s2, dtype=float)
        self._air.set_gravity(gravity_m_s2)
        self._contact.set_gravity(gravity_m_s2)

    def state(self) -> TierState:
        if self.in_contact_tier:
            return self._contact.state()
        still = tuple(
            dataclasses.replace(each, finger_n=np.zeros_like(each.finger_n)) for each in self._contact.body_forces()
        )
        return dataclasses.replace(self._air.state(), bodies=self._contact.body_states(), body_forces=still)

    def _look_up(self, duration_s: float, hand_height_m: Array, hand_velocity_m_s: Array) -> None:
        lines = self._air.centreline_m()
        gap_m = self._gap_m(lines, hand_height_m[0])
        if gap_m < self._reach_m(duration_s, hand_velocity_m_s):
            self._change(self._contact, gap_m, lines)
        self._look_s = self._time_s + max(gap_m - LEAST_GAP_M, 0.0) / _FASTEST_M_S - duration_s

    def _look_down(self, duration_s: float, hand_height_m: Array, hand_velocity_m_s: Array) -> None:
        if self._objects_rest():
            self._places = self._object_places()
            lines = self._contact.centreline_m()
            gap_m = self._gap_m(lines, hand_height_m[0])
            if gap_m > _STEP_DOWN_GAP * self._reach_m(duration_s, hand_velocity_m_s):
                self._change(self._air, gap_m, lines)
        # The first step is what shows whether the object rests; in the air the next one is looked at.
        waits = self.in_contact_tier and self._time_s > 0.0
        self._look_s = self._time_s + (_LOOK_DOWN_EVERY_S if waits else 0.0)

    def _reach_m(self, duration_s: float, hand_velocity_m_s: Array) -> float:
        """How near the object may be for the muscles not to touch it within the step, even at twice their speed."""
        hand_m_s = float(np.abs(hand_velocity_m_s).max())
        speed_m_s = self._setup.geometry.length_m * self._active.largest_rate_rad_s() + hand_m_s
        return LEAST_GAP_M + 2.0 * speed_m_s * duration_s

    def _change(self, tier: RodTier, gap_m: float, lines: Array) -> None:
        """Go on with ``tier``, unless the tips would jump by more than what is allowed."""
        tier.take_over(self._active)
        jump_m = float(np.linalg.norm(tier.centreline_m()[:, -1] - lines[:, -1], axis=1).max())
        up = tier is self._contact
        if not up and jump_m > self._largest_jump_m:
            return
        _log.info(
            "at %.3f s, the object %.1f mm from the nearest finger: %s to %d modes a plane; the tips moved by %.4f mm",
            self._time_s, 1e3 * gap_m, "up" if up else "down", tier.modes, 1e3 * jump_m,
        )  # fmt: skip
        self._active = tier

    def _objects_rest(self) -> bool:
        return all(
            np.linalg.norm(there.velocity_m_s) < _REST_M_S
            and np.linalg.norm(there.angular_velocity_rad_s) < _REST_RAD_S
            and np.linalg.norm(forces.support_n + forces.objects_n + body.mass_kg * self._gravity_m_s2)
            < 0.01 * np.linalg.norm(body.mass_kg * self._gravity_m_s2)
            for body, there, forces in zip(
                self._setup.bodies, self._contact.body_states(), self._contact.body_forces(), strict=True
            )
        )

    def _object_places(self) -> list[tuple[Array, Array]]:
        """Axes, in columns, and centre of each object in the world, shapes (3, 3) and (3,)."""
        return [(rotation_matrix(body.orientation_xyzw), body.position_m) for body in self._contact.body_states()]

    def _gap_m(self, lines_m: Array, hand_height_m: float) -> float:
        """Smallest distance of the muscles' surface from an object's; negative where they overlap."""
        nearest_m = min(
            distance_m(
                body.shape,
                body.size_m,
                (lines_m.reshape(-1, 3) - (centre_m + (0.0, 0.0, hand_height_m))) @ turn,  # in gripper_base
            ).min()
            for body, (turn, centre_m) in zip(self._setup.bodies, self._places, strict=True)
        )
        return float(nearest_m) - self._setup.geometry.outer_radius_m
