"""Which gaps count as contacts: those that may close within the step."""

from __future__ import annotations

from typing import NamedTuple

from mbpam_ros.plant.mechanics.contact_config import ContactKind
from mbpam_ros.plant.mechanics.contact_law import Contacts
from mbpam_ros.plant.mechanics.kernel import kernel
from mbpam_ros.plant.mechanics.vectors import Array


class Outlook(NamedTuple):
    """How far a step may see things coming.

    Args:
        step_s: its length h.
        reach: gaps from here on cannot close [m].
        pull: what may close without a speed, h^2 |g| [m]; of gaps that are wider only those are contacts that close
            within two steps, going on as before.
        velocity: of the system, as it is expected, shape (n,).
        object: place of the object's six in it.
    """

    step_s: float
    reach: float
    pull: float
    velocity: Array
    object: int


@kernel
def closes(contacts: Contacts, n: int, outlook: Outlook) -> bool:
    """Whether row n overlaps, or its gap may close; its Jacobian and bodies are there already."""
    if contacts.depth[n] > -outlook.pull:
        return True
    if outlook.pull >= outlook.reach:
        return True
    coordinates, normal, jacobian, velocity = contacts.coordinates, contacts.normal, contacts.jacobian, outlook.velocity
    one, kind, approach = coordinates * contacts.finger[n], contacts.kind[n], 0.0
    other, columns = outlook.object, 6
    if kind == ContactKind.FINGER_FINGER:
        other, columns = coordinates * contacts.other[n], coordinates
    elif kind == ContactKind.FINGER_SUPPORT:
        columns = 0
    for i in range(3):
        rate = contacts.rise[n] if i == 2 else 0.0
        for j in range(coordinates):
            rate += jacobian[n, j, i] * velocity[one + j]
        for j in range(columns):
            rate += jacobian[n, coordinates + j, i] * velocity[other + j]
        approach -= normal[n, i] * rate
    return contacts.depth[n] + 2.0 * outlook.step_s * approach > -outlook.pull
