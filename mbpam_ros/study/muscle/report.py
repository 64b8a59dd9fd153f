"""One page of what is known of a muscle: drawing, samples, metamodels, front, chosen design; pictures within it."""

from __future__ import annotations

import base64
import html
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mbpam_ros.actuator.built_muscle import BuiltMuscle
from mbpam_ros.study.muscle.findings import Findings
from mbpam_ros.study.pictures import PictureError, new_figure, save_figure
from mbpam_ros.study.result_file import write_text

_HEAD = """<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title>
<style>body{{font:15px sans-serif;max-width:60em;margin:2em auto;padding:0 1em}}table{{border-collapse:collapse}}
td,th{{padding:.15em .6em;border-bottom:1px solid #ccc;text-align:right}}img{{max-width:100%}}</style>
<h1>{title}</h1>
"""


def write_report(path: Path, name: str, drawing: dict[str, Any], built: BuiltMuscle, found: Findings) -> None:
    """Write the page; without matplotlib it has no pictures.

    Raises:
        ResultFileError: it cannot be written.
    """
    rows, front = found.rows, found.front
    parts = [_HEAD.format(title=html.escape(f"Muscle {name}"))]
    parts.append(_table("Drawing", ("", "value"), list(drawing.items())))
    parts += [f"<p>{html.escape(line)}.</p>" for line in found.lines(built)]
    parts.append(f"<p>A bend is known to {100 * built.bend_sigma:.1f} %.</p>")
    if front is not None:
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
        parts.append(_table("Designs of the front by finite elements", *_cells(front["finite_elements"]["designs"])))
    if found.alone is not None:
        parts.append(_table("Each variable alone", *_cells(found.alone["rows"])))
    parts.append(_table("Finite elements", *_cells(rows)))
    if found.failures:
        parts.append(_table("Left out", ("design", "why"), list(found.failures.items())))
    parts.append(_table("Made with", ("", ""), list(built.provenance.items())))
    write_text(path, "\n".join(parts) + "</html>\n")


def _cells(rows: Sequence[dict[str, Any]]) -> tuple[Sequence[str], Sequence[Sequence[object]]]:
    """Head and cells of a table of finite elements."""
    head = (
        *("design", "a mm", "b mm", "c mm", "n", "theta_max deg", "f_max N"),
        *("stretch", "of 99 %", "stress MPa", "of 99 %"),
    )
    formats = {"theta_max_deg": ".1f", "f_max_n": ".3f"}
    told = {**formats, **dict.fromkeys(("stretch_max", "stretch_99", "stress_max_mpa", "stress_99_mpa"), ".2f")}
    return head, [
        (
            row["name"],
            *(f"{row[key]:g}" for key in ("a_mm", "b_mm", "c_mm", "n")),
            *(format(row[key], spec) for key, spec in told.items()),
        )
        for row in rows
    ]


def _draw_front(front: dict[str, Any], rows: Sequence[dict[str, Any]], path: Path) -> None:
    figure = new_figure(6.5, 4.5)
    axis = figure.subplots()
    of = [row for row in rows if row["pattern"] == "pdc"]
    axis.plot([row["theta_max_deg"] for row in of], [row["f_max_n"] for row in of], "k.", label="finite elements")
    axis.plot([row[2] for row in front["pareto"]], [row[3] for row in front["pareto"]], "C3.", label="front")
    checked = front["finite_elements"]["designs"]
    axis.plot(
        [row["theta_max_deg"] for row in checked], [row["f_max_n"] for row in checked], "C3o", mfc="none",
        label="its designs by finite elements",
    )  # fmt: skip
    if front["paper"] is not None:
        published = front["paper"]["front"]
        axis.plot([row[2] for row in published], [row[3] for row in published], "C2-", label="the paper's front")
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
