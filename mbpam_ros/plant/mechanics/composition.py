r"""Undamped motion to the fourth order: five implicit midpoint steps instead of one.

The implicit midpoint rule keeps the energy of a free, undamped system up to a swing of O((h omega)^2), omega being the
fastest motion that is excited. Five of its steps, of the shares

    g, g, 1 - 4 g, g, g      g = 1 / (4 - 4^(1/3))      (M. Suzuki, Phys. Lett. A 146, 1990)

are a symmetric scheme of fourth order: the swing falls with (h omega)^4. Being symmetric it has no drift of its own;
the mean of the swing wanders with the shares of energy among the modes, within it.

Stability: each of the five, the one that goes back (1 - 4 g = -0.66) too, is unitary for the elastic part, so the step
has no limit there. Accuracy: with the highest frequency of the modes, omega = 30, 200, 560, 1120 rad/s for one to four
modes a plane, h omega = 0.6 keeps the energy to 1e-5 of the kinetic energy over 10 s of swinging in space, h omega = 1
to some 1e-4.

What is damped, and what touches, cannot go back in time: a step in which anything touches is one plain step, of first
order as always in contact.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbpam_ros.plant.mechanics.packed_arguments import Block
from mbpam_ros.plant.mechanics.parts import Drive, Parts
from mbpam_ros.plant.mechanics.step import OK, advance, bind, forget
from mbpam_ros.plant.mechanics.vectors import Array

_OUTER = 1.0 / (4.0 - 4.0 ** (1.0 / 3.0))
SHARES = (_OUTER, _OUTER, 1.0 - 4.0 * _OUTER, _OUTER, _OUTER)
"""Of the five steps in the whole; they add up to 1."""


class Composition:
    """The five steps and the plain one, on the same state."""

    def __init__(self, parts: Parts) -> None:
        self._parts, system = parts, parts.system
        self._whole = bind(parts)
        self._shares = [bind(parts._replace(system=system._replace(step_s=s * system.step_s))) for s in SHARES]

    def advance(self, heights: Array, rates: Array) -> tuple[int, int]:
        """Advance the state in place by all sub-steps, as :func:`mbpam_ros.plant.mechanics.step.advance` does."""
        if len(heights) == 1:
            return advance(self._whole, heights, rates)
        state, drive = self._parts.state, self._parts.drive
        before, whole = [part.copy() for part in state], Drive(*(part.copy() for part in drive))
        answer, iterations = self._advance(whole, heights, rates)
        for part, values in zip(drive, whole, strict=True):
            part[:] = values[1] if answer == OK else values
        if answer != OK:
            for own, kept in zip(state, before, strict=True):
                own[:] = kept
        return answer, iterations

    def _advance(self, whole: Drive, heights: Array, rates: Array) -> tuple[int, int]:
        state, drive, contacts, iterations = self._parts.state, self._parts.drive, self._parts.contacts, 0
        for ends, height, rate in _ends(whole, heights, rates):
            start = [part.copy() for part in state]
            answer = self._composed_step(ends, height, rate)
            if contacts.count[0]:
                for part, before in zip(state, start, strict=True):
                    part[:] = before
                _take(drive, ends, slice(None, None, len(SHARES)))
                answer, count = self._step(self._whole, height[[0, -1]], rate[[0, -1]])
                iterations = max(iterations, count)
            if answer != OK:
                return answer, iterations
        return OK, iterations

    def _composed_step(self, ends: Drive, heights: Array, rates: Array) -> int:
        """Advance by one sub-step; stop where something touches."""
        for k, share in enumerate(self._shares):
            _take(self._parts.drive, ends, slice(k, k + 2))
            answer, _ = self._step(share, heights[k : k + 2], rates[k : k + 2])
            if answer != OK or self._parts.contacts.count[0]:
                return answer
        return OK

    def _step(self, bound: Block, heights: Array, rates: Array) -> tuple[int, int]:
        forget(self._parts.work)  # the step before was of another length
        return advance(bound, heights, rates)


def _take(drive: Drive, ends: Drive, which: slice) -> None:
    for part, values in zip(drive, ends, strict=True):
        part[:] = values[which]


def _ends(drive: Drive, heights: Array, rates: Array) -> Iterator[tuple[Drive, Array, Array]]:
    """Yield what drives, heights and rates at the ends of the five parts of each sub-step.

    The hand accelerates in all of them as in the whole.
    """
    steps, done = len(heights) - 1, np.cumsum((0.0, *SHARES))
    for step in range(steps):
        blend = (step + done) / steps
        yield (
            Drive(*(part[0] + np.multiply.outer(blend, part[1] - part[0]) for part in drive)),
            heights[step] + done * (heights[step + 1] - heights[step]),
            rates[step] + done * (rates[step + 1] - rates[step]),
        )
