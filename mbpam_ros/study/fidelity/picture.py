"""The Pareto plot of the trade: error against CPU time. matplotlib is needed only when it is drawn (``study``)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mbpam_ros.actuator.strains import STRAINS
from mbpam_ros.plant.fidelity import Measured, ModelError
from mbpam_ros.plant.planner import AIR_CASES
from mbpam_ros.study.pictures import new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ERRORS = (("static_error_pct", "static_pct", "at rest"), ("transient_error_pct", "transient_pct", "in motion"))
_COLOURS = {
    ("static", 1): "#7f7f7f",
    ("arc", 1): "#ff7f0e",
    ("rod", 2): "#9ecae1",
    ("rod", 3): "#4292c6",
    ("rod", 4): "#08519c",
    ("rod", 5): "#041f4a",
}
_EDGES = {("bend",): "#7f7f7f", ("bend", "stretch"): "#2ca02c", ("bend", "twist"): "#9467bd", STRAINS: "#d62728"}
"""Of markers, and colours of the models' errors, by strains."""
_MARKERS = {"ideal": "^", "lag": "s", "iso6358": "o"}
_FINEST_S, _SMALLEST_PT2 = 0.0005, 14.0
_CPU_TICKS = (10, 20, 30, 50, 100, 200, 300, 500, 1000)


def pareto_front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points (cost, error) that no other one betters in both, by rising cost."""
    front: list[tuple[float, float]] = []
    for cost, error in sorted(points):
        if not front or error < front[-1][1]:
            front.append((cost, error))
    return front


def draw_trade(
    rows: Sequence[Measured],
    reference: Mapping[str, Mapping[str, float]],
    models: Sequence[ModelError],
    path: Path,
) -> None:
    """Draw error at rest (above) and in motion (below) against CPU time, a column for each case.

    Args:
        rows: of the table.
        reference: how far the reference of each case is converged; drawn as the dashed line below which an error means
            nothing.
        models: how far the rods' equations are off the finite elements; drawn as dotted lines.
        path: where the picture goes; its suffix is the format.

    Raises:
        PictureError: matplotlib is not installed, or the file cannot be written.
    """
    scenes = list(dict.fromkeys(row.scene for row in rows))
    figure = new_figure(max(3.0 * len(scenes), 12.0), 8.0)
    from matplotlib.lines import Line2D

    panels = figure.subplots(2, len(scenes), sharey="row", squeeze=False)
    for panel_row, (key, check, when) in zip(panels, _ERRORS, strict=True):
        for axis, scene in zip(panel_row, scenes, strict=True):
            _draw_panel(axis, [row for row in rows if row.scene == scene], key, reference.get(scene, {}).get(check))
            for model in models:
                error_pct = model.free_pct if scene in AIR_CASES else model.loaded_pct
                axis.axhline(error_pct, color=_EDGES[model.strains], ls=":", lw=1.5)
            axis.set_title(f"{scene}, {when}", fontsize=10)
            axis.set_xlabel("CPU [ms per simulated s]")
        panel_row[0].set_ylabel("error [% of active length]")
    handles = [
        Line2D([], [], color=colour, marker="o", ls="", label=name if name != "rod" else f"rod, {modes} modes")
        for (name, modes), colour in _COLOURS.items()
    ]
    handles += [Line2D([], [], color="k", marker=mark, ls="", label=name) for name, mark in _MARKERS.items()]
    handles += [
        Line2D([], [], color="crimson", label="nothing is both cheaper and nearer"),
        Line2D([], [], color="k", ls="--", lw=0.8, label="the reference's own convergence"),
        Line2D([], [], color="none", label="larger markers: longer steps"),
    ]
    handles += [
        Line2D([], [], color=_EDGES[model.strains], ls=":", label=f"the model's error: {', '.join(model.strains)}")
        for model in models
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=6, frameon=False)
    save_figure(figure, path, dpi=90)


def _draw_panel(axis: Axes, rows: Sequence[Measured], key: str, converged_pct: float | None) -> None:
    from matplotlib.ticker import FixedLocator, NullLocator

    for row in rows:
        axis.scatter(
            row.cpu_ms_per_s,
            getattr(row, key),
            s=_SMALLEST_PT2 * (row.step_s / _FINEST_S) ** 0.6,
            color=_COLOURS[row.tier, row.modes],
            marker=_MARKERS[row.pneumatics],
            alpha=0.75,
            edgecolors=_EDGES[row.fidelity.strains],
            linewidths=0.8 if len(row.fidelity.strains) > 1 else 0.0,
        )
    front = pareto_front([(row.cpu_ms_per_s, getattr(row, key)) for row in rows])
    axis.step(*zip(*front, strict=True), where="post", color="crimson", lw=1.2, zorder=0)
    if converged_pct is not None:
        axis.axhline(converged_pct, color="k", ls="--", lw=0.8)
    axis.set_xscale("log")
    axis.set_yscale("log")
    axis.xaxis.set_major_locator(FixedLocator(_CPU_TICKS))
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_locator(NullLocator())
    axis.grid(alpha=0.3, which="both")
