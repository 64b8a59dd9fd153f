import math

import numpy as np
import pytest

from mbpam_ros.study.fe.fillets import ChamberOutline, filleted_wave_depth_mm, largest_wave_fillet_mm
from mbpam_ros.study.fe.mesh import CellGeometry, CellGeometryError

AMPLITUDE, WAVE = 2.5, 100.0 / 14.0
RADII = (0.2, 1.0, 1.9)


@pytest.mark.parametrize("radius", RADII)
def test_the_wave_has_its_amplitude_its_period_and_symmetric_crests_and_valleys(radius):
    z = np.linspace(-WAVE, WAVE, 401)
    depth = filleted_wave_depth_mm(z, AMPLITUDE, WAVE, radius)
    assert depth.min() == 0.0 and depth.max() == pytest.approx(AMPLITUDE, rel=1e-12)
    assert depth == pytest.approx(depth[::-1], abs=1e-12)
    assert depth == pytest.approx(filleted_wave_depth_mm(z + 3 * WAVE, AMPLITUDE, WAVE, radius), abs=1e-12)
    assert depth == pytest.approx(AMPLITUDE - filleted_wave_depth_mm(z + 0.5 * WAVE, AMPLITUDE, WAVE, radius))


@pytest.mark.parametrize("radius", RADII)
def test_crests_are_circles_of_the_radius_and_flow_into_straight_flanks(radius):
    z = np.linspace(0.0, 0.5 * WAVE, 20001)
    depth = filleted_wave_depth_mm(z, AMPLITUDE, WAVE, radius)
    slope = np.gradient(depth, z)
    assert np.abs(np.diff(slope)).max() < 0.01  # no kink where arc and flank meet
    near = z < 0.3 * radius
    assert np.hypot(z[near], depth[near] - radius) == pytest.approx(radius, rel=1e-9)
    flank = np.abs(z - 0.25 * WAVE) < 0.01
    assert slope[flank] == pytest.approx(slope.max(), rel=1e-4)


def test_the_largest_fillet_leaves_no_flank():
    largest = largest_wave_fillet_mm(AMPLITUDE, WAVE)
    z = np.linspace(0.0, 0.25 * WAVE, 50)
    depth = filleted_wave_depth_mm(z, AMPLITUDE, WAVE, largest)
    assert np.hypot(z, depth - largest) == pytest.approx(largest, rel=1e-6)


@pytest.mark.parametrize("fillet", [0.0, 0.4, 0.8])
def test_the_chambers_area_is_that_within_its_outline(fillet):
    outline = ChamberOutline(1.0, np.array([5.4, 7.9]), fillet)
    octant = np.concatenate([outline.arm_side_mm(40, 80), outline.wall_side_mm(40, 80)[1:]])
    x, y = np.moveaxis(octant, 2, 0)
    twice = np.sum(x[:-1] * y[1:] - x[1:] * y[:-1], axis=0)  # from the axis; the diagonal's ends add nothing
    assert twice == pytest.approx(outline.area_mm2(), rel=1e-5)
    if fillet:
        assert (outline.area_mm2() < ChamberOutline(1.0, outline.wall_mm).area_mm2()).all()


def test_a_fillet_turns_as_far_as_it_must_and_meets_its_neighbours_smoothly():
    outline = ChamberOutline(1.0, np.array([5.4]), 0.5)
    octant = np.concatenate([outline.arm_side_mm(10, 50), outline.wall_side_mm(10, 50)[1:]])[:, 0]
    step = np.diff(octant, axis=0)
    heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    assert np.abs(np.diff(heading)).max() < 0.04
    assert heading[0] == pytest.approx(-0.25 * math.pi, abs=0.02)  # across the diagonal
    assert heading[-1] == pytest.approx(0.75 * math.pi, abs=0.02)


def test_geometry_without_fillets_says_nothing_of_them():
    assert "wave_fillet_mm" not in CellGeometry().settings()
    assert CellGeometry(corner_fillet_mm=0.4).settings()["corner_fillet_mm"] == 0.4


@pytest.mark.parametrize(
    ("fillets", "what"),
    [
        ({"wave_fillet_mm": 2.0}, "no flank is left"),
        ({"wave_fillet_mm": 0.0}, "no flank is left"),
        ({"corner_fillet_mm": -0.1}, "negative"),
        ({"corner_fillet_mm": 1.8}, "meet in the valleys"),
    ],
)
def test_a_fillet_without_room_is_refused(fillets, what):
    with pytest.raises(CellGeometryError, match=what):
        CellGeometry(**fillets)
