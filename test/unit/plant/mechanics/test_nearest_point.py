"""The point of a centreline that is nearest to a place: that of all its pieces, whatever the search starts from."""

import numpy as np
import pytest

from mbpam_ros.plant.mechanics.finger_contact import _nearest_point
from mbpam_ros.plant.mechanics.lanes import WIDTH

BALLS, SPACING_M = 49, 2.5e-3


def arc(bend_rad):
    """Points along an arc from the origin, shape (n, 3)."""
    along = np.arange(BALLS) * SPACING_M
    curvature = bend_rad / along[-1]
    return np.stack([(1 - np.cos(curvature * along)) / curvature, 0 * along, np.sin(curvature * along) / curvature], 1)


def grouped(points):
    """The points four to a group, the rest at infinity."""
    groups = np.full((3, -(-BALLS // WIDTH), WIDTH), np.inf)
    groups.reshape(3, -1)[:, :BALLS] = points.T
    return groups


def nearest(points, place):
    """Place along the line and distance, from all pieces."""
    start, piece = points[:-1], np.diff(points, axis=0)
    share = np.clip(((place - start) * piece).sum(1) / (piece * piece).sum(1), 0.0, 1.0)
    distances = np.linalg.norm(place - start - share[:, None] * piece, axis=1)
    k = np.argmin(distances)
    return k + share[k], distances[k]


@pytest.mark.parametrize("bend_rad", [0.1, 1.5, 4.0])
def test_it_is_that_of_all_pieces_whatever_it_starts_from(bend_rad):
    points, random = arc(bend_rad), np.random.default_rng(3)
    for place in random.uniform(-0.05, 0.15, (60, 3)):
        found = [_nearest_point(grouped(points), BALLS, tuple(place), guess) for guess in (0, 17, BALLS - 1)]
        assert found[0] == found[1] == found[2]
        np.testing.assert_allclose(found[0], nearest(points, place), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("ball", [0, 1, BALLS - 2, BALLS - 1])
def test_beyond_the_ends_and_at_balls_it_is_the_ball(ball):
    points = arc(1.0)
    beyond = points[ball] + {0: -1.0, BALLS - 1: 1.0}.get(ball, 0.0) * (points[-1] - points[-2])
    along, distance = _nearest_point(grouped(points), BALLS, tuple(beyond), 20)
    np.testing.assert_allclose((along, distance), nearest(points, beyond), atol=1e-12)
    assert round(along) == ball
