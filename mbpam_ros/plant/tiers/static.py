"""Tier ``static``: muscles follow their hanging equilibrium with a first-order lag. No contact, no inertia."""

from __future__ import annotations

import math

import numpy as np

from mbpam_ros.actuator.equilibrium import hanging_bend
from mbpam_ros.actuator.kinematics import centreline
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.tiers.base import CENTRELINE_POINTS, Actuation, Array, Tier, TierError, TierSetup, TierState


class StaticTier(Tier):
    """d(bend)/dt = (equilibrium(t) - bend) / tau, the equilibrium running straight between the ends of a step.

    Integrated exactly, so there is no stability limit. The equilibrium itself bends with pressure inside a step; that
    is neglected (second order in the step). The motion of the hand has no influence.

    Raises:
        TierError: the setup holds an object, or gravity does not act along +z.
    """

    def __init__(self, setup: TierSetup, fidelity: Fidelity) -> None:
        if setup.body is not None:
            raise TierError("tier 'static' cannot move an object: use tier 'arc' or 'rod', or no object")
        if setup.gravity_m_s2 and not np.allclose(setup.gravity_direction, (0.0, 0.0, 1.0)):
            raise TierError("tier 'static' knows hanging muscles only: use tier 'arc' or 'rod', or gravity along +z")
        self._setup, self._sub_step_s = setup, fidelity.sub_step_s

    def reset(self, actuation: Actuation) -> None:
        self._equilibrium = self._rest(actuation)
        self._bend, self._rate = np.zeros_like(self._equilibrium), np.zeros_like(self._equilibrium)

    def step(self, actuation: Actuation, hand_height_m: Array, hand_velocity_m_s: Array) -> None:
        target = self._rest(actuation)
        if len(hand_height_m) == 1:
            self._equilibrium = target
            return
        duration, tau = (len(hand_height_m) - 1) * self._sub_step_s, self._setup.config.static_lag_s
        ramp = (target - self._equilibrium) / duration
        behind = self._bend - self._equilibrium + tau * ramp
        left = behind * math.exp(-duration / tau)
        self._bend = target - tau * ramp + left
        self._rate = ramp - left / tau
        self._equilibrium = target

    def state(self) -> TierState:
        setup = self._setup
        along = np.linspace(0.0, setup.geometry.length_m, CENTRELINE_POINTS)
        return TierState(
            bend_rad=self._bend.copy(),
            bend_rate_rad_s=self._rate.copy(),
            centreline_m=centreline(self._bend, setup.geometry, along) + setup.finger_base_m[:, None, :],
            bodies=(),
            body_forces=(),
            between_fingers_force_n=np.zeros((len(self._bend), 3)),
        )

    def _rest(self, actuation: Actuation) -> Array:
        setup = self._setup
        return hanging_bend(actuation.moment_n_m, actuation.stiffness_n_m2, setup.geometry, setup.gravity_m_s2)
