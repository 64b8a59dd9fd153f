"""The detector's figures over a set of random scenes, for each source it may tell objects from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mbpam_ros.grasp.arbitration import load_grasp_config
from mbpam_ros.grasp.modes import load_modes
from mbpam_ros.grasp.selection import ModeSelector
from mbpam_ros.gripper import load_gripper
from mbpam_ros.study.judge.own import photograph_own, random_own_scene
from mbpam_ros.study.judge.scenes import JudgedScene, Split, random_scene
from mbpam_ros.study.judge.score import ImageScore, ObjectScore, calibration_error, reliability, score_image, summary
from mbpam_ros.vision.depth import DepthImage
from mbpam_ros.vision.detector import SOURCES, DetectorConfig, ObjectDetector, Sighting, Source
from mbpam_ros.vision.overlay import draw_overlay

_TILE_PX = (400, 300)
_ACROSS = 4


@dataclass(frozen=True, eq=False)
class Judged:
    """One image as one source tells it: the scene, what was seen, how that compares, and the overlay, bgr8."""

    scene: JudgedScene
    source: Source
    seen: Sighting
    score: ImageScore
    overlay: NDArray[np.uint8]


def judge_scenes(renderer: str, split: Split, seeds: Sequence[int], config: DetectorConfig) -> Iterator[list[Judged]]:
    """Draw scene after scene and look at each with every source.

    Args:
        renderer: mujoco, or own for the simulated palm camera's.
        split: set of tables and objects.
        seeds: of the scenes.
        config: of the detector.
    """
    gripper = load_gripper()
    selection = load_grasp_config().selection
    selector = ModeSelector(selection, gripper, load_modes())
    for seed in seeds:
        if renderer == "own":
            scene = random_own_scene(seed, split)
            photographs = photograph_own(scene)
        else:
            from mbpam_ros.study.judge.photograph import photograph  # MuJoCo, which other users need not have

            scene = random_scene(seed, split)
            photographs = photograph(scene, split)
        rows = []
        for source in SOURCES:
            detector = ObjectDetector(config, scene.assumed_pose, gripper if scene.fingers else None)
            detector.prepare(scene.intrinsics)
            if source == "background":
                detector.learn_background(list(photographs.backgrounds), "rgb8", scene.intrinsics, None)
            seen = detector.look(
                photographs.image,
                "rgb8",
                scene.intrinsics,
                None,
                scene.support_depth_m,
                depth=DepthImage(photographs.depth_m) if source == "depth" else None,
            )
            score = score_image(scene.things, seen.detections, selector, selection.confidence_min)
            rows.append(Judged(scene, source, seen, score, draw_overlay(photographs.image, "rgb8", seen.detections)))
        yield rows


def figures(judged: Sequence[Judged]) -> dict[str, Any]:
    """Return the figures of images of one source: of objects that can be grasped, and by camera, table and kind."""
    scores = [item.score for item in judged]
    times = [item.seen.cpu_s for item in judged]
    bins = reliability(scores)
    content: dict[str, Any] = {
        "images": len(judged),
        "graspable": summary(scores, lambda item: item.graspable),
        "all_objects": summary(scores),
        "calibration_error": calibration_error(bins),
        "reliability": bins,
        "cpu_ms_median": 1e3 * float(np.median(times)),
        "cpu_ms_p99": 1e3 * float(np.quantile(times, 0.99)),
        "over_budget": float(np.mean([item.seen.passed_over > 0 for item in judged])),
    }
    for name, key in (("by_camera", lambda item: item.scene.camera), ("by_table", lambda item: item.scene.table)):
        groups = sorted({key(item) for item in judged})
        content[name] = {
            group: summary([item.score for item in judged if key(item) == group], lambda item: item.graspable)
            for group in groups
        }
    kinds = sorted({item.kind for score in scores for item in score.objects})
    content["by_kind"] = {kind: summary(scores, _graspable_of(kind)) for kind in kinds}
    return content


def _graspable_of(kind: str) -> Callable[[ObjectScore], bool]:
    return lambda item: item.graspable and item.kind == kind


def contact_sheet(judged: Sequence[Judged], count: int = 16) -> NDArray[np.uint8]:
    """Return the overlays of the worst images, bgr8, row by row: wrong modes first, then false alarms, then misses."""

    def badness(item: Judged) -> tuple[int, int, int]:
        objects = item.score.objects
        return (
            sum(o.wrong_mode for o in objects),
            item.score.false_alarms,
            sum(o.graspable and not o.mode_right for o in objects),
        )

    worst = sorted(judged, key=badness, reverse=True)[:count]
    tiles = []
    for item in worst:
        tile = cv2.resize(item.overlay, _TILE_PX, interpolation=cv2.INTER_AREA)
        text = f"{item.scene.seed} {item.source} {item.scene.table}"
        cv2.putText(tile, text, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 255, 255), 1, cv2.LINE_AA)
        tiles.append(tile)
    while len(tiles) % _ACROSS:
        tiles.append(np.zeros_like(tiles[0]))
    rows = [np.hstack(tiles[i : i + _ACROSS]) for i in range(0, len(tiles), _ACROSS)]
    return np.vstack(rows).astype(np.uint8, copy=False)


def without_budget(config: DetectorConfig) -> DetectorConfig:
    """The same detector with all the time it wants, for judging what it can see on a busy machine."""
    return replace(config, budget_s=10.0)
