"""Grasps of nothing: how far the fingers of an empty hand bend, for :class:`~mbpam_ros.grasp.empty_hand.EmptyHand`."""

from __future__ import annotations

import math

import numpy as np

from mbpam_ros.grasp.arbitration import Phase
from mbpam_ros.grasp.modes import MODE_NAMES, load_modes
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.fidelity import FidelityRequest
from mbpam_ros.plant.lift import LiftConfig
from mbpam_ros.plant.scene import Scene
from mbpam_ros.simulation import Simulation

PRESSURES_PA = (40e3, 60e3, 70e3, 80e3, 90e3, 100e3, 110e3)

_STAY_S = 0.5


def empty_scene(mode: str) -> Scene:
    """Return a scene with nothing in it; fingers pass through each other in the mode in which the paper's do."""
    return Scene(
        f"nothing, {mode}", None, None, 0.0, 9.81, None, LiftConfig(0.1, 1.0), fingers_touch=mode != "slender_rod"
    )


def empty_rows(request: FidelityRequest, gripper: Gripper) -> list[dict[str, object]]:
    """Return the bends of all modes, a row each.

    Raises:
        ConfigError, TierError: a file is wrong, or the tier cannot compute the scene.
    """
    return [
        {
            "mode": mode,
            "pressure_gauge_pa": list(PRESSURES_PA),
            "bend_deg": [_bend_deg(mode, pressure, request, gripper) for pressure in PRESSURES_PA],
        }
        for mode in MODE_NAMES
    ]


def _bend_deg(mode: str, pressure_gauge_pa: float, request: FidelityRequest, gripper: Gripper) -> list[float]:
    simulation = Simulation(empty_scene(mode), request, gripper, pressure_gauge_pa)
    simulation.grasp(mode)
    simulation.run_until(lambda: simulation.decision.phase is Phase.HOLDING)
    bend = simulation.run(_STAY_S).bend_rad
    toward = np.radians(load_modes()[mode].bend_azimuth_deg)
    along = bend[:, 0] * np.cos(toward) + bend[:, 1] * np.sin(toward)
    return [round(math.degrees(each), 3) for each in along]
