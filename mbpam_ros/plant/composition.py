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

from mbpam_ros.plant.contact import Contacts
from mbpam_ros.plant.multibody import OK, Drive, Forces, State, System, advance
from mbpam_ros.plant.rod import Motion

_OUTER = 1.0 / (4.0 - 4.0 ** (1.0 / 3.0))
SHARES = (_OUTER, _OUTER, 1.0 - 4.0 * _OUTER, _OUTER, _OUTER)
"""Of the five steps in the whole; they add up to 1."""


def advance_undamped(
    state: State, drive: Drive, system: System, contacts: Contacts, motion: Motion, forces: Forces
) -> tuple[int, int]:
    """Advance an undamped state in place by all sub-steps, as :func:`mbpam_ros.plant.multibody.advance` does."""
    parts = tuple(system._replace(step_s=share * system.step_s) for share in SHARES)
    iterations = 0
    for ends in _ends(drive):
        start = State(*(part.copy() for part in state))
        answer = _composed_step(state, ends, parts, contacts, motion, forces)
        if contacts.count[0]:
            for part, before in zip(state, start, strict=True):
                part[:] = before
            whole = Drive(*(np.ascontiguousarray(values[:: len(SHARES)]) for values in ends))
            answer, count = advance(state, whole, system, contacts, motion, forces)
            iterations = max(iterations, count)
        if answer != OK:
            return answer, iterations
    return OK, iterations


def _composed_step(
    state: State, ends: Drive, parts: tuple[System, ...], contacts: Contacts, motion: Motion, forces: Forces
) -> int:
    """Advance by one sub-step; stop where something touches."""
    for k, part in enumerate(parts):
        drive = Drive(*(values[k : k + 2] for values in ends))
        answer, _ = advance(state, drive, part, contacts, motion, forces)
        if answer != OK or contacts.count[0]:
            return answer
    return OK


def _ends(drive: Drive) -> Iterator[Drive]:
    """Yield the drive at the ends of the five parts of each sub-step; the hand accelerates in all as in the whole."""
    steps, done = len(drive.heights) - 1, np.cumsum((0.0, *SHARES))
    for step in range(steps):
        blend = (step + done) / steps
        yield Drive(
            drive.moments[0] + blend[:, None, None] * (drive.moments[1] - drive.moments[0]),
            drive.stiffnesses[0] + blend[:, None] * (drive.stiffnesses[1] - drive.stiffnesses[0]),
            drive.heights[step] + done * (drive.heights[step + 1] - drive.heights[step]),
            drive.rates[step] + done * (drive.rates[step + 1] - drive.rates[step]),
        )
