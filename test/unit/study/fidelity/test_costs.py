"""CPU times: repeated until they agree, monotone, and not believed on a busy machine."""

import itertools
import math

import pytest

from mbpam_ros.study.fidelity.costs import FEWEST_RUNS, MOST_RUNS, Trust, cost_lines, spread, timed


def test_what_repeats_is_run_the_fewest_times_and_what_does_not_the_most():
    noisy = itertools.count(20.0, -1.0)
    turns = []
    timings, trust = timed({"steady": lambda: 7.0, "noisy": lambda: next(noisy)}, turns.append)
    assert (timings["steady"].runs, timings["steady"].cpu_ms_per_s) == (FEWEST_RUNS, 7.0)
    assert timings["noisy"].runs == MOST_RUNS == len(turns)
    assert not trust.believed and "too busy" in str(trust)


def test_a_core_that_is_slowed_for_a_while_costs_what_it_costs_alone():
    slowed = itertools.cycle([15.0, 10.1, 15.2, 10.0])
    timings, trust = timed({"run": lambda: next(slowed)}, lambda line: None)
    assert timings["run"].cpu_ms_per_s == 10.0
    assert trust.spread == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("values", "expected"), [([4.0, 4.0], math.inf), ([4.0] * 6, 0.0), ([30.0, 10.0, 11.0, 10.5], 0.1)]
)
def test_the_spread_is_of_the_third_least_over_the_least(values, expected):
    assert spread(values) == pytest.approx(expected)


def test_a_machine_that_had_other_things_to_do_is_not_believed():
    assert Trust(0.02, 0.97).believed and "busy" not in str(Trust(0.02, 0.97))
    assert not Trust(0.02, 0.6).believed
    assert "CPU 60 % of wall time" in str(Trust(0.02, 0.6))


def test_the_cost_model_returns_what_it_was_made_from():
    exact = {modes: {step: 20.0 + modes + 0.01 * modes / step for step in (0.0005, 0.002, 0.01)} for modes in (2, 3, 5)}
    lines = cost_lines(exact)
    for modes, costs in exact.items():
        for step_s, cost in costs.items():
            assert lines[modes].cpu_ms_per_s(step_s) == pytest.approx(cost)


def test_costs_never_fall_with_more_modes_or_shorter_steps_though_their_medians_do():
    """Two modes cost more than three in the medians that made the planner choose four in the air."""
    noisy = {2: {0.0005: 60.0, 0.002: 43.0, 0.01: 30.0}, 3: {0.0005: 50.0, 0.002: 35.0, 0.01: 36.0}}
    lines = cost_lines(noisy)
    steps_s = (0.01, 0.005, 0.002, 0.001, 0.0005)
    for step_s in steps_s:
        assert lines[3].cpu_ms_per_s(step_s) >= lines[2].cpu_ms_per_s(step_s)
    for line in lines.values():
        costs = [line.cpu_ms_per_s(step_s) for step_s in steps_s]
        assert costs == sorted(costs)
        assert min(costs) > 0.0
