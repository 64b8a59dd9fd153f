"""How late a process ran, by a timer of its own."""

import pytest

from mbpam_ros.nodes.lateness import Lateness

PERIOD_S = 0.05


def called_every_period(calls=10, start_s=100.0):
    lateness = Lateness(PERIOD_S, memory_s=1.0)
    for call in range(calls):
        lateness.call(start_s + call * PERIOD_S)
    return lateness, start_s + (calls - 1) * PERIOD_S


def test_a_timer_that_was_never_called_is_not_late():
    assert Lateness(PERIOD_S, 1.0).worst_s(1e9) == 0.0


def test_a_punctual_timer_is_not_late():
    lateness, now_s = called_every_period()
    assert lateness.worst_s(now_s + PERIOD_S) == pytest.approx(0.0, abs=1e-9)


def test_a_call_that_is_overdue_counts_before_it_comes_and_after():
    lateness, now_s = called_every_period()
    assert lateness.worst_s(now_s + 0.30) == pytest.approx(0.25)
    lateness.call(now_s + 0.30)
    lateness.call(now_s + 0.35)
    assert lateness.worst_s(now_s + 0.35) == pytest.approx(0.25)


def test_the_longest_delay_counts_until_it_is_forgotten():
    lateness, now_s = called_every_period()
    for after_s in (0.30, 0.45, 0.50):
        lateness.call(now_s + after_s)
    assert lateness.worst_s(now_s + 0.50) == pytest.approx(0.25)
    for call in range(20):
        lateness.call(now_s + 0.55 + call * PERIOD_S)
    assert lateness.worst_s(now_s + 1.50) == pytest.approx(0.0, abs=1e-9)
