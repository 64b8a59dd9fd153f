"""The gripper's frames by name, and the way into ``world``, whose z axis points up (REP 103).

Each hangs from the one on its left::

    world ── gripper_base ─┬─ camera_optical
                           └─ finger_1_mount ... finger_4_mount,  finger_1_tip ... finger_4_tip

``gripper_base`` has its z axis out of the palm along the hanging fingers, so the hand that hangs is upside down in
``world``: turned by half a turn about x. ``world`` has its origin where the palm was at the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import FINGER_NAMES
from mbpam_ros.geometry.rotations import Quaternion, product

WORLD = "world"
"""Of all grippers, so without a prefix."""

HANGING_XYZW: Quaternion = (1.0, 0.0, 0.0, 0.0)
"""Orientation of ``gripper_base`` in ``world`` while the gripper hangs."""


@dataclass(frozen=True)
class Frames:
    """Names of one gripper's frames.

    Args:
        prefix: before each of them, such as ``right/``, so that two grippers share none.
    """

    prefix: str = ""

    @property
    def base(self) -> str:
        """Origin in the palm's centre, z out of the palm along the hanging fingers."""
        return f"{self.prefix}gripper_base"

    @property
    def camera_optical(self) -> str:
        """The camera's: x to the right of the image, y down, z forward."""
        return f"{self.prefix}camera_optical"

    @property
    def mounts(self) -> tuple[str, ...]:
        """The four clamps, parallel to the base."""
        return tuple(f"{self.prefix}{finger}_mount" for finger in FINGER_NAMES)

    @property
    def tips(self) -> tuple[str, ...]:
        """The four tips, z along the finger."""
        return tuple(f"{self.prefix}{finger}_tip" for finger in FINGER_NAMES)


def up(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return points, shape (..., 3) [m], of the hanging ``gripper_base`` as it stood at the start in ``world``."""
    return points_m * np.array([1.0, -1.0, -1.0])


def turned_up(orientation_xyzw: Sequence[float] | NDArray[np.float64]) -> Quaternion:
    """Return an orientation in the hanging ``gripper_base``, unit quaternion (4,), as one in ``world``."""
    x, y, z, w = (float(value) for value in orientation_xyzw)
    return product(HANGING_XYZW, (x, y, z, w))


def orientation_of(rotation: NDArray[np.float64]) -> Quaternion:
    """Return the unit quaternion of a rotation matrix (3, 3), with w >= 0.

    From the largest of the four squares ``w^2 = (1 + trace) / 4`` and so on (Shepperd 1978), so that nothing small is
    divided by.
    """
    m = rotation
    symmetric = np.array(
        [
            [m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]],
            [m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1], m[0, 2] - m[2, 0]],
            [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], np.trace(m)],
        ]
    )
    products = symmetric + np.eye(4)  # 4 q q^T
    row = products[int(np.argmax(np.diag(products)))]
    x, y, z, w = (float(value) for value in (-row if row[3] < 0.0 else row) / np.linalg.norm(row))
    return x, y, z, w
