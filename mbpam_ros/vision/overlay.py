"""What the detector saw, drawn over the image for people."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from mbpam_ros.vision.detector import Detection, ImageError

_COLOUR_BGR = {"sphere": (80, 220, 120), "cylinder": (255, 190, 60), "box": (90, 170, 255)}
_INK_BGR = (20, 20, 20)
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_FINE_BITS = 4  # drawing coordinates in sixteenths of a pixel


def draw_overlay(image: NDArray[np.uint8], encoding: str, detections: Iterable[Detection]) -> NDArray[np.uint8]:
    """Return a copy of ``image`` as bgr8, (H, W, 3), with outline, label, size and confidence of each detection.

    Args:
        image: the image that was given to the detector.
        encoding: rgb8, bgr8 or mono8.

    Raises:
        ImageError: unknown encoding.
    """
    if encoding == "mono8":
        canvas = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    elif encoding == "rgb8":
        canvas = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    elif encoding == "bgr8":
        canvas = image.copy()
    else:
        raise ImageError(f"encoding {encoding!r} is not one of rgb8, bgr8, mono8")
    drawing = canvas.astype(np.uint8, copy=False)
    detections = list(detections)
    for detection in detections:
        _draw_outline(drawing, detection)
    for detection in detections:
        _draw_caption(drawing, detection)
    return drawing


def describe_size(detection: Detection) -> str:
    """Size in millimetres the way people write it: a ball's and a rod's diameter first, a box as w x l x h."""
    first, second, third = 1000.0 * detection.size_m
    if detection.shape == "sphere":
        return f"d {first:.0f} mm"
    if detection.shape == "cylinder":
        return f"d {first:.0f} x {third:.0f} mm"
    return f"{first:.0f} x {second:.0f} x {third:.0f} mm"


def _draw_outline(canvas: NDArray[np.uint8], detection: Detection) -> None:
    corners = np.round(detection.contour_px * 2**_FINE_BITS).astype(np.int32)
    glow = canvas.copy()
    cv2.fillPoly(glow, [corners], _COLOUR_BGR[detection.shape], cv2.LINE_AA, _FINE_BITS)
    cv2.addWeighted(glow, 0.18, canvas, 0.82, 0.0, dst=canvas)
    cv2.polylines(canvas, [corners], True, _COLOUR_BGR[detection.shape], 2, cv2.LINE_AA, _FINE_BITS)


def _draw_caption(canvas: NDArray[np.uint8], detection: Detection) -> None:
    height, width = canvas.shape[:2]
    lines = [f"{detection.label}  {detection.confidence:.0%}", describe_size(detection)]
    scale = max(width / 640.0, 0.4) * 0.55
    extents = [cv2.getTextSize(line, _FONT, scale, 1)[0] for line in lines]
    line_height = int(1.7 * max(extent[1] for extent in extents))
    box_width, box_height = max(extent[0] for extent in extents) + 12, line_height * len(lines) + 8
    middle, bottom = detection.contour_px.mean(axis=0)[0], detection.contour_px[:, 1].max()
    left = int(np.clip(middle - 0.5 * box_width, 0, max(width - box_width, 0)))
    top = int(np.clip(bottom + 8, 0, max(height - box_height, 0)))
    colour = _COLOUR_BGR[detection.shape]
    cv2.rectangle(canvas, (left, top), (left + box_width, top + box_height), _INK_BGR, -1)
    cv2.rectangle(canvas, (left, top), (left + box_width, top + box_height), colour, 1)
    for i, line in enumerate(lines):
        origin = (left + 6, top + (i + 1) * line_height - int(0.15 * line_height))
        cv2.putText(canvas, line, origin, _FONT, scale, colour, 1, cv2.LINE_AA)
