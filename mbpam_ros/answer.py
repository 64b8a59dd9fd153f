"""How any part answers a request."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Answer:
    """Whether a request was accepted, and why or why not, for people."""

    accepted: bool
    reason: str
