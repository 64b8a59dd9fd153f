"""Signs of life: whether a node is there, and whether there is only one of it.

Every node publishes ``<its name>/alive`` twenty times a second, from the loop that does its work: a Header with its
time, and in ``frame_id`` which process on which host it is. So a process that ended, one that was stopped, and one
whose loop hangs fall silent alike; two of one name are told apart; and what a clock says on another host is known.

DDS has liveliness of its own. It is asserted by the middleware's thread, so that a loop that hangs passes for alive,
and who asks for it hears nobody who does not offer it, as ``ros2 topic pub`` and most drivers do not.
"""

from __future__ import annotations

import functools
import os
import secrets
import socket
from collections.abc import Iterable
from dataclasses import dataclass

PERIOD_S = 0.05

SILENCE_S = 0.27
"""Silence after which a node counts as gone: five signs lost in a row, which at 5 % loss happens once in two days."""

LIFE_LOOK_S = 0.02
"""How often whoever depends on a node looks; with the silence, less than the 0.3 s within which a death is known."""

LONGEST_LOOK_S = 0.06
"""A look that comes later than this was held up by the computer: the time that the listener itself has slept through
is no silence of others, whose signs wait to be taken."""


HELD_UP_S = 0.03
"""By less a process is held up all the time."""


def alive_topic(node_name: str) -> str:
    """Return the topic, relative to the namespace, on which a node says that it lives."""
    return f"{node_name}/alive"


@dataclass(frozen=True)
class Instance:
    """One run of a node.

    Args:
        host: name of its computer.
        process: number of its process.
        token: what tells two nodes of one process, or two containers with the same numbers, apart.
    """

    host: str
    process: int
    token: str

    @classmethod
    def of_this_process(cls) -> Instance:
        """Return a new one."""
        return cls(socket.gethostname().replace(" ", "_"), os.getpid(), secrets.token_hex(4))

    @classmethod
    @functools.lru_cache(maxsize=64)
    def read(cls, text: str) -> Instance:
        """Return what :meth:`__str__` gave; a text from elsewhere stands for itself."""
        try:
            host, process, token = text.rsplit(" ", 2)
            return cls(host, int(process), token)
        except ValueError:
            return cls(text, 0, "")

    def __str__(self) -> str:
        return f"{self.host} {self.process} {self.token}"

    @property
    def words(self) -> str:
        """Where to find it, for people."""
        return f"process {self.process} on {self.host}"


def places(instances: Iterable[Instance]) -> str:
    """Return where to find some runs, for people."""
    return ", ".join(each.words for each in instances)


class SignsOfLife:
    """What is heard of the nodes of one name."""

    def __init__(self) -> None:
        self._silence_s: dict[Instance, float] = {}
        self._looked_s: float | None = None

    def hear(self, instance: Instance) -> None:
        """Take a sign."""
        self._silence_s[instance] = 0.0

    def look(self, now_s: float, held_up_s: float = 0.0) -> tuple[Instance, ...]:
        """Return the runs that are alive; call it steadily.

        Args:
            now_s: now, of a clock that nobody can set.
            held_up_s: for how long the listener itself was held up lately; then others may have been too, and are given
                as much more time.
        """
        patience_s = SILENCE_S + (held_up_s if held_up_s > HELD_UP_S else 0.0)
        passed_s = 0.0 if self._looked_s is None else min(now_s - self._looked_s, LONGEST_LOOK_S)
        self._looked_s = now_s
        silence_s = {instance: so_far_s + passed_s for instance, so_far_s in self._silence_s.items()}
        self._silence_s = {instance: each_s for instance, each_s in silence_s.items() if each_s <= patience_s}
        return tuple(self._silence_s)
