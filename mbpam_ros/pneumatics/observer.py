r"""Sixteen observers: does a channel's reading move as its valve and the supply allow?

The valve and chamber assumed (:mod:`~mbpam_ros.pneumatics.assumed_valve`) move the pressure at the opening s by s f(p)
to fill and s v(p) to vent. A sound machine may be slower or faster by the factors k_low and k_high, so that over an
interval the reading moves by no less than l dt and no more than h dt, with

    h = k_high s f(p) for s > 0, -k_low |s| v(p) for s < 0,
    l = k_low  s f(p) for s > 0, -k_high |s| v(p) for s < 0,

s being the greatest, for l the least, opening commanded in the time that a command takes to show in a reading
(``lag_time_s``: spool, filter, a sample or two of transport). What the reading does beyond that is summed, with a slack
c a second taken off (a one-sided cumulative sum, Page 1954):

    U <- max(0, U + dp - h dt - c dt),    D <- max(0, D + l dt - dp - c dt).

A sum telescopes, so that white noise of the reading does not add up in it, and a threshold is compared with pressure
itself: what a fault must have moved, or failed to move, before it is named. Where the chambers have a volume, their
muscle's bend can move the pressure too, back and forth but not on and on, nor within a sample: what it can is added to
the thresholds. A channel that does not follow is first closed and looked at: a leak then goes on falling, a slow valve
goes on filling, and what neither does is a valve that stays closed or a transducer that stands still.

Slower than the slack, with the valve closed: the slope of the reading over all stretches in which the valve was closed,
by least squares with a mean of its own for each stretch, and what the valve has had to add, times k_low. Air that was
added and does not show is that of a drift or leak only as far as it went no faster than a transducer drifts; what went
faster has gone where a bend made room, as much as it can, and a bend gives back. Noise: mean square of the second
difference of the reading, which a steady rate does not enter; for a data sheet's sigma and the first-order low-pass of
gain a it is sigma^2 a / (2 - a) (6 - 8 (1 - a) + 2 (1 - a)^2).

What cannot be told: a reading that drifts slower than ``slow_rate_pa_s``, or noise less than ``noise_ratio`` times the
data sheet's; a leak from a drift faster than ``drift_limit_pa_s``, which counts as a leak; and, without a test pulse
(:mod:`~mbpam_ros.pneumatics.probing`), anything about a valve that rests. O(1) a tick for all channels together.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, CHANNEL_COUNT, CHANNEL_NAMES, same_finger
from mbpam_ros.configuration import require_positive
from mbpam_ros.pneumatics.assumed_valve import AssumedValve
from mbpam_ros.pneumatics.findings import SUPPLY, Fault, Finding
from mbpam_ros.pneumatics.sensing import SensingConfig
from mbpam_ros.pneumatics.transducer import TransducerConfig

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

READINGS_KEPT = 8
_MOMENT = np.arange(6) - 2.5
_DOUBT_S = 0.5
_GREATEST_LEAK_1_S = 2.0
_NOMINAL_TICK_S = 0.01
_SLOW_TICKS = 5
_SPLIT_LOOKS = 4
"""Of :data:`_SLOW_TICKS`, in which a reading has caught up with its valve."""
_SOUND_SHARE = 0.66
"""Of the air counted, which a valve has let through at least where the law assumed of it is not a lasting one."""
_BEND_TIME_S = 0.15
"""In which a muscle can bend as far as it does in use."""
_LEAST_FALL_PA_S = 10e3
_LEARNT_SHARE = 0.6
"""Of the rate that a valve has shown, which it goes on showing where the law assumed of it is a lasting one."""


@dataclass(frozen=True)
class ObserverConfig:
    """Bounds of a sound machine, wide on purpose.

    Args:
        slowest_ratio: k_low, least true over assumed rate of a sound valve.
        fastest_ratio: k_high, greatest.
        lag_time_s: time in which a command shows in a reading.
        follow_threshold_pa: what a filling channel may lag behind the least that it must do.
        move_threshold_pa: what a reading may move beyond what its valve allows.
        jump_threshold_pa: what it may move in one sample beyond a valve that is fully open.
        follow_slack_pa_s: taken off a second while the valve fills.
        move_slack_pa_s: taken off a second otherwise: slower than this is left to the slope.
        look_time_s: how long a channel that does not follow is closed and looked at.
        slow_rate_pa_s: slope of a reading with its valve closed that a sound channel may have, leaks within the data
            sheet included.
        drift_limit_pa_s: a reading that falls faster leaks: no transducer drifts so fast.
        unexplained_limit_pa: air that may be added to, or let out of, a channel that leaks or drifts until one knows.
        noise_ratio: noise of a sound transducer over its data sheet's.
        settle_time_s: after a new set-point slopes and noise are not looked at.
        clear_time_s: a vented channel without anything odd for this long is sound again.
        clear_below_gauge_pa: a reading below this counts as vented.
    """

    slowest_ratio: float = 0.35
    fastest_ratio: float = 2.5
    lag_time_s: float = 0.03
    follow_threshold_pa: float = 1500.0
    move_threshold_pa: float = 3000.0
    jump_threshold_pa: float = 8000.0
    follow_slack_pa_s: float = 2000.0
    move_slack_pa_s: float = 10000.0
    look_time_s: float = 0.1
    slow_rate_pa_s: float = 220.0
    drift_limit_pa_s: float = 3000.0
    unexplained_limit_pa: float = 6000.0
    noise_ratio: float = 3.0
    settle_time_s: float = 1.0
    clear_time_s: float = 1.0
    clear_below_gauge_pa: float = 5000.0

    def __post_init__(self) -> None:
        require_positive(self, *self.__dataclass_fields__)
        if not self.slowest_ratio < 1.0 < self.fastest_ratio:
            raise ValueError(
                f"slowest_ratio = {self.slowest_ratio:g} and fastest_ratio = {self.fastest_ratio:g} must have 1 "
                "between them"
            )


@dataclass(frozen=True)
class ReadingNoise:
    """The noise of a sound reading.

    Args:
        noise_pa: data sheet noise of one raw sample.
        cutoff_hz: of the low-pass between sample and reading.
    """

    noise_pa: float
    cutoff_hz: float

    @staticmethod
    def of(transducer: TransducerConfig, sensing: SensingConfig) -> ReadingNoise:
        """Return that of a transducer and what reads it, quantisation included."""
        noise_v = math.sqrt(transducer.noise_v**2 + transducer.resolution_v**2 / 12.0)
        return ReadingNoise(transducer.gain_pa_v * noise_v, sensing.cutoff_hz)


_greatest = np.maximum.reduce
_NAMED_AT_ONCE = (
    Fault.JUMPED, Fault.SWAPPED, Fault.RISES, Fault.NOT_FOLLOWING, Fault.NOT_VENTING, Fault.SLOW_VALVE, Fault.LEAK,
    Fault.LEAKS_IN,
)  # fmt: skip
_NONE = np.zeros(CHANNEL_COUNT, dtype=bool)
_NONE.flags.writeable = False
_ALL = ~_NONE
_ALL.flags.writeable = False
_ZEROS = np.zeros(CHANNEL_COUNT)
_ZEROS.flags.writeable = False
_ONES = np.ones(CHANNEL_COUNT)
_COMMANDS_KEPT = 3
"""As many ticks as a command takes to show."""


def _first_beside(channel: int, mask: Mask) -> int | None:
    """Return the first of the mask's channels in a channel's finger, if there is one."""
    others = np.flatnonzero(mask & same_finger(channel))
    return int(others[0]) if others.size > 0 else None


def _mask_of(channels: Collection[int]) -> Mask:
    if not channels:
        return _NONE
    mask = np.zeros(CHANNEL_COUNT, dtype=bool)
    mask[list(channels)] = True
    return mask


class _Course(NamedTuple):
    """One interval: length, readings before, how they moved, openings that may show in it, which were read.

    ``still``: all valves were closed, and all channels read.
    """

    dt_s: float
    last: Vector
    moved: Vector
    low: Vector
    high: Vector
    valid: Mask
    still: bool


class _Look(NamedTuple):
    """A channel that is closed and looked at: since when, whether it and who else filled, how far it was behind."""

    since_s: float
    filled: bool
    filling: Mask
    behind_pa: float


class Observer:
    """Watches readings beside commands; names what cannot be.

    Each tick: :meth:`update` with the reading, then :meth:`commanded` with the openings that follow from it.
    """

    _effort_pa: Vector
    _effort_from_pa: Vector
    _effort_s: float

    def __init__(self, config: ObserverConfig, valve: AssumedValve, noise: ReadingNoise) -> None:
        self._config, self._valve, self._noise = config, valve, noise
        alpha = self._filter_gain = -math.expm1(-2.0 * math.pi * noise.cutoff_hz * _NOMINAL_TICK_S)
        self._filtered_noise_pa2 = noise.noise_pa**2 * alpha / (2.0 - alpha)
        self._sound_noise_pa = math.sqrt(self._filtered_noise_pa2)
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forget everything, findings too."""
        n = CHANNEL_COUNT
        self._time_s, self._interval_s, self.held_up = -math.inf, _NOMINAL_TICK_S, False
        self._findings: dict[tuple[Fault, tuple[str, ...]], Finding] = {}
        self._masks: dict[tuple[Fault, ...], Mask] = {}
        self._odd_at_s = np.full(n, -math.inf)
        self._supply_since_s, self._supply_open = -math.inf, True
        self._targets: Vector | None = None
        self.aimed_at_s = np.full(n, -math.inf)
        self._settled_at_s = np.full(n, -math.inf)
        self.gain = np.ones(n)
        self._slowest = np.full(n, self._config.slowest_ratio)
        self._filled, self._filling = np.zeros(n), np.zeros(n)
        self._noise_pa2 = np.full(n, self._filtered_noise_pa2)
        self._lasting_noise_pa2 = self._noise_pa2.copy()
        self._sigma_pa: Vector = np.sqrt(self._noise_pa2)
        self._margin_pa: Vector = np.zeros(n)
        self._ticks = 0
        self._leak_1_s = np.zeros(n)
        self._drawn = 0.0
        self._bent_pa: Vector = np.zeros(n)
        self._lost_s, self._losing = np.zeros(n), False
        self._rises: dict[int, float] = {}
        self._looks: dict[int, _Look] = {}
        self._forget_course()

    def _forget_course(self) -> None:
        """Start all sums anew, as after a gap in the readings."""
        n = CHANNEL_COUNT
        self._readings = np.full((READINGS_KEPT, n), np.nan)
        self._low = np.zeros((_COMMANDS_KEPT, n))
        self._high = np.zeros((_COMMANDS_KEPT, n))
        self._closed_commands = 0
        self._fills = np.zeros((6, n))
        self._closed_ticks = np.zeros(n, dtype=int)
        self._up, self._down = np.zeros(n), np.zeros(n)
        self._beyond, self._fastest_pa = np.zeros((READINGS_KEPT - 1, n)), (0.0,) * (READINGS_KEPT - 1)
        self._gone, self._come = np.zeros(n), np.zeros(n)
        self._slope = _Slopes()
        self._forget_effort()
        self._in_vain_pa = np.zeros(n)
        self._unexplained_pa, self._bends_pa, self._hidden_pa = np.zeros(n), np.zeros(n), np.zeros(n)
        self._explained_at_s, self._explained_bends_pa = np.full(n, -math.inf), np.zeros(n)
        self._added_pa, self._unseen = np.zeros(n), True

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What stands."""
        return tuple(self._findings.values())

    def channels(self, *faults: Fault) -> Mask:
        """Return which channels have one of these faults, shape (16,)."""
        if not self._findings:
            return _NONE
        if faults not in self._masks:
            mask = np.zeros(CHANNEL_COUNT, dtype=bool)
            for fault, names in self._findings:
                if fault in faults:
                    mask[[CHANNEL_NAMES.index(name) for name in names]] = True
            mask.flags.writeable = False
            self._masks[faults] = mask
        return self._masks[faults]

    @property
    def leak_1_s(self) -> Vector:
        """One over the time constants of the leaks that were found, shape (16,)."""
        return np.minimum(np.where(self.channels(Fault.LEAK), self._leak_1_s, 0.0), _GREATEST_LEAK_1_S)

    @property
    def fill_pa_s(self) -> Vector:
        """How fast valves fill when fully open, by their law and what they have shown, shape (16,); NaN unread."""
        supply_pa = self._valve.drawn_supply_gauge_pa(self._drawn)
        return self.gain * self._valve.fill_pa_s(self._readings[-1], supply_pa)

    @property
    def looked_at(self) -> Mask:
        """Channels that must be closed now to see what they do, shape (16,)."""
        return _mask_of(self._looks)

    @property
    def rising(self) -> Mask:
        """Channels whose pressure seems to come in without their valve, not yet named, shape (16,)."""
        return _mask_of(self._rises)

    @property
    def calm(self) -> bool:
        """Whether nothing is found, looked at or suspected."""
        return not (self._findings or self._looks or self._rises)

    @property
    def supply_low(self) -> bool:
        """Whether the supply is known to be low or gone."""
        return (Fault.SUPPLY_LOW, (SUPPLY,)) in self._findings

    @property
    def sound_noise_pa(self) -> float:
        """Noise of a filtered reading by the data sheet [Pa]."""
        return self._sound_noise_pa

    @property
    def reading_noise_pa(self) -> Vector:
        """Noise of the filtered readings as it is, shape (16,) [Pa]."""
        return self._sigma_pa

    @property
    def at_rest(self) -> Mask:
        """Channels whose valve has been closed long enough for the reading to stand, shape (16,)."""
        return np.asarray(self._closed_ticks >= READINGS_KEPT)

    def mean_reading(self, ticks: int) -> Vector:
        """Return the mean of the last few readings, shape (16,) [Pa]."""
        return np.asarray(self._readings[-ticks:].mean(axis=0))

    @property
    def read(self) -> Mask:
        """Channels whose last reading is one, shape (16,)."""
        return np.asarray(np.isfinite(self._readings[-1]))

    def aim(self, target_gauge_pa: Vector, time_s: float) -> None:
        """Take the set-points, shape (16,): what is slow starts anew in fingers that are told to move."""
        if self._targets is None:
            self._targets = np.full(CHANNEL_COUNT, np.nan)
        new = target_gauge_pa != self._targets
        if np.count_nonzero(new):
            self._targets = target_gauge_pa.copy()
            self.aimed_at_s[new] = time_s
            self._filled[new] = self._filling[new] = 0.0
            moving = np.repeat(new.reshape(-1, CHAMBERS_PER_FINGER).any(axis=1), CHAMBERS_PER_FINGER)
            self._settled_at_s[moving] = time_s + self._config.settle_time_s
            self._forget_slow(moving)

    def commanded(self, spool: Vector) -> None:
        """Take the openings, shape (16,), that hold until the next update."""
        self._low[:-1], self._high[:-1] = self._low[1:], self._high[1:]
        self._low[-1] = self._high[-1] = spool
        self._closed_commands = 0 if np.count_nonzero(spool) else self._closed_commands + 1

    def update(
        self, time_s: float, pressure_gauge_pa: Vector, supply_open: bool, vented: bool, late_s: float = 0.0
    ) -> None:
        """Take readings, shape (16,) [Pa gauge], NaN for none, and what was commanded of supply and stop since.

        Args:
            time_s: of the readings.
            late_s: for how long they have waited to be taken: what they are answered with is as late at the valves.
        """
        config = self._config
        dt_s, self._time_s = time_s - self._time_s, time_s
        if supply_open != self._supply_open:
            self._supply_open, self._supply_since_s = supply_open, time_s
        if not 0.0 < dt_s < 0.5:
            if dt_s != 0.0:
                self._forget_course()
            self._keep(pressure_gauge_pa)
            return
        self.held_up = max(dt_s, late_s + _NOMINAL_TICK_S) > 0.8 * config.lag_time_s
        if self.held_up:  # valves close by themselves when no command comes; what came of it says nothing of them
            self._low, self._high = np.minimum(self._low, 0.0), np.maximum(self._high, 0.0)
            self._forget_effort()
        self._interval_s += 0.1 * (dt_s - self._interval_s)
        before = self._readings[-1].copy()
        self._keep(pressure_gauge_pa)
        last, moved, valid = before, self._readings[-1] - before, _ALL
        if not math.isfinite(moved @ _ONES):
            valid = np.isfinite(moved)
            last, moved = np.where(np.isfinite(before), before, 0.0), np.where(valid, moved, 0.0)
        low = high = _ZEROS
        closed = self._closed_commands >= _COMMANDS_KEPT
        if not closed:
            low = np.minimum(np.minimum(self._low[0], self._low[1]), self._low[2])
            high = np.maximum(np.maximum(self._high[0], self._high[1]), self._high[2])
        course = _Course(dt_s, last, moved, low, high, valid, closed and valid is _ALL)
        self._sum_up(course)
        self._ticks += 1
        if self._ticks % 2 == 0:
            self._estimate_noise(course)
        self._judge(course)
        self._judge_slow(course)
        self._clear(valid, vented)

    def _keep(self, pressure_gauge_pa: Vector) -> None:
        self._readings[:-1] = self._readings[1:]
        self._readings[-1] = pressure_gauge_pa
        if not math.isfinite(pressure_gauge_pa @ _ONES):
            self._readings[-1][~np.isfinite(pressure_gauge_pa)] = np.nan

    # Sums

    def _sum_up(self, course: _Course) -> None:
        config, dt_s, moved = self._config, course.dt_s, course.moved
        self._fills[:-1] = self._fills[1:]
        self._fills[-1] = 0.0
        self._beyond[:-1] = self._beyond[1:]
        if course.still:
            self._beyond[-1] = moved
            up = self._up + moved - config.move_slack_pa_s * dt_s
            down = self._down - config.move_slack_pa_s * dt_s - moved
        else:
            most, least = self._allowed(course)
            self._beyond[-1] = moved - np.minimum(np.maximum(moved, least * dt_s), most * dt_s)
            up = self._up + moved - (most + config.move_slack_pa_s) * dt_s
            slack = np.where(course.low > 0.0, config.follow_slack_pa_s, config.move_slack_pa_s)
            down = self._down + (least - slack) * dt_s - moved
        self._bent_pa = self._valve.bend_pa(course.last)
        # What stands must be able to go.
        bound = 2.0 * (config.move_threshold_pa + self._bent_pa) + 12.0 * self._sigma_pa
        self._up, self._down = np.minimum(np.maximum(up, 0.0), bound), np.minimum(np.maximum(down, 0.0), bound)
        if course.valid is not _ALL:
            self._up[~course.valid] = self._down[~course.valid] = 0.0

    def _allowed(self, course: _Course) -> tuple[Vector, Vector]:
        """Return the greatest and the least rate that openings allow, shape (16,) each; learn the valves' rates."""
        config = self._config
        low, high, last = course.low, course.high, course.last
        if not (np.count_nonzero(low) or np.count_nonzero(high)):
            return _ZEROS, _ZEROS
        fill_most, vent_most = self._fastest_pa_s(last)
        slowest, margin = self._slowest, config.move_threshold_pa
        supplied = self._supplied
        supply_pa = self._draw(high, course.dt_s)
        fill_least = slowest * self._fill_pa_s(last + margin, supply_pa) if supplied else _ZEROS
        vent_least = slowest * np.maximum(self._vent_pa_s(last - margin), 0.0)
        most = np.where(high > 0.0, high * fill_most, high * vent_least)
        least = np.where(low < 0.0, low * vent_most, low * fill_least)
        filling = (low > 0.05) & course.valid & ~self.channels(Fault.LEAK)  # what makes up for a leak does not show
        if not supplied:  # what is open to an empty manifold flows back
            least -= np.maximum(high, 0.0) * vent_most
        elif filling.any():
            self._learn(filling, low * self._fill_pa_s(last, supply_pa) * course.dt_s, course.moved)
        return most, least

    def _fill_pa_s(self, pressure_pa: Vector, supply_pa: float) -> Vector:
        """Return how fast a valve fully open fills, shape (16,), as far as a reading can follow a chamber so stiff."""
        shown = np.maximum(supply_pa - pressure_pa, 0.0) / self._config.lag_time_s
        return np.minimum(self._valve.fill_pa_s(pressure_pa, supply_pa), shown)

    def _vent_pa_s(self, pressure_pa: Vector) -> Vector:
        """Return the same of one that vents; what is below ambient by its noise comes back as fast."""
        above_pa = np.abs(pressure_pa)
        rate = np.minimum(self._valve.vent_pa_s(above_pa), above_pa / self._config.lag_time_s)
        return np.copysign(rate, pressure_pa)

    def _draw(self, high: Vector, dt_s: float) -> float:
        """Return the lowest that the supply can be [Pa gauge]: it comes down at once, and fills again in its time."""
        opening = float(np.maximum(high, 0.0).sum())
        self._drawn = max(opening, self._drawn * math.exp(-dt_s / self._valve.refill_time_s))
        return self._valve.drawn_supply_gauge_pa(self._drawn)

    def _fastest_pa_s(self, last: Vector) -> tuple[Vector, Vector]:
        """Return how fast the fastest sound valve fills and vents when fully open, shape (16,) each."""
        valve, fastest = self._valve, self._config.fastest_ratio
        highest_pa = valve.supply_gauge_pa - valve.least_drop_pa
        fill = fastest * valve.fill_pa_s(np.minimum(last, highest_pa), valve.supply_gauge_pa)
        return fill, fastest * valve.vent_pa_s(np.maximum(last, valve.least_drop_pa))

    def _learn(self, filling: Mask, fill_pa: Vector, moved: Vector) -> None:
        """Compare what valves filled with what they should have, over a whole grasp."""
        config = self._config
        self._fills[-1] = np.where(filling, fill_pa, 0.0)
        self._filling += self._fills[-1]
        self._filled += np.where(filling, moved, 0.0)
        known = self._filling > 20e3
        ratio = np.divide(self._filled, self._filling, out=np.ones(CHANNEL_COUNT), where=known)
        ratio = np.minimum(np.maximum(ratio, config.slowest_ratio), config.fastest_ratio)
        self.gain = np.where(known, ratio, self.gain)
        if self._valve.lasting:
            self._slowest = np.maximum(config.slowest_ratio, _LEARNT_SHARE * np.minimum(self.gain, 1.0))

    @property
    def _supplied(self) -> bool:
        """Whether the manifold is known to be full."""
        return self._supply_open and self._time_s - self._supply_since_s > 0.15

    def _estimate_noise(self, course: _Course) -> None:
        """Follow the noise, every second sample; a sample's share is bounded, so that one jump does not make it."""
        second = self._readings[-1] - 2.0 * self._readings[-2] + self._readings[-3]
        calm = np.isfinite(second)
        alpha = -math.expm1(-2.0 * math.pi * self._noise.cutoff_hz * course.dt_s)
        share = 6.0 - 8.0 * (1.0 - alpha) + 2.0 * (1.0 - alpha) ** 2
        sample = np.minimum(second * second / share, 100.0 * self._noise_pa2)
        swing = course.high - course.low
        if not course.still and np.count_nonzero(swing):  # what the valve itself can bend the reading by
            valve, fastest = self._valve, self._config.fastest_ratio * course.dt_s
            fill_pa_s = valve.fill_pa_s(course.last, valve.supply_gauge_pa)
            bent = swing * fastest * np.maximum(fill_pa_s, valve.vent_pa_s(course.last))
            sample = np.maximum(sample - bent * bent / share, 0.0)
        if not calm.all():
            sample = np.where(calm, sample, self._noise_pa2)
        self._noise_pa2 += -math.expm1(-2.0 * course.dt_s / 0.25) * (sample - self._noise_pa2)
        self._noise_pa2 = np.maximum(self._noise_pa2, 0.1 * self._filtered_noise_pa2)
        # To name it slower, and with less of a single sample: one step is no noise.
        sample = np.minimum(sample, 50.0 * self._filtered_noise_pa2)
        self._lasting_noise_pa2 += -math.expm1(-2.0 * course.dt_s / 0.5) * (sample - self._lasting_noise_pa2)
        self._sigma_pa = np.sqrt(self._noise_pa2)
        self._margin_pa = 6.0 * np.maximum(self._sigma_pa - 2.0 * self.sound_noise_pa, 0.0)

    # Fast faults

    def _judge(self, course: _Course) -> None:
        config = self._config
        moved_pa = float(_greatest(np.abs(course.moved)))
        self._fastest_pa = (*self._fastest_pa[1:], moved_pa)
        if moved_pa > config.jump_threshold_pa:
            self._judge_jumps(course)
        if max(self._fastest_pa) > config.move_threshold_pa / 5.0:
            self._judge_steps(config.move_threshold_pa + self._margin_pa)
        if _greatest(self._up) > config.move_threshold_pa or _greatest(self._down) > config.follow_threshold_pa:
            known, margin = self._known, self._margin_pa + self._bent_pa
            least = np.where(course.low > 0.0, config.follow_threshold_pa, config.move_threshold_pa)
            for risen in np.flatnonzero((self._up > config.move_threshold_pa + margin) & ~known):
                self._suspect_rise(int(risen), course.high)
            for fallen in np.flatnonzero((self._down > least + margin) & ~known):
                self._suspect_fall(int(fallen), course.low, course.high)
        self._judge_leaks(course)
        for channel in list(self._rises):
            if channel in self._rises:
                self._judge_rise(channel)
        for channel in list(self._looks):
            if channel in self._looks:
                self._judge_look(channel)

    def _judge_leaks(self, course: _Course) -> None:
        """Name a leak, out or in, that its valve, far open, cannot stop: such a valve does not fill, or not vent.

        And a valve that did not vent because air came in: closed, it goes on rising.
        """
        if not (self._findings or self._losing):
            return
        rising, vents_not = self.channels(Fault.RISES), self.channels(Fault.NOT_VENTING)
        leaks = self.channels(Fault.LEAK) & ~self.channels(Fault.NOT_FOLLOWING)
        leaks_in, vents_not = self.channels(Fault.LEAKS_IN) & ~rising, vents_not & ~rising
        if not (leaks | leaks_in | vents_not).any():
            self._lost_s[:], self._losing = 0.0, False
            return
        self._losing = True
        moves = _MOMENT @ self._readings[-_MOMENT.size :]
        least = _LEAST_FALL_PA_S * self._interval_s * (_MOMENT @ _MOMENT)
        falls = leaks & (moves < -least) & (course.low > 0.5)
        rises_open = leaks_in & (moves > least) & (course.high < -0.5)
        rises_closed = vents_not & (moves > least) & (course.high <= 0.0)
        self._lost_s = np.where(falls | rises_open | rises_closed, self._lost_s + course.dt_s, 0.0)
        for channel in map(int, np.flatnonzero(self._lost_s > self._config.look_time_s)):
            fault, goes = (
                (Fault.NOT_FOLLOWING, "falling though its valve fills")
                if falls[channel]
                else (Fault.RISES, f"rising though its valve {'vents' if rises_open[channel] else 'is closed'}")
            )
            self._find(fault, (channel,), f"goes on {goes}, at {self._kpa(channel)} kPa", 0.99)

    def _judge_jumps(self, course: _Course) -> None:
        fill_pa_s, vent_pa_s = self._fastest_pa_s(course.last)
        beyond = self._config.jump_threshold_pa + self._margin_pa
        jumped = (course.moved > fill_pa_s * course.dt_s + beyond) | (-course.moved > vent_pa_s * course.dt_s + beyond)
        self._name_jumps(np.flatnonzero(jumped & course.valid & ~self._known), course.moved)

    def _judge_steps(self, least_pa: Vector) -> None:
        """Name a reading that went somewhere between two samples and stays: a muscle has inertia.

        The low-pass spreads such a step over some samples, and shows its gain's part of it in the first; a finger that
        snaps takes longer. What a muscle can move the pressure by in three samples, at :data:`_BEND_TIME_S` for all, is
        left to it.
        """
        step = self._beyond.sum(axis=0)
        beyond = np.abs(step) > least_pa + 3.0 * self._interval_s / _BEND_TIME_S * self._bent_pa
        if not beyond.any():
            return
        calm = 0.2 * np.abs(step)
        stands = (np.abs(self._beyond[-3:].sum(axis=0)) < calm) & (np.abs(self._beyond[0]) < calm)
        sharp = self._beyond[1] * np.sign(step) > 0.8 * self._filter_gain * np.abs(step)
        stepped = beyond & stands & sharp & ~self._known
        self._name_jumps(np.flatnonzero(stepped), step)

    @property
    def _known(self) -> Mask:
        """Channels about whose quick movements nothing more is to be said."""
        return self.channels(*_NAMED_AT_ONCE) | self.rising | self.looked_at

    def _name_jumps(self, jumped: NDArray[np.int64], moved: Vector) -> None:
        for channel in map(int, jumped):
            if self._known[channel]:
                continue
            first = channel - channel % CHAMBERS_PER_FINGER
            others = [other for other in range(first, first + CHAMBERS_PER_FINGER) if other != channel]
            partner = min(others, key=lambda other: abs(moved[other] + moved[channel]))
            if abs(moved[partner] + moved[channel]) < 0.25 * abs(moved[channel]):
                self._find_swapped(channel, partner, "changed readings with each other at once")
            else:
                step = f"moved by {1e-3 * moved[channel]:.1f} kPa at once, to {self._kpa(channel)} kPa"
                self._find(Fault.JUMPED, (channel,), f"{step}; no valve can do that", 0.99)

    def _suspect_rise(self, channel: int, high: Vector) -> None:
        before = self._readings[-5, channel]
        if high[channel] < 0.0 and self._readings[-1, channel] - before < 200.0:
            other = self._falling(channel)
            if other is not None:
                self._find_swapped(channel, other, "one vents and stands still while the other falls")
                return
            behind = f"{1e-3 * self._up[channel]:.1f} kPa behind what its valve must vent, at {self._kpa(channel)} kPa"
            self._find(Fault.NOT_VENTING, (channel,), behind, self._confidence(self._up[channel], channel))
        else:
            self._rises[channel] = self._time_s

    def _judge_rise(self, channel: int) -> None:
        """Name it later than it is acted on: by then a channel it was swapped with stands still, or the air goes."""
        since_s = self._rises[channel]
        if self._time_s - since_s < 0.035:
            return
        other = self._standing_still(channel)
        if other is not None:
            self._find_swapped(channel, other, "one rises while the other's valve fills, which stands still")
            return
        if self._time_s - since_s < self._config.look_time_s:
            return
        del self._rises[channel]
        moving = abs(self._rate(channel)) > self._seen_pa_s(channel)
        then = "and moves on" if moving else "and stopped"
        evidence = f"rose beyond what its valve allows, {then} when closed without supply, at {self._kpa(channel)} kPa"
        self._find(Fault.RISES, (channel,), evidence, 0.99 if moving else 0.9)

    def _standing_still(self, channel: int) -> int | None:
        """Return the channel of its finger that filled and did not move while this one rose, if there is one."""
        risen = self._readings[-1] - self._readings[-7]
        least = self._config.slowest_ratio * self._fills.sum(axis=0)
        still = (least > 2000.0) & (risen < 0.2 * least)
        still[channel] = False
        return _first_beside(channel, still)

    def _suspect_fall(self, channel: int, low: Vector, high: Vector) -> None:
        filled = bool(high[channel] >= 0.03)
        self._looks[channel] = _Look(self._time_s, filled, low > 0.05, float(self._down[channel]))

    def _judge_look(self, channel: int) -> None:
        """Say what a channel does that fell or did not follow, after it has been closed for a while."""
        look = self._looks[channel]
        if self._time_s - look.since_s < self._config.look_time_s:
            return
        rate_pa_s, seen_pa_s = self._rate(channel), self._seen_pa_s(channel)
        if rate_pa_s < -seen_pa_s:
            del self._looks[channel]
            other = self._not_falling(channel)
            if other is None:
                self._find_leak(channel, -rate_pa_s)
            else:
                self._find_swapped(channel, other, "one falls while the other's valve vents, which stands still")
        elif not look.filled:
            del self._looks[channel]
            self._find(
                Fault.JUMPED, (channel,), f"fell, and stopped, with its valve closed, at {self._kpa(channel)} kPa", 0.95
            )
        elif np.count_nonzero(look.filling) > 1 and self._all_starved(channel, look):
            self._find_supply(
                f"all {np.count_nonzero(look.filling)} channels that filled fell behind together, at "
                f"{self._kpa(channel)} kPa",
                self._confidence(look.behind_pa, channel),
            )
        elif self._alone(channel, look) and self._time_s - look.since_s < self._config.look_time_s + _DOUBT_S:
            return  # the test pulses of the others may show that there is no supply
        else:
            del self._looks[channel]
            behind = f"{1e-3 * look.behind_pa:.1f} kPa behind the least that its valve must fill"
            evidence, confidence = f"{behind}, at {self._kpa(channel)} kPa", self._confidence(look.behind_pa, channel)
            if rate_pa_s > max(seen_pa_s, 10e3):
                self._find(Fault.SLOW_VALVE, (channel,), f"{evidence}, and it went on filling when closed", confidence)
            else:
                self._find(Fault.NOT_FOLLOWING, (channel,), evidence, confidence)

    def _not_falling(self, channel: int) -> int | None:
        """Return the channel of its finger that vents now and has not fallen as far as it must, if there is one."""
        standing = (self._high.max(axis=0) < 0.0) & (self._up > 0.3 * self._config.move_threshold_pa)
        return _first_beside(channel, standing)

    def _falling(self, channel: int) -> int | None:
        """Return the channel of its finger that falls though its valve does not vent, if there is one."""
        falling = (self._low.min(axis=0) >= 0.0) & (self._down > 0.3 * self._config.move_threshold_pa + self._bent_pa)
        return _first_beside(channel, falling)

    def _all_starved(self, channel: int, look: _Look) -> bool:
        """Return whether every channel that filled then has fallen behind too."""
        behind = self.looked_at | self.channels(Fault.SLOW_VALVE, Fault.NOT_FOLLOWING)
        behind |= self._down > 0.4 * self._config.follow_threshold_pa
        return bool((behind | ~look.filling).all())

    def _alone(self, channel: int, look: _Look) -> bool:
        """Return whether nothing else filled, in a grasp that has long closed."""
        return bool(np.count_nonzero(look.filling) <= 1 and self._time_s > self._settled_at_s[channel])

    @property
    def in_doubt(self) -> bool:
        """Whether a channel did not follow that may want for supply: test pulses of others would tell."""
        return any(look.filled and self._alone(channel, look) for channel, look in self._looks.items())

    # Slow faults

    def _judge_slow(self, course: _Course) -> None:
        """Look at closed channels, every :data:`_SLOW_TICKS`-th sample."""
        config = self._config
        self._closed_ticks = self._closed_ticks + 1
        if not course.still:
            self._closed_ticks *= (course.low == 0.0) & (course.high == 0.0) & course.valid
        self._judge_effort(course)
        self._unseen |= self.held_up
        if self._ticks % _SLOW_TICKS != 0:
            return
        settled = self._time_s > self._settled_at_s
        self._judge_unexplained(settled)
        counts = (self._closed_ticks >= READINGS_KEPT) & settled & ~self._known
        moved = np.where(counts, self._readings[-1] - self._readings[-1 - _SLOW_TICKS], 0.0)
        allowed = config.slow_rate_pa_s * _SLOW_TICKS * course.dt_s * counts
        self._gone = np.maximum(0.0, self._gone - moved - allowed)
        self._come = np.maximum(0.0, self._come + moved - allowed)
        self._slope.add(self._readings[-1], _SLOW_TICKS * course.dt_s, counts)
        # What moves fast is left to the other sums.
        moves = (np.maximum(self._gone, self._come) > 1500.0 + 8.0 * self._sigma_pa + self._bent_pa) & (
            np.maximum(self._up, self._down) < 500.0
        )
        steadily = self._slope.steady(config.slow_rate_pa_s, self._sigma_pa)
        slow = moves | steadily
        if np.count_nonzero(slow):
            for channel in np.flatnonzero(slow & self._unnamed):
                self._name_slow(int(channel))
        self._judge_noise(settled)

    @property
    def _unnamed(self) -> Mask:
        """Channels about whose slow movements something new may be said."""
        return ~(self._known | self.channels(Fault.LEAK_OR_DRIFT, Fault.DRIFT, Fault.LEAKS_IN))

    def _name_slow(self, channel: int) -> None:
        rate_pa_s = self._slope.rate(channel)
        moved_pa, bent_pa = self._unexplained_pa[channel], self._bends_pa[channel]
        self._find_slow(channel, rate_pa_s, "with its valve closed")
        self._forget_slow(np.arange(CHANNEL_COUNT) == channel)
        self._unexplained_pa[channel], self._bends_pa[channel] = moved_pa, bent_pa

    def _judge_effort(self, course: _Course) -> None:
        """Compare what valves had to add with what came of it, a second at a time."""
        opening = self._low[-2]
        if not course.still and np.count_nonzero(opening):
            fill_pa_s = self._fill_pa_s(course.last, self._valve.drawn_supply_gauge_pa(self._drawn))
            added = opening * np.where(opening > 0.0, fill_pa_s, self._vent_pa_s(course.last)) * course.dt_s
            self._effort_pa += added
            self._added_pa += self.gain * added
        self._effort_s += course.dt_s
        if self._effort_s < 1.0:
            return
        settled = (self._time_s > self._settled_at_s + 1.0) & course.valid
        lost = self._slowest * self._effort_pa - (self._readings[-1] - self._effort_from_pa)
        here = settled & self._unnamed & np.isfinite(self._effort_from_pa)
        worked = here & (np.abs(self._effort_pa) > 3e3)
        toward = np.sign(self._effort_pa)
        in_vain_pa = np.maximum(toward * self._in_vain_pa, 0.0) + np.where(worked, toward * lost, 0.0) - 1.0e3
        in_vain = worked & (in_vain_pa > self._bent_pa)
        self._in_vain_pa = np.where(here, toward * np.maximum(in_vain_pa, 0.0), 0.0)
        filled = worked & (self._effort_pa > 0.0)
        if np.count_nonzero(filled) > 1 and (in_vain | ~filled).all():
            self._find_supply(f"all {np.count_nonzero(filled)} channels that filled gained less than they must", 0.95)
        else:
            for channel in np.flatnonzero(in_vain):
                net = self.gain[channel] * self._effort_pa[channel]
                self._find_slow(int(channel), -net / self._effort_s, "by what its valve had to make up for")
        self._effort_pa, self._effort_s = np.zeros(CHANNEL_COUNT), 0.0
        self._effort_from_pa = np.where(settled, self._readings[-1], np.nan)

    def _forget_effort(self) -> None:
        """Begin the second anew."""
        self._effort_pa, self._effort_s = np.zeros(CHANNEL_COUNT), 0.0
        self._effort_from_pa = np.full(CHANNEL_COUNT, np.nan)

    def _judge_unexplained(self, settled: Mask) -> None:
        """End what no one can vouch for once a good deal of air was moved, and the reading shows none of it.

        Air that went in, less what the reading rose, is what has leaked, what a bend made room for, or what a drifting
        transducer does not show. Leaks within the data sheet are taken off until a leak or drift is known, and of what
        is no quick bend a slow one is left what it can take. So a chamber whose reading falls is never filled far
        beyond its set-point.
        """
        config, suspects = self._config, self.channels(Fault.LEAK_OR_DRIFT)
        if not self._unseen:
            shown_pa = self._readings[-1] - self._readings[-1 - _SLOW_TICKS]
            self._hidden_pa += np.where(np.isfinite(shown_pa), self._added_pa - shown_pa, 0.0)
        self._added_pa, self._unseen = np.zeros(CHANNEL_COUNT), False
        counts = settled & self.read & (suspects | self._unnamed)
        if not counts.all():
            for sums in (self._hidden_pa, self._bends_pa, self._unexplained_pa):
                sums[~counts] = 0.0
        if self._ticks % (_SPLIT_LOOKS * _SLOW_TICKS) != 0:
            return
        passed_s = _SPLIT_LOOKS * _SLOW_TICKS * self._interval_s
        slow_pa = self._without_bends(config.drift_limit_pa_s * passed_s)
        sound_pa = config.slow_rate_pa_s * passed_s / (1.0 if self._valve.lasting else _SOUND_SHARE)
        self._unexplained_pa = slow_pa - np.where(suspects, 0.0, np.clip(slow_pa, -sound_pa, sound_pa))
        moved_pa = np.abs(self._unexplained_pa)
        explained = moved_pa < 1e3
        self._explained_at_s[explained], self._explained_bends_pa[explained] = self._time_s, self._bends_pa[explained]
        limit_pa = np.where(suspects, 0.0, 1500.0 + 8.0 * self._sigma_pa + self._bent_pa)
        limit_pa = np.maximum(config.unexplained_limit_pa, limit_pa)
        # What moves faster than a transducer drifts is left to the other sums for as long as that would take.
        slow_s = np.where(suspects, 0.0, limit_pa / config.drift_limit_pa_s)
        for channel in np.flatnonzero((moved_pa > limit_pa) & (self._time_s - self._explained_at_s > slow_s)):
            self._name_unexplained(int(channel))

    def _without_bends(self, drift_pa: float) -> Vector:
        """Return what of the unexplained is no quick bend, shape (16,) [Pa]; keep what is.

        No transducer drifts further than ``drift_pa`` in the time: the rest is a bend's, as far as a bend has room for
        it. What then moves the other way is that bend, come back. The sum of both stays what was moved, of one sign, so
        that what is no bend is never more than that.
        """
        drift = np.clip(self._hidden_pa, -drift_pa, drift_pa)
        quick = self._bends_pa + self._hidden_pa - drift
        bends = np.clip(quick, -self._bent_pa, self._bent_pa)
        slow = self._unexplained_pa + drift + quick - bends
        back = np.where(slow * bends < 0.0, np.copysign(np.minimum(np.abs(slow), np.abs(bends)), slow), 0.0)
        self._hidden_pa, self._bends_pa = np.zeros(CHANNEL_COUNT), bends + back
        return np.asarray(slow - back)

    def _name_unexplained(self, channel: int) -> None:
        """Name it by its rate where no drift is so fast."""
        drifted_pa = float(self._unexplained_pa[channel])
        moved_pa = drifted_pa + float(self._bends_pa[channel] - self._explained_bends_pa[channel])
        rate_pa_s = -moved_pa / max(self._time_s - float(self._explained_at_s[channel]), _NOMINAL_TICK_S)
        self._withdraw(np.arange(CHANNEL_COUNT) == channel, Fault.LEAK_OR_DRIFT)
        if rate_pa_s > self._config.drift_limit_pa_s or rate_pa_s < -self._least_leak_pa_s(channel):
            self._find_slow(channel, rate_pa_s, "by the air that was moved for it")
            return
        evidence = f"{1e-3 * drifted_pa:+.1f} kPa of air moved to keep a reading that no one can vouch for"
        self._find(Fault.DRIFT if drifted_pa > 0.0 else Fault.RISES, (channel,), evidence, 0.5)

    def _least_leak_pa_s(self, channel: int) -> float:
        """Return how fast a reading falls that leaks for certain, since a leak is made up for without a bound.

        Faster than a drift, and than a bend makes room in the time that it takes to see one.
        """
        return self._config.drift_limit_pa_s + float(self._bent_pa[channel]) / _Slopes.SPAN_S

    def _judge_noise(self, settled: Mask) -> None:
        ratio2 = self._lasting_noise_pa2 / self._filtered_noise_pa2
        loud = (ratio2 > self._config.noise_ratio**2) & settled & ~self.channels(Fault.NOISY)
        for channel in np.flatnonzero(loud):
            raw_pa = self._sigma_pa[channel] / self.sound_noise_pa * self._noise.noise_pa
            evidence = f"noise of {raw_pa:.0f} Pa, the data sheet has {self._noise.noise_pa:.0f} Pa"
            self._find(Fault.NOISY, (int(channel),), evidence, 0.99)

    def _forget_slow(self, channels: Mask) -> None:
        self._gone[channels] = self._come[channels] = 0.0
        self._slope.forget(channels)
        self._effort_pa[channels] = self._in_vain_pa[channels] = 0.0
        self._effort_from_pa[channels] = np.nan
        self._unexplained_pa[channels] = self._bends_pa[channels] = self._hidden_pa[channels] = 0.0

    # What stands

    def find(self, fault: Fault, channels: tuple[int, ...], evidence: str, confidence: float) -> None:
        """Take what a test pulse has found of channels by their index; none stands for the supply."""
        if fault is Fault.SUPPLY_LOW:
            self._find_supply(evidence, confidence)
        else:
            self._find(fault, channels, evidence, confidence)

    def _find(self, fault: Fault, channels: tuple[int, ...], evidence: str, confidence: float) -> None:
        names = tuple(CHANNEL_NAMES[channel] for channel in channels)
        self._odd_at_s[list(channels)] = self._time_s
        self._up[list(channels)] = self._down[list(channels)] = 0.0
        if fault is not Fault.LEAK_OR_DRIFT:
            self._forget_slow(np.isin(np.arange(CHANNEL_COUNT), channels))
        self._masks.clear()
        self._findings.setdefault((fault, names), Finding(fault, names, evidence, confidence))

    def _find_swapped(self, first: int, second: int, evidence: str) -> None:
        pair = (min(first, second), max(first, second))
        for channel in pair:
            self._rises.pop(channel, None)
            self._looks.pop(channel, None)
        self._find(Fault.SWAPPED, pair, f"with each other: {evidence}", 0.95)

    def _find_supply(self, evidence: str, confidence: float) -> None:
        self._odd_at_s[:] = self._time_s
        self._down[:] = 0.0
        self._looks.clear()
        self._withdraw(np.ones(CHANNEL_COUNT, dtype=bool), Fault.NOT_FOLLOWING, Fault.SLOW_VALVE)
        self._masks.clear()
        self._findings.setdefault(
            (Fault.SUPPLY_LOW, (SUPPLY,)), Finding(Fault.SUPPLY_LOW, (SUPPLY,), evidence, confidence)
        )

    def _find_leak(self, channel: int, rate_pa_s: float) -> None:
        time_constant = f", time constant {self._readings[-1, channel] / rate_pa_s:.1f} s" if rate_pa_s > 1.0 else ""
        evidence = (
            f"falls {1e-3 * rate_pa_s:.1f} kPa/s with its valve closed, at {self._kpa(channel)} kPa{time_constant}"
        )
        self._find(Fault.LEAK, (channel,), evidence, 0.99)
        self._leak_1_s[channel] = rate_pa_s / max(float(self._readings[-1, channel]), 1e3)

    def _find_slow(self, channel: int, rate_pa_s: float, how: str) -> None:
        if rate_pa_s < -self._least_leak_pa_s(channel):
            tau_s = -self._readings[-1, channel] / rate_pa_s
            evidence = f"loses {-1e-3 * rate_pa_s:.1f} kPa/s {how}, time constant {tau_s:.1f} s"
            self._find(Fault.LEAK, (channel,), evidence, 0.95)
            self._leak_1_s[channel] = 1.0 / tau_s
        elif rate_pa_s > self._config.drift_limit_pa_s:
            vents_pa_s = self._config.slowest_ratio * float(self._valve.vent_pa_s(self._readings[-1])[channel])
            fault = Fault.LEAKS_IN if rate_pa_s < 0.5 * vents_pa_s else Fault.RISES
            self._find(fault, (channel,), f"gains {1e-3 * rate_pa_s:.1f} kPa/s {how}", 0.95)
        else:
            word = "falls" if rate_pa_s < 0.0 else "rises"
            evidence = f"{word} {1e-3 * abs(rate_pa_s):.2f} kPa/s {how}, at {self._kpa(channel)} kPa"
            self._find(Fault.LEAK_OR_DRIFT, (channel,), evidence, 0.95)

    def _withdraw(self, channels: Mask, *faults: Fault) -> None:
        names = {CHANNEL_NAMES[channel] for channel in np.flatnonzero(channels)}
        for key in [key for key in self._findings if key[0] in faults and names.intersection(key[1])]:
            del self._findings[key]
        self._masks.clear()

    def _clear(self, valid: Mask, vented: bool) -> None:
        """Let findings go that are not seen any more: of vented channels after a while, of noise at once."""
        if not self._findings:
            return
        reading = self._readings[-1]
        resting = valid & (np.abs(reading) < self._config.clear_below_gauge_pa)
        if not vented and self._targets is not None:
            resting &= self._targets == 0.0
        odd = ~resting | (self._up > 1000.0) | (self._down > 1000.0)
        odd |= (np.maximum(self._gone, self._come) > 1000.0) | (
            self._lasting_noise_pa2 > 4.0 * self._filtered_noise_pa2
        )
        self._odd_at_s[odd] = self._time_s
        sound = self._time_s - self._odd_at_s > self._config.clear_time_s
        for key in list(self._findings):
            indices = [CHANNEL_NAMES.index(name) for name in key[1] if name != SUPPLY] or list(range(CHANNEL_COUNT))
            if sound[indices].all():
                del self._findings[key]
                self._masks.clear()

    # Words and numbers

    def _rate(self, channel: int) -> float:
        """Return the slope of the last few readings [Pa/s]."""
        return float(_MOMENT @ self._readings[-_MOMENT.size :, channel] / (_MOMENT @ _MOMENT)) / self._interval_s

    def _seen_pa_s(self, channel: int) -> float:
        """Return the least such slope that is none of the noise."""
        sigma = float(self.reading_noise_pa[channel]) / (math.sqrt(float(_MOMENT @ _MOMENT)) * self._interval_s)
        return max(5e3, 4.0 * sigma)

    def _confidence(self, moved_pa: float, channel: int) -> float:
        """Return 1 - P(noise alone moves a sum so far), by the normal tail."""
        sigma = moved_pa / (1.5 * max(self.reading_noise_pa[channel], 1.0))
        return min(0.999, math.erf(sigma / math.sqrt(2.0)))

    def _kpa(self, channel: int) -> str:
        return f"{1e-3 * self._readings[-1, channel]:.1f}"


class _Slopes:
    """Least-squares slopes of readings over all stretches in which they count, each stretch with a mean of its own.

    Two spans of :data:`SPAN_S` that follow each other must agree, so that what passes does not make a slope.
    """

    SPAN_S = 2.0

    def __init__(self) -> None:
        n = CHANNEL_COUNT
        self._count, self._t, self._y = np.zeros(n), np.zeros(n), np.zeros(n)
        self._ty, self._tt = np.zeros(n), np.zeros(n)
        self._counted_s = np.zeros(n)
        self._span = np.zeros(n)
        self._before = np.full(n, np.nan)
        self._last = np.full(n, np.nan)
        self._last_tt = np.ones(n)

    def add(self, reading: Vector, dt_s: float, counts: Mask) -> None:
        """Take a reading of the channels that count; for the others a stretch ends."""
        self._count = np.where(counts, self._count + 1.0, 0.0)
        begun = self._count == 1.0
        self._t[begun], self._y[begun] = 0.0, reading[begun]
        going = self._count > 1.0
        if not going.any():
            return
        time = (self._count - 1.0) * dt_s
        n = np.maximum(self._count, 1.0)
        dt_mean, dy = time - self._t, np.where(going, reading - self._y, 0.0)
        self._t = np.where(going, self._t + dt_mean / n, self._t)
        self._y = np.where(going, self._y + dy / n, self._y)
        self._tt += np.where(going, dt_mean * (time - self._t), 0.0)
        self._ty += np.where(going, dt_mean * (reading - self._y), 0.0)
        self._counted_s += np.where(going, dt_s, 0.0)
        ended = self._counted_s >= self.SPAN_S
        if ended.any():
            self._before = np.where(ended, self._last, self._before)
            self._last = np.where(ended, self._ty / np.maximum(self._tt, 1e-12), self._last)
            self._last_tt = np.where(ended, self._tt, self._last_tt)
            self._tt[ended] = self._ty[ended] = self._counted_s[ended] = self._count[ended] = 0.0

    def steady(self, allowed_pa_s: float, noise_pa: Vector) -> Mask:
        """Return which channels had two spans running a slope of one sign beyond what is allowed and noise."""
        least = allowed_pa_s + 4.0 * noise_pa / np.sqrt(np.maximum(self._last_tt, 1e-12))
        both = np.minimum(np.abs(self._last), np.abs(self._before))
        return np.asarray((both > least) & (self._last * self._before > 0.0))

    def rate(self, channel: int) -> float:
        """Return the slope of the present span, or of the last where that is longer [Pa/s]."""
        if self._tt[channel] > 0.01 or not math.isfinite(self._last[channel]):
            return float(self._ty[channel] / max(self._tt[channel], 1e-12))
        return float(self._last[channel])

    def forget(self, channels: Mask) -> None:
        """Start anew."""
        for values in (self._count, self._tt, self._ty, self._counted_s):
            values[channels] = 0.0
        self._last[channels] = self._before[channels] = math.nan
