"""Contact of nodes with a rigid plate: an active set with a stiff penalty, Coulomb friction with an elastic start.

The plate fills n . x <= d, n pointing to the muscle. A touching node at x with the gap g = n . x - d and the share w of
it that belongs to the model (1/2 on the symmetry plane) feels

    N = -k w g                                   along n,
    T = -k_t w s,  s = e e . (x - anchor)        while it sticks, |T| <= mu N,
    T = -mu N t                                  while it slides in the direction t = e or -e   [N].

e lies in the plate: friction acts along it only. A muscle bending in the plane y = 0 slides along its axis; the
friction across, which hinders the tip's skin from spreading, cancels in the sum.

Which nodes touch, which slide, and which way stay the same while an equilibrium is sought, so that a node
cannot jump to and fro during Newton's method; afterwards they are put right by what was found, until nothing changes
(:meth:`PlateContact.revised`, t = s / |s|). The anchor is where a node would feel no friction; a sliding node drags
it along once a load step has converged (backward Euler of Coulomb's law; Wriggers, Computational Contact Mechanics,
2006, ch. 5.2). Sliding makes the tangent unsymmetric.

The penalty's error is the penetration N / k, with the default k and forces below 1 N under 0.02 mm; the elastic slip
before a node slides is mu N / k_t, like the small one that Abaqus' penalty friction allows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix, csr_matrix

from mbpam_ros.configuration import require_positive

STICKING = 1e6
"""Coefficient of friction of a tip that is held: it cannot slide."""

_TOUCH_MM = 0.01
_TOLERANCE_N = 1e-4


@dataclass(frozen=True)
class Plate:
    """A rigid half space n . x <= d.

    Args:
        normal: n, a unit vector toward the muscle.
        distance_mm: d.
        slip_direction: e, a unit vector across n.
        friction: Coulomb's coefficient mu; the paper's 0.6.
        stiffness_n_mm, slip_stiffness_n_mm: k and k_t, per node.

    Raises:
        ValueError: n or e is no unit vector, e not across n, mu negative, or a stiffness not positive.
    """

    normal: tuple[float, float, float] = (1.0, 0.0, 0.0)
    distance_mm: float = -10.0
    slip_direction: tuple[float, float, float] = (0.0, 0.0, 1.0)
    friction: float = 0.6
    stiffness_n_mm: float = 50.0
    slip_stiffness_n_mm: float = 5.0

    def __post_init__(self) -> None:
        require_positive(self, "stiffness_n_mm", "slip_stiffness_n_mm")
        frame = np.array([self.normal, self.slip_direction])
        if np.abs(frame @ frame.T - np.eye(2)).max() > 1e-9:
            raise ValueError(f"the plate's normal and slip direction must be orthonormal, found {frame.tolist()}")
        if not self.friction >= 0.0:
            raise ValueError(f"friction must not be negative, found {self.friction}")


@dataclass(frozen=True, eq=False)
class ContactMemory:
    """What the contact remembers.

    Args:
        touching, sliding: whether a node touches the plate and slides on it, shape (m,).
        direction: in which it slides, t, or zero; shape (m, 3).
        anchors_mm: where it would feel no friction, shape (m, 3).
    """

    touching: NDArray[np.bool_]
    sliding: NDArray[np.bool_]
    direction: NDArray[np.float64]
    anchors_mm: NDArray[np.float64]


class PlateContact:
    """Contact of some nodes of a body with a plate.

    Args:
        plate: the plate.
        nodes: that may touch it, shape (m,).
        shares: part of each node within the model, shape (m,).
    """

    def __init__(self, plate: Plate, nodes: NDArray[np.int64], shares: NDArray[np.float64]) -> None:
        self.plate, self.nodes = plate, nodes
        self._stiffness, self._slip_stiffness = plate.stiffness_n_mm * shares, plate.slip_stiffness_n_mm * shares
        self._normal = np.array(plate.normal)
        self._flat = np.outer(plate.slip_direction, plate.slip_direction)

    @property
    def symmetric(self) -> bool:
        """Whether the tangent is symmetric: without friction."""
        return self.plate.friction == 0.0

    def beside(self, x: NDArray[np.float64]) -> ContactMemory:
        """Return the memory of a body at ``x``, shape (nodes of the body, 3), to which the plate has just been moved.

        Nodes nearer than a hundredth of a millimetre touch it, without friction yet.
        """
        none = np.zeros(self.nodes.size, dtype=bool)
        return ContactMemory(self.gaps_mm(x) < _TOUCH_MM, none, np.zeros((self.nodes.size, 3)), x[self.nodes])

    def gaps_mm(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the nodes' gaps g, shape (m,)."""
        return x[self.nodes] @ self._normal - self.plate.distance_mm

    def pushes_n(self, x: NDArray[np.float64], memory: ContactMemory) -> NDArray[np.float64]:
        """Return the plate's forces N n + T on the nodes [N], shape (m, 3)."""
        normal_n, slip = self._normal_forces_n(x, memory), self._slips_mm(x, memory)
        drag = (self._slip_stiffness * memory.touching)[:, None] * slip
        sliding = memory.sliding
        drag[sliding] = self.plate.friction * normal_n[sliding, None] * memory.direction[sliding]
        return normal_n[:, None] * self._normal - drag

    def tangent(self, x: NDArray[np.float64], memory: ContactMemory) -> csr_matrix:
        """Return minus the derivative of the forces [N/mm] over 3 node + component of the body."""
        across = self._slip_stiffness[:, None, None] * self._flat
        pull = -self.plate.friction * memory.direction[memory.sliding]
        across[memory.sliding] = self._stiffness[memory.sliding, None, None] * pull[:, :, None] * self._normal
        along = self._stiffness[:, None, None] * np.outer(self._normal, self._normal)
        blocks = (along + across)[memory.touching]
        degrees = 3 * self.nodes[memory.touching, None] + np.arange(3)
        rows = np.broadcast_to(degrees[:, :, None], blocks.shape).ravel()
        columns = np.broadcast_to(degrees[:, None, :], blocks.shape).ravel()
        return coo_matrix((blocks.ravel(), (rows, columns)), (x.size, x.size)).tocsr()

    def revised(self, x: NDArray[np.float64], memory: ContactMemory, one_by_one: bool = False) -> ContactMemory:
        """Return the memory with those nodes touching that are inside the plate.

        Those slide that would exceed the limit of friction. It is ``memory`` itself if that changes no node's force by
        more than 1e-4 N.

        Args:
            one_by_one: change the first such node only. Changing all at once is quick but can go round in circles
                (Murty's least-index rule against that; for contact without friction it always ends).
        """
        touching = self.gaps_mm(x) < 0.0
        slip = self._slips_mm(x, memory)
        length = np.linalg.norm(slip, axis=1)
        limit_n = -self.plate.friction * self._stiffness * self.gaps_mm(x)
        turned_back = memory.sliding & (np.sum(slip * memory.direction, axis=1) < 0.0)  # sticks before it slides back
        sliding = touching & memory.touching & ~turned_back & (self._slip_stiffness * length > limit_n)
        direction = np.where(sliding[:, None], slip / np.where(length > 0.0, length, 1.0)[:, None], 0.0)
        right = ContactMemory(touching, sliding, direction, memory.anchors_mm)
        change = np.abs(self.pushes_n(x, right) - self.pushes_n(x, memory)).max(axis=1)
        wrong = np.flatnonzero(change > _TOLERANCE_N)
        if not wrong.size:
            return memory
        if not one_by_one:
            return right
        chosen = np.arange(self.nodes.size) == wrong[0]
        return ContactMemory(
            np.where(chosen, touching, memory.touching),
            np.where(chosen, sliding, memory.sliding),
            np.where(chosen[:, None], direction, memory.direction),
            memory.anchors_mm,
        )

    def settled(self, x: NDArray[np.float64], memory: ContactMemory) -> ContactMemory:
        """Return the memory after the motion to the equilibrium ``x``.

        A sticking node keeps its anchor, a sliding one drags it so that it is just at the limit, a free one takes it
        along.
        """
        reach = self.plate.friction * self._normal_forces_n(x, memory) / self._slip_stiffness
        anchors = np.where(memory.touching[:, None], memory.anchors_mm, x[self.nodes])
        dragged = x[self.nodes] - reach[:, None] * memory.direction
        anchors[memory.sliding] = dragged[memory.sliding]
        return ContactMemory(memory.touching, memory.sliding, memory.direction, anchors)

    def _normal_forces_n(self, x: NDArray[np.float64], memory: ContactMemory) -> NDArray[np.float64]:
        return np.where(memory.touching, -self._stiffness * self.gaps_mm(x), 0.0)

    def _slips_mm(self, x: NDArray[np.float64], memory: ContactMemory) -> NDArray[np.float64]:
        return (x[self.nodes] - memory.anchors_mm) @ self._flat
