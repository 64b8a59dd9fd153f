"""The picture of one grasp: what the camera saw, what the fingers did, and what the air did."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from mbpam_ros.study.pictures import new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch


@dataclass
class GraspRecord:
    """What was seen of one grasp, in the order it came. Times in seconds from the start of the record.

    Args:
        title: object, mode and outcome.
        overlay_jpeg: camera image with the detection, or empty.
        pressure_time_s, pressure_gauge_pa: rows of (16,) measured pressures.
        bend_time_s, bend_rad: rows of (8,) estimated bends.
        object_time_s, object_rise_m: true rise of the object.
        palm_rise_m: rise of the palm at the same times.
        shapes: named snapshots of the true finger centre lines (4, n, 3) and the object's centre (3,), in world [m].
        object_size_m: (3,), as in visualization_msgs/Marker.
        object_shape: sphere, cylinder or box.
        events: names of what happened, and when.
    """

    title: str = ""
    overlay_jpeg: bytes = b""
    pressure_time_s: list[float] = field(default_factory=list)
    pressure_gauge_pa: list[NDArray[np.float64]] = field(default_factory=list)
    bend_time_s: list[float] = field(default_factory=list)
    bend_rad: list[NDArray[np.float64]] = field(default_factory=list)
    object_time_s: list[float] = field(default_factory=list)
    object_rise_m: list[float] = field(default_factory=list)
    palm_rise_m: list[float] = field(default_factory=list)
    shapes: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]] = field(default_factory=dict)
    object_size_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    object_shape: str = ""
    events: dict[str, float] = field(default_factory=dict)


FINGER_COLOURS = ("#1f77b4", "#d62728", "#2ca02c", "#9467bd")
CHAMBER_STYLES = ("-", "--", "-.", ":")
INFLATED_PA = 2000.0
VIEW_HALF_WIDTH_MM = 130.0


def draw_report(record: GraspRecord, path: Path) -> None:
    """Write the picture report of one grasp as a PNG.

    Raises:
        PictureError: matplotlib is not installed, or the file cannot be written.
    """
    figure = new_figure(14.0, 9.0)
    figure.suptitle(record.title, fontsize=14, fontweight="bold")
    (above,), (below,) = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.25, 1.0))
    overlay, front, side = above.subplots(1, 3, width_ratios=(1.5, 1.0, 1.0))
    _draw_overlay(overlay, record)
    _draw_shapes(front, record, horizontal=0, title="Front (XZ)")
    _draw_shapes(side, record, horizontal=1, title="Side (YZ)")
    over_time = below.subplots(1, 3)
    _draw_pressures(over_time[0], record)
    _draw_bends(over_time[1], record)
    _draw_rise(over_time[2], record)
    for axis in over_time:
        _mark_events(axis, record)
        axis.set_xlabel("time [s]")
        axis.grid(alpha=0.3)
    save_figure(figure, path)


def _draw_overlay(axis: Axes, record: GraspRecord) -> None:
    axis.set_title("Camera and detection")
    axis.set_axis_off()
    if record.overlay_jpeg:
        image = cv2.imdecode(np.frombuffer(record.overlay_jpeg, np.uint8), cv2.IMREAD_COLOR)
        if image is not None:
            axis.imshow(image[:, :, ::-1])


def _draw_shapes(axis: Axes, record: GraspRecord, horizontal: int, title: str) -> None:
    """Fingers before (pale) and after the lift, object in outline; millimetres, up is up.

    Lines are thinner than the muscles, so that all four can be seen.
    """
    for (name, (lines, centre)), alpha in zip(record.shapes.items(), (0.25, 1.0), strict=False):
        for finger, line in enumerate(lines):
            label = f"finger {finger + 1}" if alpha == 1.0 else None
            colour = FINGER_COLOURS[finger]
            width = 6.0 if alpha == 1.0 else 3.0
            axis.plot(1e3 * line[:, horizontal], 1e3 * line[:, 2], color=colour, alpha=alpha, lw=width, label=label)
            axis.plot(1e3 * line[0, horizontal], 1e3 * line[0, 2], "k_", alpha=alpha)
        half = 0.5e3 * _extent(record, horizontal), 0.5e3 * _extent(record, 2)
        _draw_object(axis, record, (1e3 * centre[horizontal], 1e3 * centre[2]), half, horizontal, alpha, name)
    axis.set_aspect("equal")
    axis.set_xlim(-VIEW_HALF_WIDTH_MM, VIEW_HALF_WIDTH_MM)
    axis.set_title(title)
    axis.set_xlabel("xyz"[horizontal] + " [mm]")
    axis.set_ylabel("height over the palm's start [mm]")
    axis.legend(fontsize=7, loc="upper right")
    axis.grid(alpha=0.3)


def _extent(record: GraspRecord, axis: int) -> float:
    """Extent of the object along a gripper axis at its start; a cylinder lies along y."""
    if record.object_shape == "cylinder":
        return record.object_size_m[2] if axis == 1 else record.object_size_m[0]
    return record.object_size_m[axis]


def _draw_object(
    axis: Axes,
    record: GraspRecord,
    centre_mm: tuple[float, float],
    half_mm: tuple[float, float],
    horizontal: int,
    alpha: float,
    name: str,
) -> None:
    from matplotlib.patches import Ellipse, Rectangle

    round_outline = record.object_shape == "sphere" or (record.object_shape == "cylinder" and horizontal == 0)
    patch: Patch
    if round_outline:
        patch = Ellipse(centre_mm, 2.0 * half_mm[0], 2.0 * half_mm[1])
    else:
        corner = (centre_mm[0] - half_mm[0], centre_mm[1] - half_mm[1])
        patch = Rectangle(corner, 2.0 * half_mm[0], 2.0 * half_mm[1])
    patch.set(facecolor="orange", edgecolor="saddlebrown", alpha=0.25 + 0.35 * alpha, lw=1.0)
    axis.add_patch(patch)
    axis.annotate(name, centre_mm, ha="center", va="center", fontsize=7)


def _draw_pressures(axis: Axes, record: GraspRecord) -> None:
    axis.set_title("Measured pressures of the inflated chambers")
    axis.set_ylabel("gauge pressure [kPa]")
    pressure = np.array(record.pressure_gauge_pa).reshape(-1, 16)
    for channel in range(pressure.shape[1]):
        if np.nanmax(pressure[:, channel], initial=0.0) > INFLATED_PA:
            finger, chamber = divmod(channel, 4)
            axis.plot(
                record.pressure_time_s,
                1e-3 * pressure[:, channel],
                CHAMBER_STYLES[chamber],
                color=FINGER_COLOURS[finger],
                lw=1.2,
                label=f"f{finger + 1} c{chamber + 1}",
            )
    if axis.lines:
        axis.legend(fontsize=7, ncols=2)


def _draw_bends(axis: Axes, record: GraspRecord) -> None:
    axis.set_title("Estimated free bend (from pressures)")
    axis.set_ylabel("bend angle [deg]")
    bend = np.array(record.bend_rad).reshape(-1, 4, 2)
    for finger in range(4):
        angle = np.degrees(np.hypot(bend[:, finger, 0], bend[:, finger, 1]))
        axis.plot(record.bend_time_s, angle, color=FINGER_COLOURS[finger], lw=1.2, label=f"finger {finger + 1}")
    axis.legend(fontsize=7)


def _draw_rise(axis: Axes, record: GraspRecord) -> None:
    axis.set_title("True rise of hand and object")
    axis.set_ylabel("rise [mm]")
    axis.plot(record.object_time_s, 1e3 * np.array(record.palm_rise_m), "k--", lw=1.2, label="hand")
    axis.plot(record.object_time_s, 1e3 * np.array(record.object_rise_m), color="darkorange", lw=1.8, label="object")
    axis.legend(fontsize=7)


def _mark_events(axis: Axes, record: GraspRecord) -> None:
    # Alternating heights keep the names of events that follow each other closely apart.
    for (name, time_s), height in zip(record.events.items(), itertools.cycle((0.35, 0.65)), strict=False):
        axis.axvline(time_s, color="grey", lw=0.7, ls=":")
        axis.annotate(
            name,
            (time_s, height),
            xycoords=("data", "axes fraction"),
            rotation=90,
            va="center",
            ha="right",
            fontsize=7,
            color="dimgrey",
        )
