"""What a marker carries of an object that is seen in part."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time

from mbpam_ros.nodes.markers import colour, hidden_lengths, mark_hidden_lengths, solid_marker


def marker(shape, size_m):
    return solid_marker(
        Time(), "gripper_base", shape, 0, shape, size_m, np.zeros(3), (0.0, 0.0, 0.0, 1.0), colour((1, 1, 1))
    )


@pytest.mark.parametrize(("shape", "size_m"), [("cylinder", (0.02, 0.02, 0.18)), ("box", (0.03, 0.12, 0.05))])
def test_hidden_lengths_come_back_as_they_were_noted(shape, size_m):
    message = marker(shape, size_m)
    assert hidden_lengths(message) == (0.0, 0.0)
    mark_hidden_lengths(message, (0.0, 0.0))
    assert not message.points
    mark_hidden_lengths(message, (0.06, 0.01))
    assert hidden_lengths(message) == pytest.approx((0.06, 0.01))


def test_ends_nearer_than_the_markers_own_hide_nothing():
    message, other = marker("cylinder", (0.02, 0.02, 0.18)), marker("cylinder", (0.02, 0.02, 0.10))
    mark_hidden_lengths(other, (0.01, 0.05))
    message.points = other.points
    assert hidden_lengths(message) == pytest.approx((0.0, 0.01))
