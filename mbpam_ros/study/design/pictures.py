"""Pictures of the design study. matplotlib is needed only when one is drawn (extra ``study``)."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.study.design.comparison import Judged
from mbpam_ros.study.design.latin_hypercube import RANGES
from mbpam_ros.study.design.pareto import Front
from mbpam_ros.study.design.responses import Responses
from mbpam_ros.study.design.samples import RESPONSES, Samples
from mbpam_ros.study.design.uncertainty import UncertaintyMap
from mbpam_ros.study.pictures import new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_AXIS_LABELS = {"a_mm": "a [mm]", "b_mm": "b [mm]", "c_mm": "c [mm]", "n": "n"}
_RESPONSE_LABELS = {"theta_max": "greatest bend [deg]", "f_max": "blocked force [N]"}
_MARKERS = ("o", "s", "D", "^", "v")


def draw_sampling(points: NDArray[np.float64], names: tuple[str, ...], paper: NDArray[np.float64], path: Path) -> None:
    """Draw the sampled designs over each pair of variables, the paper's (a, b) beside them.

    Args:
        points: shape (n, variables), columns ``names``.
        paper: the paper's designs (a, b), shape (21, 2).
        path: where the picture goes; its suffix is the format.

    Raises:
        PictureError: matplotlib is not installed, or the file cannot be written.
    """
    pairs = list(itertools.combinations(range(len(names)), 2))
    columns = min(3, len(pairs))
    figure = new_figure(4.6 * columns, 4.4 * -(-len(pairs) // columns))
    for axis, (i, j) in zip(np.ravel(figure.subplots(-(-len(pairs) // columns), columns)), pairs, strict=True):
        axis.plot(points[:, i], points[:, j], "o", label=f"these {len(points)}")
        if (i, j) == (0, 1):
            axis.plot(*paper.T, "x", color="tab:red", label=f"the paper's {len(paper)}")
            axis.legend(loc="upper center", bbox_to_anchor=(0.5, 1.12), ncols=2, frameon=False)
        for set_label, set_limits, name in (
            (axis.set_xlabel, axis.set_xlim, names[i]),
            (axis.set_ylabel, axis.set_ylim, names[j]),
        ):
            low, high = RANGES[name]
            set_label(_AXIS_LABELS[name])
            set_limits(low - 0.04 * (high - low), high + 0.04 * (high - low))
        axis.grid(alpha=0.3)
    save_figure(figure, path)


def draw_comparison(table: Mapping[str, Mapping[str, Judged]], judging: Samples, path: Path) -> None:
    """Draw what each metamodel errs on each judging sample, and its error against its time.

    Raises:
        PictureError: matplotlib is not installed, or the file cannot be written.
    """
    figure = new_figure(15.0, 4.8)
    *errors, trade = figure.subplots(1, 3)
    for axis, key in zip(errors, RESPONSES, strict=True):
        expected = judging.responses[key]
        axis.axhline(0.0, color="black", lw=0.8)
        for marker, (name, judged) in zip(_MARKERS, table.items(), strict=False):
            axis.plot(expected, judged[key].predicted - expected, marker, label=name, alpha=0.8)
        axis.set_xlabel(f"{_RESPONSE_LABELS[key]}, judging samples")
        axis.set_ylabel(f"error of the prediction [{RESPONSES[key]}]")
        axis.grid(alpha=0.3)
    errors[0].legend(fontsize=8)
    for key, fill in zip(RESPONSES, ("full", "none"), strict=True):
        for index, (marker, (name, judged)) in enumerate(zip(_MARKERS, table.items(), strict=False)):
            trade.plot(
                1e3 * judged[key].speed.ten_thousand_evaluations_s,
                100.0 * judged[key].accuracy.rmse_normalised,
                marker,
                fillstyle=fill,
                color=f"C{index}",
                label=f"{name}, {key}",
            )
    trade.set_xlabel("time of 10 000 evaluations [ms]")
    trade.set_ylabel("RMSE over the range of the judging responses [%]")
    trade.set_xscale("log")
    trade.set_ylim(bottom=0.0)
    trade.legend(fontsize=7, ncols=2)
    trade.grid(alpha=0.3, which="both")
    save_figure(figure, path)


def draw_uncertainty(uncertainty: UncertaintyMap, samples: Samples, path: Path) -> None:
    """Draw kriging's deviation over the domain, and on each sample a disc as large as the error when it is left out.

    Raises:
        PictureError: matplotlib is not installed, or the file cannot be written.
    """
    figure = new_figure(13.0, 5.6)
    for axis, key in zip(figure.subplots(1, 2), RESPONSES, strict=True):
        shades = axis.contourf(uncertainty.a_mm, uncertainty.b_mm, uncertainty.sigma[key], 12, cmap="Blues")
        figure.colorbar(shades, ax=axis, label=f"kriging's standard deviation [{RESPONSES[key]}]")
        error = uncertainty.left_out_error[key]
        size = 400.0 * np.abs(error) / np.abs(error).max()
        for sign, colour in ((error >= 0.0, "tab:red"), (error < 0.0, "tab:green")):
            where = samples.design_mm[sign]
            axis.scatter(*where.T, s=size[sign], color=colour, alpha=0.55, clip_on=False, zorder=3)
        axis.plot(*samples.design_mm.T, "k.", ms=4.0, clip_on=False, zorder=4)
        rms, covers = float(np.sqrt(np.mean(error**2))), uncertainty.coverage[key].covers
        axis.set_title(
            f"{_RESPONSE_LABELS[key]}: left out, rms {rms:.3g}, worst {np.abs(error).max():.3g} {RESPONSES[key]}; "
            f"rms {uncertainty.coverage[key].rms_score:.1f} deviations{'' if covers else ', not covered'}\n"
            "discs: too much (red), too little (green)",
            fontsize=10,
            pad=12.0,
        )
        axis.set_xlabel(_AXIS_LABELS["a_mm"])
        axis.set_ylabel(_AXIS_LABELS["b_mm"])
    save_figure(figure, path)


def draw_optimisation(
    responses: Responses, truth: Front, fronts: Mapping[str, Front], result: Mapping, path: Path
) -> None:
    """Draw the fronts over the responses, and where their designs lie over the domain.

    Args:
        responses: what was optimised.
        truth: the dense grid's front.
        fronts: the algorithms' fronts by name.
        result: of ``mbpam optimise``: ``initial``, ``chosen`` and, for the paper's data, ``table_5``.
        path: where the picture goes; its suffix is the format.

    Raises:
        PictureError: matplotlib is not installed, or the file cannot be written.
    """
    figure = new_figure(14.0, 6.0)
    over_responses, over_design = figure.subplots(1, 2)
    _draw_domain(over_responses, over_design, responses)
    over_responses.plot(*truth.values.T, color="black", lw=1.0, label="front of the grid")
    for index, (name, front) in enumerate(fronts.items()):
        style = {"marker": ".x"[index % 2], "ls": "", "ms": 4.0, "color": f"C{index}", "label": name}
        thin = slice(index, None, 20)
        over_responses.plot(*front.values[thin].T, **style)
        over_design.plot(*front.design_mm[thin].T, **style)
    for row in result.get("table_5", []):
        label = "Table 5, paper's FE" if row is result["table_5"][0] else None
        over_responses.plot(row["theta_fe_deg"], row["f_fe_n"], "^", color="tab:green", label=label)
        over_design.plot(row["a_mm"], row["b_mm"], "^", color="tab:green", label=label)
    for key, marker in (("initial", "s"), ("chosen", "*")):
        point = result[key]
        if point is not None:
            style = {"marker": marker, "ms": 12.0 if key == "chosen" else 8.0, "ls": "", "mec": "black"}
            label = f"{key}: a = {point['a_mm']:.2f}, b = {point['b_mm']:.2f} mm"
            colour = "gold" if key == "chosen" else "tab:red"
            over_responses.plot(point["theta_deg"], point["f_n"], color=colour, label=label, **style)
            over_design.plot(point["a_mm"], point["b_mm"], color=colour, **style)
    over_responses.legend(fontsize=8, loc="lower left")
    over_responses.set_title(f"PDC at 100 kPa, metamodel {result['metamodel']}")
    save_figure(figure, path)


def _draw_domain(over_responses: Axes, over_design: Axes, responses: Responses) -> None:
    """Draw all designs of a coarse grid as a cloud of responses, and the responses as lines over the designs."""
    a, b = (np.linspace(low, high, 61) for low, high in (responses.domain.a_range_mm, responses.domain.b_range_mm))
    design = np.column_stack([axis.ravel() for axis in np.meshgrid(a, b)])
    values = responses.objectives(design)
    over_responses.plot(*values.T, ".", color="lightgrey", ms=2.0, zorder=0, label="designs of the domain")
    over_responses.set_xlabel(_RESPONSE_LABELS["theta_max"])
    over_responses.set_ylabel(_RESPONSE_LABELS["f_max"])
    over_responses.grid(alpha=0.3)
    for column, colour, line, unit in ((0, "tab:blue", "solid", "deg"), (1, "tab:red", "dashed", "N")):
        lines = over_design.contour(
            a,
            b,
            values[:, column].reshape(len(b), len(a)),
            9,
            colors=colour,
            linestyles=line,
            alpha=0.6,
            linewidths=0.9,
        )
        over_design.clabel(lines, fontsize=7, fmt=f"%g {unit}")
    over_design.set_xlabel(_AXIS_LABELS["a_mm"])
    over_design.set_ylabel(_AXIS_LABELS["b_mm"])
    over_design.set_title("bend (solid) and force (dashed) over the design")
