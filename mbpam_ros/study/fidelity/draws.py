"""Scenes drawn at random, on which the planner is calibrated and, with other seeds, judged.

One in five has muscles in the air alone, each at its own pressure and direction; in the others a sphere, a
cylinder or a box is closed upon and lifted. What may differ between scenes is drawn evenly from the ranges below, the
tolerance evenly by its logarithm. A scene whose object would start inside something is drawn again. The same seed and
number give the same scene, whatever is drawn besides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import pressurised_chambers
from mbpam_ros.actuator.strains import STRAINS
from mbpam_ros.configuration import ConfigError, load_config
from mbpam_ros.geometry.solids import half_height
from mbpam_ros.grasp.modes import load_modes
from mbpam_ros.gripper import Gripper
from mbpam_ros.plant.lift import LiftConfig
from mbpam_ros.plant.placement import placed
from mbpam_ros.plant.planner import AIR, KINDS
from mbpam_ros.plant.scene import ObjectSpec, SupportConfig, load_scene
from mbpam_ros.plant.tiers.base import PlantConfig
from mbpam_ros.study.fidelity.cases import Case, grasp_mode

Array = NDArray[np.float64]

SHARES = (0.2, 0.27, 0.27, 0.26)
"""Of the kinds of scene, in the order of :data:`~mbpam_ros.plant.planner.KINDS`."""

STRAIN_SETS = (("bend",), ("bend", "stretch"), STRAINS)
STRAIN_SHARES = (0.5, 0.25, 0.25)

TOLERANCE_PCT = (0.5, 10.0)
PRESSURE_PA = (60e3, 105e3)
AIR_PRESSURE_PA = (20e3, 105e3)
RISE_S = (0.3, 0.8)
FRICTION = (0.1, 1.0)
MASS_KG = (0.02, 0.2)
LIFT_M, LIFT_S = (0.05, 0.15), (0.7, 1.3)
DEPTH_M = (0.070, 0.095)
OFFSET_M, YAW_RAD = 0.004, 0.15
"""Largest, either way."""

SIZES_M = {
    "sphere": ((0.045, 0.070),),
    "cylinder": ((0.018, 0.042), (0.10, 0.25)),
    "box": ((0.025, 0.042), (0.08, 0.15), (0.03, 0.07)),
}
"""Ranges: diameter; diameter and length; extents along x, y and z."""

_RELEASED_SHARE = 0.3
_SETTLED_S, _STAND_M = 1.0, 0.2
_DRAWS = 1000


@dataclass(frozen=True)
class DrawnScene:
    """A scene with what is asked of its computation.

    Args:
        case: the scene, the pressures over time, and when errors are read.
        tolerance_pct: of positions at rest and in motion, of the solution.
        strains: of the muscles.
        pressure_gauge_pa: the largest set-point.
    """

    case: Case
    tolerance_pct: float
    strains: tuple[str, ...]
    pressure_gauge_pa: float


def drawn_scene(seed: int, number: int, gripper: Gripper) -> DrawnScene:
    """Return a scene by its seed and number.

    Raises:
        ConfigError: the scene ``empty``, the modes or the plant's constants cannot be read, or no scene fits the
            gripper.
    """
    rng = np.random.default_rng([seed, number])
    kind = str(rng.choice(KINDS, p=SHARES))
    strains = STRAIN_SETS[rng.choice(len(STRAIN_SETS), p=STRAIN_SHARES)]
    tolerance_pct = float(np.exp(rng.uniform(*np.log(TOLERANCE_PCT))))
    name = f"{kind} {seed}.{number}"
    case = _air(name, rng) if kind == AIR else _grasp(name, kind, rng, gripper)
    return DrawnScene(case, tolerance_pct, strains, float(case.setpoint_gauge_pa.max()))


def ranges() -> dict[str, dict[str, tuple[float, float]]]:
    """Return the least and the greatest of each of the planner's features, by kind of scene.

    Raises:
        ConfigError: ``empty`` or ``plant.yaml`` cannot be read.
    """
    stiffness = load_config(PlantConfig, "plant.yaml").finger_object.stiffness_n_m
    gravity = load_scene("empty")[0].gravity_m_s2
    everywhere = {"tilt [deg]": (0.0, 0.0), "gravity [m/s2]": (gravity, gravity)}
    grasp = everywhere | {
        "pressure [kPa]": _scaled(1e-3, PRESSURE_PA),
        "mass [g]": _scaled(1e3, MASS_KG),
        "friction": FRICTION,
        "contact stiffness [N/m]": (stiffness, stiffness),
        "depth [mm]": _scaled(1e3, DEPTH_M),
        "offset [mm]": (0.0, 1e3 * math.sqrt(2.0) * OFFSET_M),
        "yaw [deg]": (0.0, math.degrees(YAW_RAD)),
        "lift speed [mm/s]": (1e3 * LIFT_M[0] / LIFT_S[1], 1e3 * LIFT_M[1] / LIFT_S[0]),
    }
    names = {"sphere": ("diameter",), "cylinder": ("diameter", "length"), "box": ("width", "length", "height")}
    return {AIR: everywhere | {"pressure [kPa]": _scaled(1e-3, AIR_PRESSURE_PA)}} | {
        kind: grasp
        | {f"{name} [mm]": _scaled(1e3, size) for name, size in zip(names[kind], SIZES_M[kind], strict=True)}
        for kind in KINDS[1:]
    }


def _scaled(factor: float, limits: tuple[float, float]) -> tuple[float, float]:
    return factor * limits[0], factor * limits[1]


def _air(name: str, rng: np.random.Generator) -> Case:
    """Muscles bend outward, each toward one of the three directions that lead away from the others."""
    outward = np.radians([45.0, 135.0, 225.0, 315.0]) + np.radians(rng.choice([-45.0, 0.0, 45.0], size=4))
    chambers = np.array([pressurised_chambers(azimuth) for azimuth in outward], dtype=float)
    setpoint = (chambers * rng.uniform(*AIR_PRESSURE_PA, size=(4, 1))).ravel()
    rise_s = float(rng.uniform(*RISE_S))
    shares: tuple[tuple[float, float], ...] = ((0.0, 0.0), (rise_s, 1.0))
    rest_s: tuple[float, ...] = (_whole(rise_s + 1.2),)
    if rng.random() < _RELEASED_SHARE:
        shares = (*shares, (rest_s[0], 1.0), (rest_s[0] + 0.01, 0.0))
        rest_s = (*rest_s, _whole(rest_s[0] + 1.5))
    scene = replace(load_scene("empty")[0], name=name)
    return Case(name, scene, setpoint, shares, rest_s, (0.0, rest_s[-1]))


def _grasp(name: str, shape: str, rng: np.random.Generator, gripper: Gripper) -> Case:
    config = load_config(PlantConfig, "plant.yaml")
    for _ in range(_DRAWS):
        case = _any_grasp(name, shape, rng)
        try:
            placed(case.scene, gripper, config, contact=True)
        except ConfigError:
            continue
        return case
    raise ConfigError(f"no {shape} of {_DRAWS} that were drawn fits between the gripper's fingers")


def _any_grasp(name: str, shape: str, rng: np.random.Generator) -> Case:
    empty, _ = load_scene("empty")
    spec = _object(shape, rng)
    depth_m = float(rng.uniform(*DEPTH_M))
    offset_m = rng.uniform(-OFFSET_M, OFFSET_M, size=2)
    lift = LiftConfig(float(rng.uniform(*LIFT_M)), float(rng.uniform(*LIFT_S)))
    scene = replace(
        empty,
        name=name,
        object=spec,
        object_position_m=(float(offset_m[0]), float(offset_m[1]), depth_m),
        object_yaw_rad=0.0 if shape == "sphere" else float(rng.uniform(-YAW_RAD, YAW_RAD)),
        lift=lift,
        friction_coefficient=float(rng.uniform(*FRICTION)),
        fingers_touch=spec.expected_mode != "slender_rod",
    )
    under_m = depth_m + half_height(spec.shape, spec.size_m, scene.object_orientation_xyzw)
    half_size_m = (0.010, 0.010) if shape == "sphere" else (0.008, 0.030)
    scene = replace(scene, support=SupportConfig(under_m, half_size_m, _STAND_M))
    setpoint = load_modes()[spec.expected_mode].setpoints(float(rng.uniform(*PRESSURE_PA)))
    rise_s = float(rng.uniform(*RISE_S))
    closed_s = _whole(rise_s + _SETTLED_S)
    lifted_s = _whole(closed_s + lift.duration_s + 0.6)
    shares = ((0.0, 0.0), (rise_s, 1.0))
    return Case(name, scene, setpoint, shares, (closed_s, lifted_s), (0.0, lifted_s), lift_s=closed_s)


def _object(shape: str, rng: np.random.Generator) -> ObjectSpec:
    drawn = [float(rng.uniform(*each)) for each in SIZES_M[shape]]
    size_m = {"sphere": (0, 0, 0), "cylinder": (0, 0, 1), "box": (0, 1, 2)}[shape]
    spec = ObjectSpec(
        name=shape,
        shape=shape,  # type: ignore[arg-type]
        size_m=tuple(drawn[index] for index in size_m),  # type: ignore[arg-type]
        mass_kg=float(np.exp(rng.uniform(*np.log(MASS_KG)))),
        colour_rgb=(0.5, 0.5, 0.5),
        label=shape,
        expected_mode="",
    )
    return replace(spec, expected_mode=grasp_mode(spec))


def _whole(time_s: float) -> float:
    """Return a time as a whole number of ticks."""
    return round(100.0 * time_s) / 100.0
