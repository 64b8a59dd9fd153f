"""The cases of the trade: a scene, the pressures asked for over time, and when errors are read.

Each is driven as the system drives its plant, by valve commands at 100 Hz that follow set-points. So it shows what the
pneumatic model does to the pressures, and what these do to the bend.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import pressurised_chambers
from mbpam_ros.configuration import ConfigError
from mbpam_ros.grasp.modes import load_modes
from mbpam_ros.plant.scene import ObjectSpec, Scene, load_scene

Array = NDArray[np.float64]

FULL_PA = 100e3
SLENDERNESS = 8.0
"""From which on a cylinder is grasped as a slender rod, as ``grasp.yaml`` has it."""

_RAMP = ((0.0, 0.0), (0.5, 1.0))
_FREE_REST_S, _CLOSED_S, _LIFTED_REST_S = 1.8, 1.5, 0.6
_UNEQUAL_SHARES = ((1.0, 0.5, 0.0, 0.0), (1.0, 0.5, 0.5, 0.0), (1.0, 0.25, 0.0, 0.75), (0.9, 0.0, 0.3, 0.6))
"""Of the chamber that faces the gripper's middle, and of the next ones, for fingers 1 to 4: all bend outward."""


@dataclass(frozen=True)
class Case:
    """What is run.

    Args:
        name: as in the table.
        scene: what is there.
        setpoint_gauge_pa: pressures at a share of one, shape (16,).
        shares: (time [s], share) of the set-points, straight lines between.
        rest_s: instants at which all is at rest.
        moving_s: first and last instant of the motion.
        lift_s: when the hand starts to rise; none for never.
    """

    name: str
    scene: Scene
    setpoint_gauge_pa: Array
    shares: tuple[tuple[float, float], ...]
    rest_s: tuple[float, ...]
    moving_s: tuple[float, float]
    lift_s: float | None = None

    @property
    def duration_s(self) -> float:
        """How long it is run."""
        return max(self.rest_s)

    def wanted_gauge_pa(self, time_s: float) -> Array:
        """Return the set-points (16,) at a time."""
        times_s, shares = zip(*self.shares, strict=True)
        return self.setpoint_gauge_pa * np.interp(time_s, times_s, shares)


def _closing(mode: str, full_pa: float = FULL_PA) -> Array:
    return load_modes()[mode].setpoints(full_pa)


def _opening(full_pa: float = FULL_PA) -> Array:
    """Two fingers under two chambers, two under one, bent away from each other: nothing touches."""
    outward_deg = (0.0, 135.0, 180.0, 315.0)
    return full_pa * np.concatenate([pressurised_chambers(np.radians(azimuth)) for azimuth in outward_deg])


def _unequal() -> Array:
    return FULL_PA * np.concatenate([np.roll(shares, finger + 2) for finger, shares in enumerate(_UNEQUAL_SHARES)])


def _free(name: str, setpoint_pa: Array) -> Case:
    return Case(name, load_scene("empty")[0], setpoint_pa, _RAMP, (_FREE_REST_S,), (0.0, _FREE_REST_S))


def opening_case(full_pa: float) -> Case:
    """Return the case in which all muscles bend outward, to a pressure.

    Raises:
        ConfigError: the scene ``empty`` cannot be read.
    """
    return _free("free_bend", _opening(full_pa))


def grasp_mode(spec: ObjectSpec) -> str:
    """Return the mode that suits an object that lies, as the camera's rules have it."""
    if spec.shape == "cylinder":
        return "slender_rod" if spec.size_m[2] >= SLENDERNESS * spec.size_m[0] else "short_rod"
    return {"sphere": "envelope", "box": "mid_rod"}[spec.shape]


def grasp_case(name: str, scene: Scene, mode: str, full_pa: float) -> Case:
    """Return the case that closes upon an object and lifts it: what a step does to friction shows under its weight.

    Raises:
        ConfigError: the modes cannot be read.
    """
    lifted_s = _CLOSED_S + round(100.0 * (scene.lift.duration_s + _LIFTED_REST_S)) / 100.0
    return Case(name, scene, _closing(mode, full_pa), _RAMP, (_CLOSED_S, lifted_s), (0.0, lifted_s), lift_s=_CLOSED_S)


def _grasp(name: str, scene_name: str, full_pa: float = FULL_PA) -> Case:
    scene, _ = load_scene(scene_name)
    if scene.object is None:
        raise ConfigError(f"scene {scene_name}: nothing to grasp")
    return grasp_case(name, scene, scene.object.expected_mode, full_pa)


def all_cases() -> tuple[Case, ...]:
    """Return all cases.

    ``free_bend``: two fingers under two chambers, two under one, to 100 kPa within 0.5 s, outward so that they do not
    meet. ``unequal_pressures``: four different sets, outward too. ``fast_release``: valves fully open from 100 kPa.
    ``sphere``, ``slender_rod`` and ``box``: bulb, tube and carton closed upon and lifted as the paper did, at 100 kPa.
    ``lift``: the bulb at 80 kPa, where the tips hold it by friction alone.

    Raises:
        ConfigError: a scene or the modes cannot be read.
    """
    release = (*_RAMP, (1.5, 1.0), (1.51, 0.0))
    return (
        _free("free_bend", _opening()),
        _free("unequal_pressures", _unequal()),
        Case("fast_release", load_scene("empty")[0], _opening(), release, (1.5, 3.0), (1.5, 3.0)),
        _grasp("sphere", "bulb"),
        _grasp("slender_rod", "tube"),
        _grasp("box", "carton"),
        _grasp("lift", "bulb", 80e3),
    )
