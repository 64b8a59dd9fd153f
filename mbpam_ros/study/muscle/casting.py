"""The casting guide that goes with the moulds: what to print, to mix and to do, in the order of the paper's Fig. 2."""

from __future__ import annotations

import base64
import html
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.drawing import MuscleDrawing
from mbpam_ros.study.muscle.moulds import WASTE, Moulds
from mbpam_ros.study.pictures import PictureError, new_figure, save_figure
from mbpam_ros.study.result_file import write_text

if TYPE_CHECKING:
    from manifold3d import Manifold

_GRAIN_MM = 0.6

STEPS = (
    "Print A and B twice if two halves are to cure at once, C and D once; layers of 0.1 mm, no more than 0.1 mm off. "
    "Measure the cores and the depth of the tray before you cast: they are the walls.",
    "Mix the two components 1 : 1 by weight, {a:.1f} g of A and {b:.1f} g of B for one muscle ({waste:.0f} % waste "
    "included), and leave the mixture in a vacuum for 3 to 5 min.",
    "Step 1: bolt B onto A, pour through one hole of B until silicone stands in the other, and let it cure for three "
    "hours. Take B off; the half stays in A. Cast the second half likewise and take it out of its A.",
    "Step 2: fill the tray C to its rim ({layer:.2f} mm) with uncured silicone, turn A with its half onto it, pins in "
    "their holes, and let it cure. Lift A off: its half is sealed, and still in A.",
    "Step 3: lay the second, unsealed half into D, brush uncured silicone onto its face until it is level with D's "
    "rim, bolt D onto A, and let it cure. Take D off, then the muscle out of A.",
    "Pierce the base into each of the four chambers, cement tubes of 2 to 3 mm in, and test each under water at 20 "
    "kPa.",
)


def write_guide(path: Path, name: str, drawing: MuscleDrawing, moulds: Moulds) -> None:
    """Write the guide as a page; without matplotlib it has no pictures.

    Raises:
        ResultFileError: it cannot be written.
    """
    said = {"a": moulds.grams_a, "b": moulds.grams_b, "waste": 100.0 * WASTE, "layer": moulds.layer_mm}
    title = html.escape(f"Casting the muscle {name}")
    lines = [f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><h1>{title}</h1>']
    lines.append(
        f"<p>a {drawing.a_mm:g}, b {drawing.b_mm:g}, c {drawing.c_mm:g} mm, {drawing.wave_count:g} waves; "
        f"{1e-3 * moulds.cast_mm3:.1f} cm3 of silicone; thinnest silicone {moulds.thinnest_wall_mm:.2f} mm, thinnest "
        f"printed part {moulds.thinnest_mould_mm:.2f} mm.</p><ol>"
    )
    lines += [f"<li>{html.escape(step.format(**said))}</li>" for step in STEPS]
    lines.append("</ol>")
    picture = path.with_name("parts.png")
    try:
        _draw(moulds.parts, picture)
        data = base64.b64encode(picture.read_bytes()).decode()
        lines.append(f'<p><img alt="parts" style="max-width:100%" src="data:image/png;base64,{data}"></p>')
    except PictureError as error:
        lines.append(f"<p>{html.escape(str(error))}</p>")
    write_text(path, "\n".join(lines) + "</html>\n")


def _draw(parts: dict[str, Manifold], path: Path) -> None:
    figure = new_figure(11.0, 4.0)
    for place, (name, solid) in enumerate(parts.items(), 1):
        axis = figure.add_subplot(1, len(parts), place)
        axis.imshow(_seen(solid, -1.0 if name == "A" else 1.0), cmap="gray", vmin=0.0, vmax=1.0, origin="lower")
        axis.set_title(name)
        axis.set_axis_off()
    save_figure(figure, path)


def _seen(solid: Manifold, side: float) -> NDArray[np.float64]:
    """A shaded picture of a solid, seen aslant from the side of +y or -y: its triangles, the nearest on top."""
    mesh = solid.refine_to_length(_GRAIN_MM).to_mesh()
    corners = np.asarray(mesh.vert_properties, dtype=float)[:, :3][np.asarray(mesh.tri_verts, dtype=np.int64)]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    middle = corners.mean(axis=1)
    toward = np.array([0.45, 0.8 * side, 0.4])
    toward /= np.linalg.norm(toward)
    right = np.cross((0.0, 0.0, 1.0), toward)
    right /= np.linalg.norm(right)
    up = np.cross(toward, right)
    facing = normal @ toward > 0.0
    middle, shade = middle[facing], 0.25 + 0.7 * np.abs(normal[facing] @ (0.5 * toward + 0.6 * up - 0.6 * right))
    pixels = (np.stack([middle @ up, middle @ right], axis=1) / _GRAIN_MM).round().astype(int)
    pixels -= pixels.min(axis=0)
    picture = np.ones(pixels.max(axis=0) + 2)
    for index in np.array_split(np.argsort(middle @ toward), 200):  # from the farthest on
        for down, across in ((0, 0), (0, 1), (1, 0), (1, 1)):
            picture[pixels[index, 0] + down, pixels[index, 1] + across] = shade[index]
    return picture
