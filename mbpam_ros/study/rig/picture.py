"""Picture of measured curves, as the paper's Fig. 5: bend and force over pressure, up and down, beside the model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.rod_law import RodLaw
from mbpam_ros.study.pictures import new_figure, save_figure
from mbpam_ros.study.rig.curves import CurvePoint
from mbpam_ros.study.rig.fit import predicted
from mbpam_ros.study.rig.procedure import BEND, DOWN, FORCE, UP

_AXES = (("pdc", BEND), ("psc", BEND), ("pdc", FORCE), ("psc", FORCE))
_LABELS = {BEND: "bending angle [deg]", FORCE: "output force [N]"}
_NAMES = {"pdc": "two chambers (PDC)", "psc": "one chamber (PSC)"}


def draw_curves(
    points: Sequence[CurvePoint],
    models: dict[str, tuple[RodLaw, float]],
    geometry: MuscleGeometry,
    path: Path,
) -> None:
    """Draw curves with their spread, and models beside them.

    Args:
        points: curves of the rig.
        models: law of the uniform rod and half width of its hysteresis [Pa], by what they are called.
        geometry: of that rod.
        path: of the picture; its suffix is the format.

    Raises:
        PictureError: matplotlib is not installed, or the file cannot be written.
        RodSolutionError: a model's rod has no equilibrium.
    """
    figure = new_figure(9.0, 7.0)
    for axis, (pattern, quantity) in zip(figure.subplots(2, 2).ravel(), _AXES, strict=True):
        own = [point for point in points if (point.pattern, point.quantity) == (pattern, quantity)]
        for branch, colour in ((UP, "C3"), (DOWN, "C0")):
            of = [point for point in own if point.branch == branch]
            if of:
                x, y, spread = np.array([(point.pressure_kpa, point.mean, point.spread) for point in of]).T
                axis.errorbar(x, y, spread, fmt="o", color=colour, markersize=3, capsize=2, label=f"measured, {branch}")
        for (name, (law, hysteresis_pa)), style in zip(models.items(), ("k-", "k--", "k:"), strict=False):
            if own:
                up = [point for point in own if point.branch == UP]
                axis.plot(
                    [point.pressure_kpa for point in up],
                    predicted(law, geometry, own, hysteresis_pa)[[own.index(point) for point in up]],
                    style,
                    linewidth=1.0,
                    label=f"{name}, up",
                )
        axis.set(title=_NAMES[pattern], xlabel="pressure [kPa]", ylabel=_LABELS[quantity])
        if own:
            axis.legend(fontsize="small")
    save_figure(figure, path)
