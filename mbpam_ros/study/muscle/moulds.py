"""Moulds A to D of a drawn muscle, after the paper's section 2.1 and Fig. 2, and the palm that holds four of them.

The muscle is split along the middle of one arm of its cross, y = 0. With h = b / 2:

* A, outer half shell: a block whose cavity is the muscle's outside above y = h;
* B, two cores: the lid of A, on y = h, with the two chambers of that half;
* C, tray: a flat bottom with a rim of height h around the muscle's outline, for the layer that seals the half;
* D, second half: a block like A whose cavity is all below y = h. It holds the half that was cast second, unsealed, over
  the first one, sealed, with h of uncured silicone between them: h of seal and h of cement are the arm's b.

The parting planes are y = h, so that all parts lie flat on the printer's bed. B has a hole over each solid end: one to
pour into, one for the air. The cores' faces along the other arm lean back by :data:`DRAFT_DEG`; the waves are undercuts
that silicone yields to. Pins of 4 mm register the parts, holes for M3 bolts hold them together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mbpam_ros.actuator.drawing import MuscleDrawing
from mbpam_ros.gripper import Gripper
from mbpam_ros.study.muscle.solids import SEGMENTS, SolidError, block, chamber, muscle_solid, outer_body, pin

if TYPE_CHECKING:
    from manifold3d import Manifold

DRAFT_DEG = 0.5
WALL_MM = 5.0
FLANGE_MM = 12.0
PIN_MM, PIN_CLEARANCE_MM, PIN_LENGTH_MM = 4.0, 0.2, 4.0
BOLT_MM = 3.4
LID_MM = 4.0
POUR_MM = 6.0
THINNEST_PRINT_MM = 0.8
"""Two lines of a nozzle of 0.4 mm: what is thinner a desktop printer does not make."""
THINNEST_CAST_MM = 0.4
"""Liquid silicone does not fill less."""
WASTE = 0.15
"""What stays in cups and sprues, as a share."""


@dataclass(frozen=True, eq=False)
class Moulds:
    """The parts, and what one needs to know of them.

    Args:
        parts: by letter, A to D; ``muscle`` is what they cast.
        cast_mm3: silicone of the muscle: cavities less cores.
        thinnest_mould_mm, thinnest_wall_mm: of the printed parts, and of the silicone.
        layer_mm: h, depth of the tray.
        grams_a, grams_b: of the two components at 1 : 1, waste included.
    """

    parts: dict[str, Manifold]
    cast_mm3: float
    thinnest_mould_mm: float
    thinnest_wall_mm: float
    layer_mm: float
    grams_a: float
    grams_b: float


def moulds_of(drawing: MuscleDrawing, bed_mm: float = 220.0) -> Moulds:
    """Return the moulds of a drawing.

    Args:
        drawing: of the muscle.
        bed_mm: longest side that the printer takes.

    Raises:
        SolidError: they cannot be printed or cast; the message says what to change.
    """
    radius, h = drawing.outer_radius_mm, 0.5 * drawing.b_mm
    length = drawing.active_length_mm + 2.0 * drawing.end_length_mm
    if length + 2.0 * WALL_MM > bed_mm:
        raise SolidError(
            f"moulds of {length + 2.0 * WALL_MM:.0f} mm do not fit a bed of {bed_mm:g} mm; draw it shorter"
        )
    thinnest_core = radius - drawing.a_mm - drawing.c_mm - math.sqrt(2.0) * h
    thinnest_wall = min(drawing.c_mm, drawing.b_mm)
    if thinnest_core < THINNEST_PRINT_MM:
        raise SolidError(
            f"the cores are {thinnest_core:.2f} mm thick in the valleys, a printer makes {THINNEST_PRINT_MM:g}; "
            "make a, b or c smaller"
        )
    if min(thinnest_wall, h) < THINNEST_CAST_MM:
        raise SolidError(
            f"the thinnest layer is {min(thinnest_wall, h):.2f} mm, liquid silicone fills {THINNEST_CAST_MM:g}; "
            "make b or c larger"
        )
    body = outer_body(drawing)
    draft = math.radians(DRAFT_DEG)
    one = chamber(drawing, draft)
    cores = one + one.mirror((1.0, 0.0, 0.0))
    upper = body.trim_by_plane((0.0, 1.0, 0.0), h)
    lower = body.trim_by_plane((0.0, -1.0, 0.0), -h)
    half = radius + FLANGE_MM
    low_z, high_z = -WALL_MM, length + WALL_MM
    top, bottom = radius + WALL_MM, -radius - WALL_MM
    places = [(x, z) for x in (-1.0, 1.0) for z in (0.15, 0.85)]
    pins = [(x * (radius + 0.5 * FLANGE_MM), z * length) for x, z in places]
    bolts = [(x * (radius + 0.5 * FLANGE_MM), z * length) for x, z in ((-1, 0.0), (1, 0.0), (-1, 1.0), (1, 1.0))]
    holes = [pin(x, z, bottom - 1.0, top + 1.0, BOLT_MM) for x, z in bolts]
    sockets = [pin(x, z, h - 0.1, h + PIN_LENGTH_MM + 0.5, PIN_MM + PIN_CLEARANCE_MM) for x, z in pins]
    a = block((-half, h, low_z), (half, top, high_z)) - upper
    b = block((-half, h - LID_MM, low_z), (half, h, high_z)) + cores
    c = block((-half, h - LID_MM, low_z), (half, h + h, high_z)) - _layer(drawing, h)
    d = block((-half, bottom, low_z), (half, h, high_z)) - lower
    pegs = [pin(x, z, h - 1.0, h + PIN_LENGTH_MM, PIN_MM) for x, z in pins]
    for socket in sockets:
        a -= socket
    for peg in pegs:
        b, c, d = b + peg, c + peg.translate((0.0, h, 0.0)), d + peg
    for z in (0.5 * drawing.end_length_mm, length - 0.5 * drawing.end_length_mm):
        b -= pin(0.0, z, h - LID_MM - 1.0, h + 1.0, min(POUR_MM, 0.6 * drawing.end_length_mm))
    for hole in holes:
        a, b, d = a - hole, b - hole, d - hole
    muscle = muscle_solid(drawing)
    cast = 2.0 * (upper.volume() - cores.volume()) + (body.volume() - 2.0 * upper.volume())
    grams = cast * 1e-9 * drawing.density_kg_m3 * 1e3 * (1.0 + WASTE)
    return Moulds(
        {"A": a, "B": b, "C": c, "D": d, "muscle": muscle},
        cast,
        min(thinnest_core, WALL_MM, LID_MM),
        thinnest_wall,
        h,
        0.5 * grams,
        0.5 * grams,
    )


def _layer(drawing: MuscleDrawing, h: float) -> Manifold:
    """The seal in its tray: the outline that the muscle has at the middle of the arm, h deep, standing on y = h."""
    slab = outer_body(drawing).trim_by_plane((0.0, 1.0, 0.0), -0.01).trim_by_plane((0.0, -1.0, 0.0), -0.01)
    return slab.scale((1.0, h / 0.02 + 1.0, 1.0)).translate((0.0, h + 0.5 * h + 0.01, 0.0))


def palm_of(gripper: Gripper) -> Manifold:
    """Return the housing with four seats: a round plate with a sleeve for each muscle's base, and four air holes in it.

    Its frame is ``gripper_base`` [mm], z out of the palm along the hanging muscles; a muscle's base is at z = 0.

    Raises:
        SolidError: neighbouring sleeves meet.
    """
    from manifold3d import Manifold

    radius = 1e3 * gripper.geometry.outer_radius_m
    deep, wall, plate = 1e3 * gripper.geometry.end_length_m, 3.0, 8.0
    base = 1e3 * gripper.finger_base_m
    apart = float(np.linalg.norm(base[0] - base[1]))
    outer = radius + 0.2 + wall
    if apart < 2.0 * outer:
        raise SolidError(f"sleeves of {2.0 * outer:.1f} mm on axes {apart:.1f} mm apart meet; move the fingers outward")
    reach = 1e3 * gripper.finger_circle_radius_m + outer + 3.0
    palm = Manifold.cylinder(plate, reach, circular_segments=SEGMENTS).translate((0.0, 0.0, -plate))
    for x, y, _ in base.tolist():
        palm += Manifold.cylinder(0.8 * deep, outer, circular_segments=SEGMENTS).translate((x, y, 0.0))
    for x, y, _ in base.tolist():
        palm -= Manifold.cylinder(deep, radius + 0.2, circular_segments=SEGMENTS).translate((x, y, 0.0))
        for turn in np.radians([45.0, 135.0, 225.0, 315.0]):
            place = (x + 0.5 * radius * math.cos(turn), y + 0.5 * radius * math.sin(turn), -plate - 1.0)
            palm -= Manifold.cylinder(plate + 2.0, min(2.0, 0.2 * radius), circular_segments=24).translate(place)
        clamp = Manifold.cylinder(4.0 * outer, 0.5 * BOLT_MM, circular_segments=24)
        palm -= clamp.rotate((90.0, 0.0, 0.0)).translate((x, y + 2.0 * outer, 0.4 * deep))
    for turn in np.radians([0.0, 90.0, 180.0, 270.0]):
        place = (0.5 * reach * math.cos(turn), 0.5 * reach * math.sin(turn), -plate - 1.0)
        palm -= Manifold.cylinder(plate + 2.0, 0.5 * BOLT_MM, circular_segments=24).translate(place)
    return palm
