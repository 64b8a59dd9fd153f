"""Moulds A to D to print and cast a drawn muscle in, after the paper's Fig. 2, with a casting guide.

    mbpam muscle moulds paper --out DIR            A.stl to D.stl, muscle.stl, casting.html
    mbpam muscle moulds paper --out DIR --3mf      3MF as well

They need the extra "cad". Every solid is checked to be closed; what cannot be printed or cast is refused with a reason.
"""

from __future__ import annotations

import argparse

from mbpam_ros.actuator.drawing import load_drawing
from mbpam_ros.commands.result_arguments import result_folder
from mbpam_ros.study.muscle.casting import write_guide
from mbpam_ros.study.muscle.moulds import moulds_of
from mbpam_ros.study.muscle.solids import SolidError, is_sound, write_3mf, write_stl
from mbpam_ros.terminal import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("name", metavar="NAME", help="of a drawing in config/muscles")
    parser.add_argument("--out", type=result_folder, required=True, metavar="DIR", help="where the files go")
    parser.add_argument("--3mf", dest="with_3mf", action="store_true", help="write 3MF besides STL")
    parser.add_argument("--bed-mm", type=float, default=220.0, metavar="MM", help="longest side the printer takes")


def run(options: argparse.Namespace) -> int:
    """Make the parts, check them, write them, and say what they need."""
    drawing = load_drawing(options.name)
    moulds = moulds_of(drawing, options.bed_mm)
    unsound = [name for name, solid in moulds.parts.items() if not is_sound(solid)]
    if unsound:
        raise SolidError(f"{', '.join(unsound)}: not closed; this is a fault of the program, please report the drawing")
    options.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for name, solid in moulds.parts.items():
        write_stl(solid, options.out / f"{name}.stl")
        if options.with_3mf:
            write_3mf(solid, options.out / f"{name}.3mf")
        low, high = solid.bounding_box()[:3], solid.bounding_box()[3:]
        size = " x ".join(f"{top - bottom:.0f}" for bottom, top in zip(low, high, strict=True))
        rows.append((name, size, f"{1e-3 * solid.volume():.1f}"))
    write_guide(options.out / "casting.html", options.name, drawing, moulds)
    print(table(("part", "mm", "cm3"), rows))
    print(
        f"silicone: {moulds.grams_a:.1f} g of A and {moulds.grams_b:.1f} g of B, waste included; thinnest silicone "
        f"{moulds.thinnest_wall_mm:.2f} mm, thinnest printed part {moulds.thinnest_mould_mm:.2f} mm; seal "
        f"{moulds.layer_mm:.2f} mm deep"
    )
    return 0
