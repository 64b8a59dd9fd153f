"""Whether a closed hand holds something: held, empty or unknown, with a confidence.

Each sense gives the logarithm of how many times likelier what it finds is with an object than without, and they are
added (they err independently of each other):

    log (P(held) / P(empty)) = l_air + l_camera.

*Air*: how many degrees the fingers are bent less than those of an empty hand in the same mode at the same pressure
(:mod:`~mbpam_ros.grasp.air_bend`), in the mean over the fingers, weighed by a line per mode. *Camera*: whether an
object still shows where it was, seen from the hand, after the hand has been raised; one that was left behind is seen
smaller, as it is farther away.

Held is claimed from a probability of ``claim_from`` on and kept down to ``keep_until``; likewise empty. Between them,
and where no sense says anything, it is unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from mbpam_ros.grasp.modes import MODE_NAMES


class Holding(Enum):
    """Whether the hand holds something."""

    HELD = "held"
    EMPTY = "empty"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class AirWeights:
    """log(P(held) / P(empty)) = at_zero + per_deg * shortfall, no more than ``most`` either way."""

    at_zero: float
    per_deg: float
    most: float = 6.0


@dataclass(frozen=True)
class HoldingConfig:
    """How the senses are weighed.

    Args:
        claim_from, keep_until: probabilities from which held or empty is claimed, and down to which it is kept.
        air: weights by mode, from ``mbpam judge-holding --fit``; none: the air is not listened to.
        camera_in_place: log of the likelihood ratio of an object that shows where it was.
        camera_farther: of one that shows farther away than it was.
        camera_nothing: of no object seen.
        camera_size_ratio: an object at least so much of its former size in the image is where it was.
        camera_confidence_min: of a detection that counts; crossed fingers look a little like an object.
    """

    claim_from: float = 0.95
    keep_until: float = 0.85
    air: dict[str, AirWeights] = field(default_factory=dict)
    camera_in_place: float = 4.0
    camera_farther: float = -4.0
    camera_nothing: float = 0.0
    camera_size_ratio: float = 0.8
    camera_confidence_min: float = 0.5

    def __post_init__(self) -> None:
        if not 0.5 < self.keep_until <= self.claim_from < 1.0:
            raise ValueError(
                f"0.5 < keep_until <= claim_from < 1 must hold, found {self.keep_until:g} and {self.claim_from:g}"
            )
        unknown = set(self.air) - set(MODE_NAMES)
        if unknown:
            raise ValueError(f"air: {', '.join(sorted(unknown))} is none of {', '.join(MODE_NAMES)}")


class Verdict(NamedTuple):
    """What is known of the hand.

    Args:
        holding: held, empty or unknown.
        probability: that it holds something; 0.5 where no sense says anything.
        by: the senses that said something.
    """

    holding: Holding
    probability: float
    by: tuple[str, ...]

    @property
    def confidence(self) -> float:
        """Of the claim; of unknown, 0."""
        if self.holding is Holding.UNKNOWN:
            return 0.0
        return self.probability if self.holding is Holding.HELD else 1.0 - self.probability


NOTHING_KNOWN = Verdict(Holding.UNKNOWN, 0.5, ())


class HoldingJudge:
    """Weighs the senses of one grasp after the other."""

    def __init__(self, config: HoldingConfig) -> None:
        self._config = config
        self.begin()

    def begin(self) -> None:
        """Forget the last grasp."""
        self._evidence: dict[str, float] = {}
        self._claimed = Holding.UNKNOWN

    def feel(self, mode: str, shortfall_deg: float) -> None:
        """Take by how much the fingers are bent less than an empty hand's [deg]; NaN: not known."""
        weights = self._config.air.get(mode)
        if weights is None or not math.isfinite(shortfall_deg):
            self._evidence.pop("air", None)
            return
        told = weights.at_zero + weights.per_deg * shortfall_deg
        self._evidence["air"] = min(max(told, -weights.most), weights.most)

    def see(self, size_ratio: float | None) -> None:
        """Take what the camera shows after the hand was raised.

        Args:
            size_ratio: size in the image of what shows where the object was, over its size there before the fingers
                closed; none: nothing shows there.
        """
        config = self._config
        if size_ratio is None:
            self._evidence["camera"] = config.camera_nothing
        else:
            there = size_ratio >= config.camera_size_ratio
            self._evidence["camera"] = config.camera_in_place if there else config.camera_farther

    def verdict(self) -> Verdict:
        """Return what the senses say together, with hysteresis over the calls."""
        by = tuple(sense for sense, told in self._evidence.items() if told != 0.0)
        if not by:
            self._claimed = Holding.UNKNOWN
            return NOTHING_KNOWN
        probability = 1.0 / (1.0 + math.exp(-sum(self._evidence.values())))
        config = self._config
        likelier = Holding.HELD if probability > 0.5 else Holding.EMPTY
        sureness = max(probability, 1.0 - probability)
        enough = config.keep_until if likelier is self._claimed else config.claim_from
        self._claimed = likelier if sureness >= enough else Holding.UNKNOWN
        return Verdict(self._claimed, probability, by)
