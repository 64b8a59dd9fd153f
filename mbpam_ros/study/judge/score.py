"""How detections compare with what is there, image by image and in all."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.geometry.solids import Shape
from mbpam_ros.grasp.selection import DetectedObject, GraspChoice, ModeSelector
from mbpam_ros.study.judge.scenes import Thing
from mbpam_ros.vision.detector import Detection

RIGHT_WITHIN_M = 0.008
"""Sizes that are nearer to the truth than this are right."""

MATCHED_WITHIN_M = 0.02
"""A detection whose centre is no farther beside a thing is of it."""

_REFUSED = "refused"


@dataclass(frozen=True)
class ObjectScore:
    """One object that is there.

    Args:
        kind: of the object.
        graspable: whether the gripper can grasp it where it is.
        found: whether a detection lies there.
        shape_right: whether it has the right shape.
        mode_right: whether the selector gives the mode, or the refusal, that it gives for the true object.
        wrong_mode: whether it gives a mode, and another one.
        width_error_m: of the grasped width, whether or not it is told as a bound; NaN where not found.
        size_error_m: the largest of all, of what is seen in part from its bounds.
        yaw_error_rad: likewise; 0 for what has none.
        confidence: of the detection.
        right: whether shape and sizes are right, as the confidence promises.
    """

    kind: str
    graspable: bool
    found: bool
    shape_right: bool
    mode_right: bool
    wrong_mode: bool
    width_error_m: float
    size_error_m: float
    yaw_error_rad: float
    confidence: float
    right: bool


@dataclass(frozen=True)
class ImageScore:
    """One image: its objects, detections of nothing, and each detection's confidence with whether it is right."""

    objects: tuple[ObjectScore, ...]
    false_alarms: int
    calibration: tuple[tuple[float, bool], ...]


def score_image(
    things: Sequence[Thing], detections: Sequence[Detection], selector: ModeSelector, used_from: float
) -> ImageScore:
    """Compare one image's detections with what is there.

    Args:
        things: what is there.
        detections: what was found.
        selector: of the grasp modes.
        used_from: confidence from which a detection is used; less certain ones count for calibration alone.
    """
    pairs = _matched(things, detections)
    used = {i: j for i, j in pairs.items() if detections[j].confidence >= used_from}
    matched = set(pairs.values())
    calibration = tuple(
        (
            found.confidence,
            next((is_right(things[i], found) for i, j in pairs.items() if j == index), False),
        )
        for index, found in enumerate(detections)
    )
    false_alarms = sum(found.confidence >= used_from and index not in matched for index, found in enumerate(detections))
    objects = tuple(
        _score(thing, detections[used[i]] if i in used else None, selector) for i, thing in enumerate(things)
    )
    return ImageScore(objects, false_alarms, calibration)


def _matched(things: Sequence[Thing], detections: Sequence[Detection]) -> dict[int, int]:
    """The detection of each thing: the surest whose centre lies on it."""
    pairs: dict[int, int] = {}
    for j, found in sorted(enumerate(detections), key=lambda item: -item[1].confidence):
        gaps = {i: gap_m(thing, found) for i, thing in enumerate(things) if i not in pairs}
        if gaps and min(gaps.values()) < MATCHED_WITHIN_M:
            pairs[min(gaps, key=lambda i: gaps[i])] = j
    return pairs


def gap_m(thing: Thing, found: Detection) -> float:
    """Horizontal distance of the detection's centre from the thing's, along which a length does not count."""
    offset = found.position_m - thing.position_m
    offset[2] = 0.0
    local = thing.rotation.inv().apply(offset)
    local = np.abs(local) - np.where(thing.size_m > 0.08, 0.5 * thing.size_m, 0.2 * thing.size_m)
    return float(np.linalg.norm(np.maximum(local, 0.0)))


def extents(shape: Shape, size_m: NDArray[np.float64], stands: bool) -> NDArray[np.float64]:
    """Width, length and height of a lying or standing solid, in an order that can be compared."""
    if shape == "cylinder" and not stands:
        return np.array([size_m[0], size_m[2], size_m[0]])
    width, length = sorted(size_m[:2])
    return np.array([width, length, size_m[2]])


def _truth_extents(thing: Thing) -> NDArray[np.float64]:
    return extents(thing.shape, thing.size_m, abs(thing.rotation.as_matrix()[2, 2]) > 0.7)


def is_right(thing: Thing, found: Detection) -> bool:
    """Whether shape and sizes are right; of a length seen in part, whether the true one lies within its bounds."""
    if found.shape != thing.shape:
        return False
    return bool(np.abs(_errors(thing, found)).max() < RIGHT_WITHIN_M)


def _score(thing: Thing, found: Detection | None, selector: ModeSelector) -> ObjectScore:
    truth = _mode(
        selector,
        DetectedObject(
            thing.kind,
            thing.shape,
            tuple(thing.size_m),
            tuple(thing.position_m),
            tuple(thing.rotation.as_quat()),
            1.0,
        ),
    )
    graspable = truth != _REFUSED
    if found is None:
        return ObjectScore(
            thing.kind, graspable, False, False, not graspable, False, math.nan, math.nan, math.nan, 0.0, False
        )
    mode = _mode(
        selector,
        DetectedObject(
            found.label,
            found.shape,
            tuple(found.size_m),
            tuple(found.position_m),
            tuple(found.orientation_xyzw),
            found.confidence,
            found.hidden_m,
        ),
    )
    error = _errors(thing, found)
    width_error = extents(found.shape, found.size_m, found.stands)[0] - _truth_extents(thing)[0]
    return ObjectScore(
        thing.kind,
        graspable,
        True,
        found.shape == thing.shape,
        mode == truth,
        mode not in (truth, _REFUSED),
        abs(float(width_error)),
        float(np.abs(error).max()),
        _yaw_error(thing, found),
        found.confidence,
        is_right(thing, found),
    )


def _errors(thing: Thing, found: Detection) -> NDArray[np.float64]:
    """Width, length and height as found, less the true ones; what is seen in part errs by what leaves its bounds."""
    truth = _truth_extents(thing)
    least, most = (found.size_m,) * 2 if found.size_range_m is None else found.size_range_m
    least, most = (extents(found.shape, size, found.stands) for size in (least, most))
    return np.maximum(least - truth, 0.0) + np.minimum(most - truth, 0.0)


def _mode(selector: ModeSelector, target: DetectedObject) -> str:
    answer = selector.select(target)
    return answer.mode if isinstance(answer, GraspChoice) else _REFUSED


def _yaw_error(thing: Thing, found: Detection) -> float:
    if thing.shape == "sphere" or found.shape == "sphere" or thing.kind in ("post", "can") or found.stands:
        return 0.0
    size = _truth_extents(thing)
    if size[1] < 1.3 * size[0]:
        return 0.0
    axis = thing.rotation.as_matrix()[:, 2 if thing.shape == "cylinder" else 1]
    truth = math.atan2(-axis[0], axis[1])
    return abs((found.yaw_rad - truth + 0.5 * math.pi) % math.pi - 0.5 * math.pi)


def summary(scores: Sequence[ImageScore], of: Callable[[ObjectScore], bool] = lambda _: True) -> dict[str, float]:
    """Return the figures of many images, over the objects that ``of`` takes: shares, and errors in mm and degrees.

    What is not defined, as errors where nothing was found, is left out.
    """
    objects = [item for image in scores for item in image.objects if of(item)]
    found = [item for item in objects if item.found]
    if not objects:
        return {"objects": 0}
    content = {
        "objects": len(objects),
        "recall": _share(objects, lambda item: item.found),
        "shape_right": _share(objects, lambda item: item.shape_right),
        "mode_right": _share(objects, lambda item: item.mode_right),
        "wrong_mode": _share(objects, lambda item: item.wrong_mode),
        "right": _share(objects, lambda item: item.right),
        "width_error_median_mm": _quantile([1e3 * item.width_error_m for item in found], 0.5),
        "width_error_p95_mm": _quantile([1e3 * item.width_error_m for item in found], 0.95),
        "size_error_median_mm": _quantile([1e3 * item.size_error_m for item in found], 0.5),
        "size_error_p95_mm": _quantile([1e3 * item.size_error_m for item in found], 0.95),
        "yaw_error_p95_deg": _quantile([math.degrees(item.yaw_error_rad) for item in found], 0.95),
        "false_alarms_per_image": sum(image.false_alarms for image in scores) / max(len(scores), 1),
    }
    return {name: value for name, value in content.items() if not math.isnan(value)}


def reliability(scores: Sequence[ImageScore], bins: int = 5) -> list[dict[str, float]]:
    """Return, for equal steps of confidence: how many, their mean confidence, and the share that is right."""
    pairs = [pair for image in scores for pair in image.calibration]
    rows = []
    for k in range(bins):
        low, high = k / bins, (k + 1) / bins
        inside = [(c, r) for c, r in pairs if low <= c < high or (k == bins - 1 and c == 1.0)]
        if inside:
            rows.append(
                {
                    "from": low,
                    "to": high,
                    "count": len(inside),
                    "confidence": float(np.mean([c for c, _ in inside])),
                    "right": float(np.mean([r for _, r in inside])),
                }
            )
    return rows


def calibration_error(rows: Sequence[Mapping[str, float]]) -> float:
    """Return the mean distance of confidence from the share that is right, weighted by how many."""
    total = sum(row["count"] for row in rows)
    return float(sum(row["count"] * abs(row["confidence"] - row["right"]) for row in rows) / max(total, 1))


def _share(objects: Sequence[ObjectScore], of: Callable[[ObjectScore], bool]) -> float:
    return sum(map(of, objects)) / max(len(objects), 1)


def _quantile(values: Sequence[float], share: float) -> float:
    return float(np.quantile(values, share)) if len(values) else math.nan
