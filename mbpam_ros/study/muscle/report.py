"""One page of what is known of a muscle: drawing, samples, metamodels, front, chosen design; pictures within it."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mbpam_ros.actuator.built_muscle import BuiltMuscle
from mbpam_ros.study.pictures import PictureError, new_figure, save_figure
from mbpam_ros.study.result_file import write_text

_HEAD = """<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>
<style>body{{font:15px sans-serif;max-width:60em;margin:2em auto;padding:0 1em}}table{{border-collapse:collapse}}
td,th{{padding:.15em .6em;border-bottom:1px solid #ccc;text-align:right}}img{{max-width:100%}}</style>
<h1>{title}</h1>
"""


def write_report(
    path: Path,
    name: str,
    drawing: dict[str, Any],
    built: BuiltMuscle,
    rows: Sequence[dict[str, Any]],
    failures: dict[str, str],
    front: dict[str, Any] | None,
    monotony: dict[str, dict[str, float]],
) -> None:
    """Write the page; without matplotlib it has no pictures.

    Raises:
        ResultFileError: it cannot be written.
    """
    parts = [_HEAD.format(title=html.escape(f"Muscle {name}"))]
    parts.append(_table("Drawing", ("", "value"), list(drawing.items())))
    parts.append(
        f"<p>As drawn, two chambers at 100 kPa: {built.theta_max_deg:.1f} deg, {built.f_max_n:.3f} N; a bend is known "
        f"to {100 * built.bend_sigma:.1f} %.</p>"
    )
    if front is not None:
        parts.append(_front_text(front))
        picture = path.with_name("front.png")
        try:
            _draw_front(front, rows, picture)
            parts.append(_image(picture))
        except PictureError as error:
            parts.append(f"<p>{html.escape(str(error))}</p>")
        judged = [
            (way, metamodel, *(f"{of[key]['rmse_normalised']:.4f}" for key in of))
            for way, table in front["judged"].items()
            for metamodel, of in table.items()
        ]
        parts.append(
            _table("Metamodels, RMSE over the range", ("judged on", "metamodel", "theta_max", "f_max"), judged)
        )
    if monotony:
        ranks = [(variable, *(f"{value:+.2f}" for value in of.values())) for variable, of in monotony.items()]
        parts.append(_table("Rank correlations", ("", "theta_max", "f_max", "stretch of the wall"), ranks))
    head = ("design", "a mm", "b mm", "c mm", "n", "theta_max deg", "f_max N", "wall stretched to")
    cells = [
        (
            row["name"],
            *(f"{row[key]:g}" for key in ("a_mm", "b_mm", "c_mm", "n")),
            f"{row['theta_max_deg']:.1f}",
            f"{row['f_max_n']:.3f}",
            f"{row['stretch_max']:.2f}",
        )
        for row in rows
    ]
    parts.append(_table("Finite elements", head, cells))
    if failures:
        parts.append(_table("Left out", ("design", "why"), list(failures.items())))
    parts.append(_table("Made with", ("", ""), list(built.provenance.items())))
    write_text(path, "\n".join(parts) + "</html>\n")


def _front_text(front: dict[str, Any]) -> str:
    chosen = front["chosen"]
    offers = []
    for key, what in (
        ("gain_force_at_equal_angle_pct", "force at equal angle"),
        ("gain_angle_at_equal_force_pct", "angle at equal force"),
    ):
        value = front.get(key)
        offers.append(f"{what} {'beyond the front' if value is None else f'{value:+.1f} %'}")
    design = f"a {chosen['a_mm']:.3f}, b {chosen['b_mm']:.3f} mm, {chosen['theta_deg']:.1f} deg, {chosen['f_n']:.3f} N"
    return (
        f"<p>Best metamodel: {html.escape(front['metamodel'])}; the front over the drawing: {', '.join(offers)}. "
        f"Chosen by {html.escape(chosen['rule'])}: {design}.</p>"
    )


def _draw_front(front: dict[str, Any], rows: Sequence[dict[str, Any]], path: Path) -> None:
    figure = new_figure(6.5, 4.5)
    axis = figure.subplots()
    of = [row for row in rows if row["pattern"] == "pdc"]
    axis.plot([row["theta_max_deg"] for row in of], [row["f_max_n"] for row in of], "k.", label="finite elements")
    axis.plot([row[2] for row in front["pareto"]], [row[3] for row in front["pareto"]], "C3.", label="front")
    axis.plot(front["chosen"]["theta_deg"], front["chosen"]["f_n"], "C0s", label="chosen")
    axis.set(xlabel="theta_max [deg]", ylabel="f_max [N]")
    axis.legend()
    save_figure(figure, path)


def _image(path: Path) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    return f'<p><img alt="{html.escape(path.stem)}" src="data:image/png;base64,{data}"></p>'


def _table(title: str, head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    lines = [f"<h2>{html.escape(title)}</h2><table>"]
    lines.append("<tr>" + "".join(f"<th>{html.escape(cell)}</th>" for cell in head) + "</tr>")
    lines += ["<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows]
    return "\n".join([*lines, "</table>"])
