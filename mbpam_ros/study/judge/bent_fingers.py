"""What the detector makes of fingers that bend over an object, and over an empty table, told of them or not.

The plant closes the hand, contact and all; its renderer draws what the palm camera sees; the estimator tells the
fingers from the measured pressures at the rate of ``finger_markers``, and they are used as the node does.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.configuration import load_config
from mbpam_ros.estimation.estimator import BendEstimator, EstimatorConfig
from mbpam_ros.grasp.arbitration import load_grasp_config
from mbpam_ros.grasp.modes import MODE_NAMES
from mbpam_ros.gripper import Gripper, load_gripper
from mbpam_ros.plant.plant import Observation
from mbpam_ros.plant.scene import Scene
from mbpam_ros.simulation import Simulation
from mbpam_ros.vision.camera import Camera, camera_intrinsics, camera_pose, load_camera_config
from mbpam_ros.vision.depth import DepthImage
from mbpam_ros.vision.detector import SOURCES, Detection, DetectorConfig, ObjectDetector, Source, open_fingers
from mbpam_ros.vision.finger_mask import FingerMask
from mbpam_ros.vision.region_fit import COARSE
from mbpam_ros.vision.render import ColouredSolid, Renderer, SceneView
from mbpam_ros.vision.told_fingers import ToldFingers, UnderHand

OBJECTS = ("tomato", "bulb", "banana", "tube", "carton")
PRESSURES_PA = (30e3, 60e3, 100e3)
_WORD_TICKS = 10  # between two words of the fingers, as the node's 10 Hz
_IMAGE_TICKS = 8
_TICKS = 96
_NEAR_M = 0.015
_TABLE_DEPTH_M = 0.14  # where nothing is to be grasped: out of the fingers' reach


@dataclass(frozen=True)
class BentSight:
    """One image of a hand.

    Args:
        over: an object's scene, or empty.
        pressure_gauge_pa: the set-point of the chambers; 0 before the hand closes.
        source: what objects are told from.
        told: whether it is told where the fingers are.
        is_seen: whether a usable detection lies within 15 mm of the object.
        false_alarms: usable detections that do not.
    """

    over: str
    pressure_gauge_pa: float
    source: Source
    told: bool
    is_seen: bool
    false_alarms: int


def look_at_bent_fingers(config: DetectorConfig, objects: Sequence[str] = OBJECTS) -> Iterator[list[BentSight]]:
    """Close upon each object, and in each mode upon nothing, at each pressure; yield what is seen in each run."""
    gripper = load_gripper()
    for pressure_pa in PRESSURES_PA:
        for name, mode in [*((name, None) for name in objects), *(("empty", mode) for mode in MODE_NAMES)]:
            yield _run(name, mode, pressure_pa, config, gripper)


def bent_figures(sights: Sequence[BentSight]) -> list[dict[str, str | float]]:
    """Return the figures of sights by what is below the hand, pressure and whether it is told: recall, false alarms."""
    rows: list[dict[str, str | float]] = []
    for over_object in (True, False):
        for pressure_pa in (0.0, *PRESSURES_PA):
            for told in (False, True):
                key = over_object, pressure_pa, told
                these = [each for each in sights if (each.over != "empty", each.pressure_gauge_pa, each.told) == key]
                if not these:
                    continue
                row: dict[str, str | float] = {
                    "over": "object" if over_object else "empty table",
                    "pressure_gauge_pa": pressure_pa,
                    "told": float(told),
                    "images": len(these) / len(SOURCES),
                }
                for source in SOURCES:
                    of_source = [each for each in these if each.source == source]
                    row[f"{source}_recall"] = float(np.mean([each.is_seen for each in of_source]))
                    row[f"{source}_false_alarms"] = float(np.mean([each.false_alarms for each in of_source]))
                rows.append(row)
    return rows


def mask_cost_s(config: DetectorConfig, bend_rad: float, repeats: int = 50) -> float:
    """Return the median processor time of the mask of four fingers that have just bent inward [s]."""
    gripper = load_gripper()
    radius_m = gripper.geometry.outer_radius_m + config.finger_margin_m
    mask = FingerMask(Camera.from_config(load_camera_config()), COARSE, radius_m, config.finger_bend_margin)
    angle = max(bend_rad, 1e-6) * np.linspace(0.0, 1.0, 14)[:, None]
    clamps = gripper.finger_base_m[:, None]
    inward = -clamps / np.linalg.norm(clamps, axis=2, keepdims=True)
    arcs = gripper.geometry.length_m / angle[-1] * ((1.0 - np.cos(angle)) * inward + np.sin(angle) * [0.0, 0.0, 1.0])
    costs_s = []
    for k in range(repeats):
        began_s = time.thread_time()
        mask.of(clamps + arcs + 1e-9 * k)
        costs_s.append(time.thread_time() - began_s)
    return float(np.median(costs_s))


def _run(name: str, mode: str | None, pressure_pa: float, config: DetectorConfig, gripper: Gripper) -> list[BentSight]:
    simulation = Simulation(name, gripper=gripper, grip_pressure_gauge_pa=pressure_pa)
    estimator = BendEstimator.for_gripper(gripper, load_config(EstimatorConfig, "estimator.yaml"))
    fingers = ToldFingers(open_fingers(gripper))
    exposed: list[Observation] = []
    for tick in range(-_WORD_TICKS, _TICKS + _WORD_TICKS + 1):
        if tick == 0:
            simulation.grasp(mode)
        if 0 <= tick <= _TICKS and tick % _IMAGE_TICKS == 0:  # each has a word after it
            exposed.append(simulation.seen)
        time_s = simulation.seen.time_s
        simulation.tick()
        estimate = estimator.update(time_s, simulation.pressure_gauge_pa)
        if tick % _WORD_TICKS == 0:
            fingers.tell(time_s, estimator.centrelines(estimate))
    eye = _Eye(simulation.scene, config, gripper)
    confident = load_grasp_config().selection.confidence_min
    sights = []
    for source in SOURCES:
        under = UnderHand(gripper.finger_circle_radius_m + gripper.geometry.outer_radius_m)
        for seen in exposed:
            told_m = fingers.at(seen.time_s)
            for told in (False, True):
                found = eye.look(seen, source, told_m if told and under.is_empty else None)
                if told and told_m is None:
                    under.seen(found)
                usable = [each.position_m for each in found if each.confidence >= confident]
                body = seen.object_in_gripper
                here = [body is not None and np.hypot(*(at - body.position_m)[:2]) < _NEAR_M for at in usable]
                at_pa = pressure_pa if seen is not exposed[0] else 0.0
                sights.append(BentSight(name, at_pa, source, told, any(here), here.count(False)))
    return sights


class _Eye:
    """The palm camera with depth: renders what is there, and detects."""

    def __init__(self, scene: Scene, config: DetectorConfig, gripper: Gripper) -> None:
        camera = load_camera_config()
        self._scene, self._radius_m = scene, gripper.geometry.outer_radius_m
        self._renderer, self._intrinsics = Renderer.from_config(camera), camera_intrinsics(camera)
        self._rng = np.random.default_rng(0)
        self._detectors = {source: ObjectDetector(config, camera_pose(camera), gripper) for source in SOURCES}
        lines = open_fingers(gripper)
        empty = [self._renderer.render(self._view(lines, ()), self._rng) for _ in range(3)]
        self._detectors["background"].learn_background(empty, "rgb8", self._intrinsics, None)

    def look(self, seen: Observation, source: Source, told_m: NDArray[np.float64] | None) -> list[Detection]:
        spec, body = self._scene.object, seen.object_in_gripper
        solids: tuple[ColouredSolid, ...] = ()
        if spec is not None and body is not None:
            size = np.array(spec.size_m)
            solids = (ColouredSolid(spec.shape, size, body.position_m, body.orientation_xyzw, spec.colour_rgb),)
        view = self._view(seen.centreline_m, solids)
        depth = DepthImage(self._renderer.render_depth(view, self._rng)) if source == "depth" else None
        image = self._renderer.render(view, self._rng)
        return self._detectors[source].detect(
            image, "rgb8", self._intrinsics, None, view.support_depth_m, told_m, depth
        )

    def _view(self, lines: NDArray[np.float64], solids: tuple[ColouredSolid, ...]) -> SceneView:
        support = self._scene.support
        if support is None:
            return SceneView(_TABLE_DEPTH_M, solids, lines, self._radius_m)
        floor_m = support.depth_m + (support.stand_height_m or 0.25)
        return SceneView(support.depth_m, solids, lines, self._radius_m, support.half_size_m, floor_depth_m=floor_m)
