import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("felupe")

from mbpam_ros.study.fe.design_run import MESHES, Run
from mbpam_ros.study.fe.law import BendingLaw
from mbpam_ros.study.fe.mesh import CellGeometry
from mbpam_ros.study.fe.muscle_shape import MuscleShape, muscle_shapes, outer_faces
from mbpam_ros.study.fe.pictures import (
    draw_ablations,
    draw_curves,
    draw_effects,
    draw_muscles,
    draw_parity,
    draw_sections,
)
from mbpam_ros.study.fe.posture import upright_bends_rad, upright_tip_angle_rad

RUN = Run(CellGeometry(a_mm=1.5, c_mm=3.0), "pdc", MESHES["coarse"])

pytestmark = pytest.mark.xdist_group("fe_muscle_shape")  # its muscle is solved once


@pytest.fixture(scope="module")
def shapes() -> list[MuscleShape]:
    return muscle_shapes(RUN, [0.0, 60.0])


def test_without_pressure_the_muscle_stands_as_it_was_cast(shapes):
    rest = shapes[0]
    assert rest.tip_mm == pytest.approx([0.0, 0.0, 130.0], abs=1e-6)
    assert rest.tip_direction == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert rest.stretch == pytest.approx(1.0, abs=1e-6)
    points = rest.surface_mm.reshape(-1, 3)
    wave = RUN.geometry.outer_radius_at(points[:, 2] - RUN.end_length_mm)
    assert np.hypot(points[:, 0], points[:, 1]) == pytest.approx(wave, abs=1e-6)
    assert (points[:, 2].min(), points[:, 2].max()) == pytest.approx((15.0, 115.0))


def test_under_pressure_it_is_bent_as_the_posture_says_and_nowhere_torn(shapes):
    bent = shapes[1]
    cell = RUN.cell()
    tip_rad = RUN.upright_tip_angle_rad(BendingLaw(cell, [cell.free_bend(0.06)]))
    assert bent.tip_angle_deg == pytest.approx(math.degrees(tip_rad), rel=2e-3)
    angle = math.radians(bent.tip_angle_deg)
    assert bent.tip_direction == pytest.approx([-math.sin(angle), 0.0, math.cos(angle)], abs=1e-9)
    assert bent.stretch.max() > 1.05
    # the weight makes neighbours bend differently, but little: what met at rest still meets
    cells = round(cell.angle_per_muscle)
    assert shared_corners(bent, cells, 0.05) == shared_corners(shapes[0], cells, 1e-6) > 0


def shared_corners(shape: MuscleShape, cells: int, within_mm: float) -> int:
    """Corners that the first three cells have in common with the cell before them (a mirrored one among them)."""
    first, second, third = shape.surface_mm[: len(shape.surface_mm) // 2].reshape(cells, -1, 3)[:3]
    pairs = ((first, second), (second, third))
    return sum(int(np.sum(np.linalg.norm(a[:, None] - b[None], axis=2).min(axis=1) < within_mm)) for a, b in pairs)


def test_its_sections_are_whole_and_larger_under_pressure(shapes):
    for plane, radius in (("crest", 10.0), ("valley", 8.5)):
        rest, moved = (np.abs(section) for section in shapes[1].sections_mm[plane])
        assert np.linalg.norm(rest, axis=-1).max() == pytest.approx(radius, rel=1e-6)
        assert moved.max() > rest.max()


def test_the_outer_surface_is_all_of_it_and_nothing_else():
    mesh = RUN.cell().mesh
    quads = mesh.points_mm[outer_faces(mesh)]
    assert np.hypot(quads[..., 0], quads[..., 1]) == pytest.approx(RUN.geometry.outer_radius_at(quads[..., 2]))
    area = 0.5 * np.linalg.norm(np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1]), axis=1).sum()
    z = np.linspace(0.0, mesh.length_mm, 200)
    radius = RUN.geometry.outer_radius_at(z)
    expected = np.pi * np.trapezoid(radius * np.hypot(1.0, np.gradient(radius, z)), z)
    assert area == pytest.approx(expected, rel=0.03)


def test_the_weight_bends_the_clamped_end_most():
    run = replace(RUN, pattern="psc")
    cell = run.cell()
    law = BendingLaw(cell, [cell.free_bend(0.06)])
    stations = (np.arange(200) + 0.5) / 200
    bends = upright_bends_rad(law, run.geometry, 15.0, 1.0, stations)
    assert np.all(np.diff(bends) < 0.0)
    assert bends.mean() == pytest.approx(upright_tip_angle_rad(law, run.geometry, 15.0, 1.0), rel=1e-3)


class TestPictures:
    @pytest.fixture(autouse=True)
    def needs_matplotlib(self):
        pytest.importorskip("matplotlib")

    def drawn(self, path):
        import matplotlib.image

        image = matplotlib.image.imread(path)
        assert min(image.shape[:2]) > 200
        return np.unique(np.round(255 * image[::3, ::3, :3]).astype(int) @ (65536, 256, 1))

    def test_shapes(self, shapes, tmp_path):
        draw_sections(shapes[1:], tmp_path / "sections.png")
        draw_muscles([shapes], tmp_path / "muscle.png")
        assert len(self.drawn(tmp_path / "sections.png")) > 50
        assert len(self.drawn(tmp_path / "muscle.png")) > 500

    def test_numbers(self, tmp_path):
        curve = {"pattern": "pdc", "p_kpa": [0.0, 100.0], "theta_deg": [0.0, 150.0]}
        draw_curves([curve], [("pdc", 100.0, 151.0, "measured")], tmp_path / "curves.png")
        point = {"source": "table_1:1", "theta_deg": 150.0, "force_n": 0.6, "fe_theta_deg": 148.0, "fe_force_n": 0.5}
        draw_parity([point], {}, tmp_path / "parity.png")
        level = {"parameter": "n", "theta_deg": 90.0, "force_n": 0.5, "blocked_force_n": 0.6}
        level |= {"paper_force_n": None, "paper_theta_deg": None}
        levels = [{**level, "level": 6.0}, {**level, "level": 14.0, "paper_force_n": 0.6, "paper_theta_deg": 99.0}]
        draw_effects(levels, tmp_path / "effects.png")
        variant = {"name": "x", "points": 6, "theta_rms_pct": 4.0, "theta_mean_pct": -1.0, "force_rms_pct": 6.0}
        draw_ablations([variant], tmp_path / "ablations.png")
        for name in ("curves", "parity", "effects", "ablations"):
            assert len(self.drawn(tmp_path / f"{name}.png")) > 20
