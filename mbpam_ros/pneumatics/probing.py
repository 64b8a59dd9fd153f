"""Test pulses for valves that rest: what a closed valve and a steady reading cannot tell.

While a grasp is held its loops rest with their valves closed, and a transducer that stands still in its noise, a valve
that no longer moves, or a supply that is gone looks just like health. Every ``period_s`` each held chamber therefore
gets a little air, and gives it back: at the opening that moves a sound chamber by the pulse in ``pulse_time_s``, up, a
wait, down, a wait. With y0, y1, y2 the mean readings before, between and after,

    d = 2 y1 - y0 - y2

is twice the pulse in a sound channel, whatever leaks steadily, and none where nothing follows. One chamber of each
finger has its turn at a time: those of a turn that fail together have no supply, and one that fails while a neighbour
answers has been swapped with it. A failure is looked at once more at once, and named if it comes again. Pulses go up
first, so that a grip is never weaker for them, and by less than what a loop leaves alone. A small opening lets through
less, or more, of what a wide one does (0.4 with the valves of the model iso6358): from each answer a channel's next
pulses at the same set-point are brought nearer to their height; what it has shown once it must go on to show, so that a
slow valve does not pass for a small one.

Where the assumed law of a valve is right but for its factor, its C, that factor moves a pulse's rise r = y1 - y0 and
its fall f = y1 - y2 alike, and r / f tells of the supply: with orifices (ISO 6358) and p the chamber's pressure, a tank
at ps instead of the assumed p_s fills by

    r / f = ps' psi(p' / ps') / (p_s' psi(p' / p_s')),

so that a tank that its regulator no longer fills shows before it wants. The median of the last pulses of all channels
counts: one has 0.1 of noise in it, and 0.04 of a leak within the data sheet, and a hand that is lowered moves several.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, CHANNEL_COUNT, same_finger
from mbpam_ros.configuration import require_positive
from mbpam_ros.pneumatics.assumed_valve import AssumedValve
from mbpam_ros.pneumatics.findings import Fault
from mbpam_ros.pneumatics.observer import Observer

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

MEAN_TICKS = 5
LEAST_DROP_PA = 1e4
"""A valve is taken to have at least this pressure difference."""
_LEARNT_SHARE = 0.5
_PULSES_KEPT, _PULSES_THAT_TELL = 20, 10
_GREATEST_PULSE = 1.7
"""Times its height: what moves further is moved by something else."""
_LEAST_ANSWER, _GREATEST_ANSWER = 0.35, 2.5


@dataclass(frozen=True)
class ProbingConfig:
    """Test pulses of valves at rest.

    Args:
        period_s: from a chamber's pulse to its next; 0 for none.
        pulse_pa: height of a pulse.
        pulse_time_s: how long the valve is open for it.
        wait_time_s: from one pulse to the next.
        least_share: a chamber that answers with less of the pulse fails ...
        least_learnt_share: ... or with less of what it has answered at this set-point before.
        least_supply_share: a supply that fills so much less than it should, in the median of pulses, is low.
        noise_ratio: channels noisier than this many times the data sheet are not tested.
    """

    period_s: float = 2.0
    pulse_pa: float = 800.0
    pulse_time_s: float = 0.02
    wait_time_s: float = 0.1
    least_share: float = 0.32
    least_learnt_share: float = 0.42
    least_supply_share: float = 0.8
    noise_ratio: float = 2.5

    def __post_init__(self) -> None:
        require_positive(
            self, "pulse_pa", "pulse_time_s", "wait_time_s", "least_share", "least_learnt_share", "least_supply_share",
            "noise_ratio",
        )  # fmt: skip
        if self.period_s < 0.0:
            raise ValueError(f"period_s must not be negative, found {self.period_s}")


class Prober:
    """Gives the test pulses and tells an observer what came of them."""

    def __init__(self, config: ProbingConfig, valve: AssumedValve, observer: Observer) -> None:
        self._config, self._valve, self._observer = config, valve, observer
        self._tested_at_s = np.full(CHANNEL_COUNT, -math.inf)
        self._answer, self._learnt = np.ones(CHANNEL_COUNT), np.zeros(CHANNEL_COUNT, dtype=bool)
        self._supply_shares: deque[float] = deque(maxlen=_PULSES_KEPT)
        self.abort()

    def abort(self) -> None:
        """Leave the pulse that is under way."""
        self._channels = np.zeros(CHANNEL_COUNT, dtype=bool)
        self._begun_s = -math.inf
        self._means: list[Vector] = []
        self._again = False

    @property
    def tested(self) -> Mask:
        """Channels under test, whose valves follow :meth:`openings`, shape (16,)."""
        return self._channels

    def due(self, time_s: float, channels: Mask, at_once: bool) -> Mask:
        """Return which of these channels, shape (16,), are to be tested once they are ready."""
        return channels & (time_s - self._tested_at_s >= (0.0 if at_once else self._config.period_s))

    def update(self, time_s: float, ready: Mask, quiet: Mask, at_once: bool) -> None:
        """Begin, go on with or judge a test.

        Args:
            ready: channels that may be tested: held, at rest, nothing known against them. Shape (16,).
            quiet: channels at rest whose reading may answer to another's pulse. Shape (16,).
            at_once: test whatever is ready, due or not.
        """
        if self._config.period_s == 0.0:
            return
        if np.count_nonzero(self._channels):
            self._go_on(time_s, ready, quiet)
        if not np.count_nonzero(self._channels):
            self._begin(time_s, ready, at_once)

    def openings(self, time_s: float, pressure_gauge_pa: Vector) -> Vector:
        """Return the spool openings of the channels under test, shape (16,); 0 between pulses."""
        config, since_s = self._config, time_s - self._begun_s
        step = int((since_s + 1e-9) / config.wait_time_s)
        if since_s - step * config.wait_time_s >= config.pulse_time_s - 1e-9 or step > 1:
            return np.zeros(CHANNEL_COUNT)
        valve = self._valve
        if step == 0:
            supply_pa = valve.supply_gauge_pa
            rate = valve.fill_pa_s(np.minimum(pressure_gauge_pa, supply_pa - LEAST_DROP_PA), supply_pa)
        else:
            rate = valve.vent_pa_s(np.maximum(pressure_gauge_pa, LEAST_DROP_PA))
        wanted = config.pulse_pa / (self._answer * self._observer.gain * config.pulse_time_s)
        opening = np.minimum(wanted / rate, 1.0)
        return np.where(self._channels, opening if step == 0 else -opening, 0.0)

    def _begin(self, time_s: float, ready: Mask, at_once: bool) -> None:
        due = self.due(time_s, ready, at_once)
        if not np.count_nonzero(due):
            return
        due &= self._observer.reading_noise_pa < self._config.noise_ratio * self._observer.sound_noise_pa
        if due.any():
            anew = self._observer.aimed_at_s > self._tested_at_s
            self._answer[anew], self._learnt[anew] = 1.0, False
            self._channels = _one_of_each_finger(due)
            self._start(time_s)

    def _start(self, time_s: float) -> None:
        self._begun_s = time_s
        self._means = [self._observer.mean_reading(MEAN_TICKS)]

    def _go_on(self, time_s: float, ready: Mask, quiet: Mask) -> None:
        if not (ready | ~self._channels).all():
            self.abort()
            return
        if time_s - self._begun_s < len(self._means) * self._config.wait_time_s - 1e-9:
            return
        self._means.append(self._observer.mean_reading(MEAN_TICKS))
        if len(self._means) < 3:
            return
        before, between, after = self._means
        share = (2.0 * between - before - after) / (2.0 * self._config.pulse_pa)
        least = np.where(self._learnt, self._config.least_learnt_share, self._config.least_share)
        failed = self._channels & (share < least)
        self._learn(self._channels & ~failed, share)
        self._judge_supply(self._channels & ~failed, between - before, between - after)
        self._tested_at_s[self._channels] = time_s
        if failed.any() and not self._again:
            self._again = True
            # With others beside it: if they fail too it is the supply.
            elsewhere = ~_fingers_of(failed)
            self._channels = failed | _one_of_each_finger(ready & elsewhere)
            self._start(time_s)
            return
        if failed.any():
            self._name(failed, share, quiet & ~self._channels)
        self.abort()

    def _learn(self, channels: Mask, share: Vector) -> None:
        learnt = self._answer * (1.0 + _LEARNT_SHARE * (share - 1.0))
        self._answer = np.where(channels, np.clip(learnt, _LEAST_ANSWER, _GREATEST_ANSWER), self._answer)
        self._learnt |= channels

    def _judge_supply(self, channels: Mask, risen_pa: Vector, fallen_pa: Vector) -> None:
        """Compare what pulses fill with what they vent, over the last ones of all channels."""
        if not self._valve.lasting or not channels.any():
            return
        greatest_pa = _GREATEST_PULSE * self._config.pulse_pa
        plain = channels & (fallen_pa > 0.0) & (np.maximum(risen_pa, fallen_pa) < greatest_pa)
        self._supply_shares.extend((risen_pa[plain] / fallen_pa[plain]).tolist())
        share = statistics.median(self._supply_shares or (1.0,))
        if len(self._supply_shares) >= _PULSES_THAT_TELL and share < self._config.least_supply_share:
            self._supply_shares.clear()
            said = f"test pulses fill {100.0 * share:.0f} % of what they vent, in the median of all channels"
            self._observer.find(Fault.SUPPLY_LOW, (), said, 0.99)

    def _name(self, failed: Mask, share: Vector, quiet: Mask) -> None:
        pulse = f"{100.0 * float(share[failed].mean()):.0f} % of a test pulse of {self._config.pulse_pa:.0f} Pa"
        if failed.sum() > 1:  # of different fingers at once: two valves do not fail together
            self._observer.find(Fault.SUPPLY_LOW, (), f"{failed.sum()} channels at once showed {pulse}", 0.99)
            return
        answers = quiet & (share > 0.5)
        for channel in np.flatnonzero(failed):
            here = int(channel)
            others = np.flatnonzero(answers & same_finger(here))
            if others.size == 1:
                pair = (min(here, int(others[0])), max(here, int(others[0])))
                self._observer.find(Fault.SWAPPED, pair, "with each other: one answers to the other's test pulse", 0.99)
            else:
                self._observer.find(Fault.NOT_FOLLOWING, (here,), f"showed {pulse}, twice", 0.99)


def _fingers_of(channels: Mask) -> Mask:
    """Return all channels of the fingers these belong to, shape (16,)."""
    return np.repeat(channels.reshape(-1, CHAMBERS_PER_FINGER).any(axis=1), CHAMBERS_PER_FINGER)


def _one_of_each_finger(due: Mask) -> Mask:
    """Return the first channel of each finger that is due, shape (16,)."""
    fingers = due.reshape(-1, CHAMBERS_PER_FINGER)
    first = np.zeros_like(fingers)
    first[np.arange(fingers.shape[0]), fingers.argmax(axis=1)] = True
    return np.asarray((first & fingers).ravel())
