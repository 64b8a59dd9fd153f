"""Which gaps count as contacts: those that may close within the step."""

from __future__ import annotations

from typing import NamedTuple

from mbpam_ros.plant.mechanics.kernel import kernel
from mbpam_ros.plant.mechanics.rod import Motion, Rod
from mbpam_ros.plant.mechanics.vectors import Array, Vector, cross, minus, plus, vector


class Outlook(NamedTuple):
    """How far a step may see things coming.

    Args:
        step_s: its length h.
        reach: gaps from here on cannot close [m].
        pull: gaps below are contacts however they move [m]; of those up to ``reach`` the ones that close within two
            steps if all goes on as it does.
        velocity: of the system, shape (n,).
        rates: of the directors of the muscles, shape (4, N + 1, 3).
    """

    step_s: float
    reach: float
    pull: float
    velocity: Array
    rates: Array


@kernel
def write_rates(motion: Motion, coordinates: int, velocity: Array, rates: Array) -> None:
    """Write the rates of the directors."""
    slope = motion.slope
    for f in range(rates.shape[0]):
        for k in range(rates.shape[1]):
            for i in range(3):
                total = 0.0
                for j in range(coordinates):
                    total += slope[k, i, j, f] * velocity[f * coordinates + j]
                rates[f, k, i] = total


@kernel
def ball_velocity(rod: Rod, outlook: Outlook, finger: int, ball: int) -> Vector:
    """Return the velocity of a ball against the clamp."""
    x, y, z = 0.0, 0.0, 0.0
    for k in range(outlook.rates.shape[1]):
        weight, rate = rod.balls[ball, k], outlook.rates[finger, k]
        x, y, z = x + weight * rate[0], y + weight * rate[1], z + weight * rate[2]
    return x, y, z


@kernel
def object_velocity(outlook: Outlook, first: int, place: Vector) -> Vector:
    """Return the velocity of an object at a place from its centre; its six begin at ``first``."""
    return plus(vector(outlook.velocity, first), cross(vector(outlook.velocity, first + 3), place))


@kernel
def closes(outlook: Outlook, depth: float, normal: Vector, pusher: Vector, pushed: Vector) -> bool:
    """Whether there is a contact where the velocities of the two bodies are these."""
    if depth > -outlook.pull:
        return True
    relative = minus(pusher, pushed)
    approach: float = normal[0] * relative[0] + normal[1] * relative[1] + normal[2] * relative[2]
    return depth + 2.0 * outlook.step_s * approach > -outlook.pull
