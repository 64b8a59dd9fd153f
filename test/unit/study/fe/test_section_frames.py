import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbpam_ros.study.fe.section_frames import SectionFrames

GRID = np.stack(np.meshgrid([-2.0, 0.5, 3.0], [-1.0, 0.0, 1.0], np.linspace(0.0, 20.0, 21), indexing="ij"), axis=-1)
POINTS = GRID.reshape(-1, 3)
FRAMES = SectionFrames(POINTS)
HALF = POINTS[POINTS[:, 1] >= 0.0]


def helix(rate_rad, points=POINTS):
    """The points of a body of the same length whose section turns by ``rate_rad``, in its own axes, along it."""
    s, rate = points[:, 2:], np.asarray(rate_rad) / 20.0
    steps = np.linspace(0.0, 1.0, 2001)
    turns = Rotation.from_rotvec((steps[:, None, None] * s * rate).reshape(-1, 3))
    directions = turns.as_matrix()[:, :, 2].reshape(2001, -1, 3)
    centre = np.trapezoid(directions, steps, axis=0) * s
    return centre + Rotation.from_rotvec(s * rate).apply(points * (1.0, 1.0, 0.0))


@pytest.mark.parametrize(("points", "mirrored"), [(POINTS, False), (HALF, True)], ids=["all", "half"])
def test_coordinates_and_positions_undo_each_other(points, mirrored):
    frames = SectionFrames(points, mirrored)
    x = helix((0.0, -2.0, 0.0), points) + 0.1 * np.random.default_rng(3).standard_normal(points.shape)
    assert frames.positions_mm(frames.coordinates(x)) == pytest.approx(x, abs=1e-12)


def test_the_angle_goes_on_beyond_half_a_turn_in_any_plane():
    assert FRAMES.angle_rad(POINTS, np.array([0.0, 0.0, 1.0])) == 0.0
    for bend in (0.5, 3.5, 4.0):
        direction = np.array([-0.8 * math.sin(bend), -0.6 * math.sin(bend), math.cos(bend)])
        assert FRAMES.angle_rad(helix((0.6 * bend, -0.8 * bend, 0.0)), direction) == pytest.approx(bend, abs=1e-9)


def test_half_a_body_has_the_frames_of_the_whole():
    rate = (0.0, -2.0, 0.0)
    half = SectionFrames(HALF, mirrored=True)
    assert half.rotations(helix(rate, HALF)) == pytest.approx(FRAMES.rotations(helix(rate)), abs=1e-9)


@pytest.mark.parametrize("rate", [(0.0, -2.0, 0.0), (1.0, -2.0, 0.0), (0.5, -2.0, 1.5)])
def test_half_the_way_to_an_arc_or_a_helix_has_half_the_bend_and_twist_and_the_same_length(rate):
    straight, bent = FRAMES.coordinates(POINTS), FRAMES.coordinates(helix(rate))
    halfway = FRAMES.positions_mm(0.5 * (straight + bent))
    wanted = helix(0.5 * np.array(rate))
    assert halfway == pytest.approx(wanted, abs=0.01)
    assert np.abs(0.5 * (POINTS + helix(rate)) - wanted).max() > 1.0
