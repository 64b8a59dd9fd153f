import numpy as np
import pytest

from mbpam_ros.study.fe.section_frames import SectionFrames

GRID = np.stack(np.meshgrid([-2.0, 0.5, 3.0], [0.0, 1.0], np.linspace(0.0, 20.0, 21), indexing="ij"), axis=-1)
POINTS = GRID.reshape(-1, 3)
FRAMES = SectionFrames(POINTS)


def arc(bend_rad):
    """The points on an arc of the same length, turned from z toward -x."""
    s, reach = POINTS[:, 2], POINTS[:, 0]
    angle = bend_rad * s / 20.0
    radius = 20.0 / bend_rad
    x = -radius * (1.0 - np.cos(angle)) + reach * np.cos(angle)
    return np.stack([x, POINTS[:, 1], radius * np.sin(angle) + reach * np.sin(angle)], axis=1)


def test_coordinates_and_positions_undo_each_other():
    x = arc(2.0) + 0.1 * np.random.default_rng(3).standard_normal(POINTS.shape)
    assert FRAMES.positions_mm(FRAMES.coordinates(x)) == pytest.approx(x, abs=1e-12)


def test_angles_go_on_beyond_half_a_turn():
    angles = FRAMES.angles_rad(arc(4.0))
    assert angles == pytest.approx(np.linspace(0.0, 4.0, 21), abs=1e-12)


def test_half_the_way_to_an_arc_is_an_arc_of_half_the_bend_and_the_same_length():
    straight, bent = FRAMES.coordinates(POINTS), FRAMES.coordinates(arc(2.0))
    halfway = FRAMES.positions_mm(0.5 * (straight + bent))
    assert halfway == pytest.approx(arc(1.0), abs=0.01)
    in_positions = 0.5 * (POINTS + arc(2.0))
    assert np.abs(in_positions - arc(1.0)).max() > 1.0
