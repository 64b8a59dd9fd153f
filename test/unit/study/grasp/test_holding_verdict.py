"""How often held and empty are told rightly, and the weights with which they are."""

import math

import numpy as np
import pytest

from mbpam_ros.grasp.holding import AirWeights, Holding, HoldingConfig
from mbpam_ros.grasp.modes import MODE_NAMES
from mbpam_ros.study.grasp.holding_verdict import fitted, reached, told, verdict, verdict_text

CONFIG = HoldingConfig(air={mode: AirWeights(-2.0, 0.3) for mode in MODE_NAMES})


def row(held, shortfall_deg=None, size_ratio=None, mode="envelope", seen=True):
    return {"held": held, "shortfall_deg": shortfall_deg, "size_ratio": size_ratio, "mode": mode, "seen": seen}


def test_a_sense_that_is_left_out_tells_nothing():
    full = row(True, 30.0, 0.4)
    assert told(full, ("air",), CONFIG) is Holding.HELD
    assert told(full, ("camera",), CONFIG) is Holding.EMPTY
    assert told(full, ("air", "camera"), CONFIG) is Holding.UNKNOWN


def test_what_the_camera_never_saw_it_tells_nothing_of():
    assert told(row(True, None, None, seen=False), ("camera",), CONFIG) is Holding.UNKNOWN


def test_shares_are_of_full_and_of_empty_hands():
    rows = [row(True, 30.0)] * 3 + [row(True, -10.0)] + [row(False, -10.0)] * 9 + [row(False, 30.0)]
    rows.append({"held": None, "mode": "envelope", "note": "diverged"})
    found = verdict(rows, CONFIG)
    air = next(each for each in found["told"] if each["of"] == "all" and each["by"] == "air")
    assert (found["grasps"], found["diverged"], found["held"]) == (15, 1, 4)
    assert (air["full"], air["true_held"], air["false_empty"]) == (4, 0.75, 0.25)
    assert (air["empty"], air["true_empty"], air["false_held"]) == (10, 0.9, 0.1)
    assert not reached(found)
    assert "envelope" in verdict_text(found) and "75.0%" in verdict_text(found)


def test_two_in_a_hundred_and_five_in_a_hundred_are_reached():
    full = [row(True, 30.0, 1.0)] * 95 + [row(True, -10.0, 0.4)] * 5
    empty = [row(False, -10.0, 0.4)] * 98 + [row(False, 30.0, 1.0)] * 2
    assert reached(verdict(full + empty, CONFIG))
    assert not reached(verdict([*full, row(True, -10.0, 0.4), *empty], CONFIG))
    assert not reached(verdict([*full, *empty, row(False, 30.0, 1.0), row(False, 30.0, 1.0)], CONFIG))


def test_the_fit_returns_the_weights_that_made_the_rows():
    rng = np.random.default_rng(8)
    shortfall = rng.uniform(-20.0, 40.0, 4000)
    held = rng.random(4000) < 1.0 / (1.0 + np.exp(2.0 - 0.2 * shortfall))
    found = fitted([row(bool(h), float(s)) for h, s in zip(held, shortfall, strict=True)], CONFIG)
    assert found["air"]["envelope"]["at_zero"] == pytest.approx(-2.0, abs=0.3)
    assert found["air"]["envelope"]["per_deg"] == pytest.approx(0.2, abs=0.03)
    assert set(found["air"]) == {"envelope"}


def test_hands_that_the_air_divides_without_error_leave_finite_weights():
    rows = [row(True, 30.0 + each) for each in range(10)] + [row(False, -10.0 - each) for each in range(10)]
    weights = fitted(rows, CONFIG)["air"]["envelope"]
    assert math.isfinite(weights["at_zero"]) and 0.0 < weights["per_deg"] < 5.0


def test_the_camera_is_weighed_by_how_often_it_shows_what():
    full = [row(True, None, 1.0)] * 80 + [row(True)] * 20
    empty = [row(False, None, 0.4)] * 60 + [row(False)] * 38 + [row(False, None, 1.0)] * 2
    found = fitted(full + empty, CONFIG)
    assert found["camera_in_place"] == pytest.approx(math.log((81 / 103) / (3 / 103)), abs=0.01)
    assert found["camera_farther"] == pytest.approx(math.log((1 / 103) / (61 / 103)), abs=0.01)
    assert found["camera_nothing"] == pytest.approx(math.log((21 / 103) / (39 / 103)), abs=0.01)
