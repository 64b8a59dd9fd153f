"""Pictures of the finite element results, as PNG files. They need matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.study.fe.muscle_shape import MuscleShape
from mbpam_ros.study.pictures import new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PATTERN_COLOURS = {"pdc": "#1f77b4", "psc": "#d62728"}
PATTERN_NAMES = {"pdc": "two chambers (PDC)", "psc": "one chamber (PSC)"}
TABLE_STYLES = {
    "table_1": ("o", "#1f77b4", "Table 1"),
    "table_2": ("s", "#ff7f0e", "Table 2"),
    "table_5": ("D", "#2ca02c", "Table 5 (kept apart)"),
    "measured": ("*", "#d62728", "measured, PSC"),
}
LIGHT = np.array([0.35, -0.75, 0.56])  # toward the light, for a viewer who looks along +y
_DPI = 130


def draw_sections(shapes: Sequence[MuscleShape], path: Path) -> None:
    """Draw the cell's mesh on its crest and valley planes at rest and under pressure, one row a pattern."""
    figure = new_figure(13.0, 3.5 * len(shapes) + 0.4)
    axes = figure.subplots(len(shapes), 4, squeeze=False, sharex=True, sharey=True)
    for row, shape in zip(axes, shapes, strict=True):
        for column, (plane, moment) in enumerate((p, m) for p in ("crest", "valley") for m in (0, 1)):
            axis = row[column]
            moved = " at rest" if moment == 0 else f" at {shape.pressure_kpa:g} kPa"
            axis.set_title(plane + moved, fontsize=10)
            _draw_section(axis, shape.sections_mm[plane][moment], PATTERN_COLOURS[shape.pattern] if moment else None)
            _draw_circle(axis, float(np.linalg.norm(shape.sections_mm["crest"][0], axis=-1).max()))
            if moment:
                _mark_pressure(axis, shape)
        row[0].set_ylabel(f"{PATTERN_NAMES[shape.pattern]}\ny [mm]")
    for axis in axes[-1]:
        axis.set_xlabel("x in the bending plane [mm]")
    figure.suptitle("Sections of the unit cell at mid length (dotted: crest at rest); the muscle bends toward -x")
    save_figure(figure, path, _DPI)


def draw_muscles(series: Sequence[Sequence[MuscleShape]], path: Path) -> None:
    """Draw muscles from the side, one panel a pattern, each at several pressures, coloured by the skin's stretch."""
    from matplotlib import colormaps, colors
    from matplotlib.cm import ScalarMappable

    figure = new_figure(6.2 * len(series) + 0.8, 6.4)
    axes = figure.subplots(1, len(series), squeeze=False, sharey=True)[0]
    highest = max(np.quantile(shape.stretch, 0.999) for shapes in series for shape in shapes)
    scale = colors.Normalize(1.0, float(highest))
    colour_map = colormaps["viridis"]
    ends = np.concatenate([shape.ends_mm.reshape(-1, 3) for shapes in series for shape in shapes])
    span = [(ends[:, axis].min() - 16.0, ends[:, axis].max() + 16.0) for axis in (0, 2)]
    for axis, shapes in zip(axes, series, strict=True):
        for shape in shapes:
            _draw_muscle(axis, shape, colour_map(scale(shape.stretch)))
            place = shape.tip_mm + 9.0 * shape.tip_direction
            axis.annotate(
                f"{shape.pressure_kpa:g} kPa\n{shape.tip_angle_deg:.0f} deg",
                (place[0], place[2]),
                ha="center",
                va="center",
                fontsize=9,
            )
        axis.set_title(PATTERN_NAMES[shapes[0].pattern])
        axis.set_aspect("equal")
        axis.set_xlim(*span[0])
        axis.set_ylim(*span[1])
        axis.set_xlabel("x [mm]")
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("height over the clamp [mm]")
    figure.colorbar(
        ScalarMappable(scale, colour_map), ax=axes, label="largest principal stretch of the skin", shrink=0.8
    )
    figure.suptitle(
        "The muscle in the paper's posture: base down, weight on (unit cells chained; straight ends in grey)"
    )
    save_figure(figure, path, _DPI)


def draw_curves(curves: Sequence[dict], references: Sequence[tuple[str, float, float, str]], path: Path) -> None:
    """Draw bend against pressure.

    Args:
        curves: each with ``pattern``, ``p_kpa`` and ``theta_deg``.
        references: values to compare with: pattern, pressure [kPa], bend [deg], what it is.
    """
    figure = new_figure(7.5, 5.2)
    axis = figure.subplots()
    for curve in curves:
        colour, name = PATTERN_COLOURS[curve["pattern"]], PATTERN_NAMES[curve["pattern"]]
        axis.plot(curve["p_kpa"], curve["theta_deg"], "o-", color=colour, ms=3.5, label=name)
    markers = iter("x*+^v")
    for pattern, pressure_kpa, theta_deg, label in references:
        colour, label = PATTERN_COLOURS[pattern], f"{label}: {theta_deg:.0f} deg"
        axis.plot(pressure_kpa, theta_deg, next(markers), label=label, color=colour, linestyle="none", ms=10, mew=1.8)
    axis.set_xlabel("gauge pressure [kPa]")
    axis.set_ylabel("bend of the upright muscle [deg]")
    axis.set_title("Bend against pressure in the paper's posture")
    axis.set_xlim(left=0.0)
    axis.set_ylim(bottom=0.0)
    axis.grid(alpha=0.3)
    axis.legend(loc="upper left")
    save_figure(figure, path, _DPI)


def draw_parity(rows: Sequence[dict], errors: dict[str, dict[str, float]], path: Path) -> None:
    """Draw our bend and force against the paper's, with lines 5 % to either side.

    Args:
        rows: with ``source``, and ``theta_deg``, ``force_n`` of the paper and ``fe_theta_deg``, ``fe_force_n`` of ours.
        errors: of :func:`~mbpam_ros.study.fe.paper_comparison.error_summary`.
    """
    figure = new_figure(12.0, 5.8)
    panels = figure.subplots(1, 2)
    quantities = (("theta", "theta_deg", "bend at 100 kPa [deg]"), ("force", "force_n", "blocked force at 100 kPa [N]"))
    for axis, (quantity, column, name) in zip(panels, quantities, strict=True):
        paper = np.array([row[column] for row in rows])
        ours = np.array([row[f"fe_{column}"] for row in rows])
        tables = np.array([row["source"].split(":")[0] for row in rows])
        both = np.concatenate([paper, ours])
        margin = 0.06 * (both.max() - both.min()) + 1e-9
        ends = np.array([both.min() - margin, both.max() + margin])
        axis.plot(ends, ends, color="black", lw=1.0)
        axis.fill_between(ends, 0.95 * ends, 1.05 * ends, color="grey", alpha=0.2, lw=0.0, label="within 5 %")
        for table, (marker, colour, label) in TABLE_STYLES.items():
            here = tables == table
            if here.any():
                size = 13 if marker == "*" else 6
                axis.plot(paper[here], ours[here], marker, color=colour, ms=size, mec="white", mew=0.6, label=label)
        title = name
        if "tables_1_2" in errors:
            fit = errors["tables_1_2"]
            title += (
                f"\nTables 1, 2: {fit[f'{quantity}_rms_pct']:.1f} % rms, {fit[f'{quantity}_worst_pct']:+.1f} % worst"
            )
        axis.set_title(title, fontsize=11)
        axis.set_xlim(*ends)
        axis.set_ylim(*ends)
        axis.set_aspect("equal")
        axis.set_xlabel("paper")
        axis.set_ylabel("this finite element model")
        axis.grid(alpha=0.3)
        axis.legend(loc="upper left", fontsize=9)
    save_figure(figure, path, _DPI)


def draw_effects(designs: Sequence[dict], path: Path) -> None:
    """Draw bend and force at 100 kPa against each parameter, as figure 6 of the paper does.

    Args:
        designs: with ``parameter``, ``level``, ``theta_deg``, ``force_n`` (straight propped rod), ``blocked_force_n``
            (tip on a plate), and ``paper_theta_deg``, ``paper_force_n`` where the paper's tables hold that design,
            else None.
    """
    parameters = list(dict.fromkeys(design["parameter"] for design in designs))
    figure = new_figure(3.3 * len(parameters), 6.4)
    panels = figure.subplots(2, len(parameters), squeeze=False, sharey="row", sharex="col")
    for column, parameter in enumerate(parameters):
        members = sorted((d for d in designs if d["parameter"] == parameter), key=lambda d: d["level"])
        levels = [member["level"] for member in members]
        for row, (key, known_key) in enumerate(
            (("theta_deg", "paper_theta_deg"), ("blocked_force_n", "paper_force_n"))
        ):
            axis = panels[row, column]
            axis.plot(levels, [member[key] for member in members], "o-", color="#1f77b4", label="this model")
            known = [(m["level"], m[known_key]) for m in members if m[known_key] is not None]
            if known:
                axis.plot(*zip(*known, strict=True), "s--", color="#ff7f0e", mfc="none", label="paper (tables)")
            axis.grid(alpha=0.3)
        propped = [member["force_n"] for member in members]
        panels[1, column].plot(levels, propped, "x:", color="#7f7f7f", label="straight propped rod")
        panels[1, column].set_xlabel(f"{parameter} [mm]" if parameter != "n" else "n (waves)")
        panels[1, column].set_xticks(levels)
    panels[0, 0].legend(fontsize=9)
    panels[1, 0].legend(fontsize=9)
    panels[0, 0].set_ylabel("bend at 100 kPa [deg]")
    panels[1, 0].set_ylabel("blocked force at 100 kPa [N]")
    for axis in panels.ravel():
        axis.set_ylim(bottom=0.0)
    figure.suptitle("Effect of each parameter, two chambers, the others at the initial design")
    save_figure(figure, path, _DPI)


def draw_ablations(variants: Sequence[dict], path: Path) -> None:
    """Draw the error of each variant.

    Args:
        variants: with ``name``, ``points``, ``theta_rms_pct``, ``theta_mean_pct``, ``force_rms_pct``.
    """
    figure = new_figure(10.0, 0.42 * len(variants) + 1.6)
    axis = figure.subplots()
    place = np.arange(len(variants))[::-1]
    axis.barh(place + 0.2, [v["theta_rms_pct"] for v in variants], 0.38, color="#1f77b4", label="bend, rms")
    axis.barh(place - 0.2, [v["force_rms_pct"] for v in variants], 0.38, color="#ff7f0e", label="force, rms")
    means = [v["theta_mean_pct"] for v in variants]
    axis.plot(means, place + 0.2, "D", ms=6, color="black", mec="white", label="bend, mean error")
    axis.axvline(0.0, color="black", lw=0.8)
    most = max(v["points"] for v in variants)
    names = [v["name"] + (f" ({v['points']} of {most} points)" if v["points"] < most else "") for v in variants]
    axis.set_yticks(place, names)
    axis.set_xlabel("error against the paper's finite elements [%]")
    axis.set_title("What each choice does to the error at 100 kPa")
    axis.grid(axis="x", alpha=0.3)
    axis.legend(fontsize=9)
    save_figure(figure, path, _DPI)


def _draw_section(axis: Axes, faces: NDArray[np.float64], colour: str | None) -> None:
    from matplotlib.collections import PolyCollection

    face_colour = (colour, 0.45) if colour else "0.85"
    axis.add_collection(
        PolyCollection(list(faces), facecolors=[face_colour], edgecolors="0.25", linewidths=0.4, snap=False)
    )
    axis.set_aspect("equal")
    axis.autoscale_view()


def _draw_circle(axis: Axes, radius_mm: float) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    axis.plot(radius_mm * np.cos(angle), radius_mm * np.sin(angle), color="0.6", lw=0.6, ls=":")


def _mark_pressure(axis: Axes, shape: MuscleShape) -> None:
    for azimuth in (45.0, -45.0) if shape.pattern == "pdc" else (0.0,):
        angle = np.radians(azimuth)
        place = 4.6 * np.cos(angle), 4.6 * np.sin(angle)
        axis.annotate("p", place, ha="center", va="center", fontsize=11, fontweight="bold")


def _draw_muscle(axis: Axes, shape: MuscleShape, skin: NDArray[np.float64]) -> None:
    """Quadrilaterals from the farthest to the nearest, lit from the upper right, seen along +y."""
    from matplotlib.collections import PolyCollection

    quads = np.concatenate([shape.surface_mm, shape.ends_mm])
    colours = np.concatenate([skin, np.tile((0.6, 0.6, 0.6, 1.0), (len(shape.ends_mm), 1))])
    normal = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True) + 1e-12
    normal *= -np.sign(normal[:, 1:2] + 1e-12)  # toward the viewer, however the quadrilateral is numbered
    colours[:, :3] *= (0.55 + 0.45 * np.clip(normal @ LIGHT, 0.0, 1.0))[:, None]
    order = np.argsort(-quads[:, :, 1].mean(axis=1))
    collection = PolyCollection(list(quads[order][:, :, [0, 2]]), facecolors=colours[order], edgecolors="face", lw=0.2)
    collection.set_zorder(2.0 + 1e-3 * shape.pressure_kpa)
    axis.add_collection(collection)
