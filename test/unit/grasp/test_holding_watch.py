"""What valves, pressures and camera tell of a grasp, brought before the judge."""

import dataclasses
import json
import math
import re

import numpy as np
import pytest

from mbpam_ros.configuration import ConfigError
from mbpam_ros.grasp.empty_hand import EmptyHand, load_empty_hand
from mbpam_ros.grasp.holding import AirWeights, Holding, HoldingConfig
from mbpam_ros.grasp.holding_watch import HoldingWatch
from mbpam_ros.grasp.modes import MODE_NAMES, load_modes
from mbpam_ros.grasp.selection import DetectedObject

BULB = DetectedObject("bulb", "sphere", (0.06, 0.06, 0.06), (0.005, 0.0, 0.085), (0.0, 0.0, 0.0, 1.0), 0.9)
ROWS = [
    {"mode": mode, "pressure_gauge_pa": [50e3, 100e3], "bend_deg": [[10.0, 20.0, 30.0, 40.0], [50.0, 60.0, 70.0, 80.0]]}
    for mode in MODE_NAMES
]
GRIP_PA = load_modes()["envelope"].setpoints(80e3)


class StubAir:
    """An account of the air that knows the bends it is told."""

    def __init__(self, bend_deg):
        self.bend_deg, self.known = bend_deg, False

    def begin(self, time_s, pressure_gauge_pa):
        self.known = True

    def forget(self):
        self.known = False

    def bend_rad(self, pressure_gauge_pa, under_pressure):
        return np.radians(self.bend_deg)


def watch(bend_deg=(34.0, 44.0, 54.0, 64.0), target=BULB, before_pa=0.0):
    config = HoldingConfig(air={"envelope": AirWeights(-2.0, 0.5)})
    watching = HoldingWatch(config, StubAir(bend_deg), EmptyHand(ROWS))
    watching.begin(0.0, np.full(16, before_pa), GRIP_PA, ("envelope", 0, False), target)
    return watching


def test_the_empty_hand_is_interpolated_over_the_pressure():
    assert EmptyHand(ROWS).bend_deg("mid_rod", 75e3, 0, False) == pytest.approx([30.0, 40.0, 50.0, 60.0])


def test_the_empty_hand_turns_and_mirrors_with_the_mode():
    hand = EmptyHand(ROWS)
    assert hand.bend_deg("mid_rod", 100e3, 1, False) == pytest.approx([80.0, 50.0, 60.0, 70.0])
    assert hand.bend_deg("mid_rod", 100e3, 0, True) == pytest.approx([80.0, 70.0, 60.0, 50.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: content.pop("empty"), "empty"),
        (lambda content: content["empty"].pop(), "no bends of the empty hand in mid_rod"),
        (lambda content: content["empty"][0].update(pressure_gauge_pa=[1e5, 5e4]), "rising pressures"),
    ],
)
def test_a_file_without_an_empty_hand_is_refused(tmp_path, change, message):
    content = json.loads(json.dumps({"empty": ROWS}))
    change(content)
    path = tmp_path / "table.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ConfigError, match=rf"table\.json: .*{re.escape(message)}"):
        load_empty_hand(path)


def test_the_shortfall_is_by_how_much_less_the_fingers_are_bent_than_an_empty_hands():
    assert watch().shortfall_deg(GRIP_PA) == pytest.approx(0.0)
    assert watch((24.0, 34.0, 44.0, 54.0)).shortfall_deg(GRIP_PA) == pytest.approx(10.0)


def test_fingers_that_an_object_keeps_straight_are_told_to_hold_it():
    assert watch((24.0, 34.0, 44.0, 54.0)).feel(GRIP_PA).holding is Holding.HELD
    assert watch((44.0, 54.0, 64.0, 74.0)).feel(GRIP_PA).holding is Holding.EMPTY


def test_air_that_was_there_before_cannot_be_accounted_for():
    assert math.isnan(watch(before_pa=60e3).shortfall_deg(GRIP_PA))
    assert watch(before_pa=60e3).feel(GRIP_PA).holding is Holding.UNKNOWN


def test_without_an_account_of_the_air_the_camera_alone_tells():
    watching = HoldingWatch(HoldingConfig())
    watching.begin(0.0, np.zeros(16), GRIP_PA, ("envelope", 0, False), BULB)
    watching.look([BULB])
    verdict = watching.feel(GRIP_PA)
    assert (verdict.holding, verdict.by) == (Holding.HELD, ("camera",))


def at(x_m, z_m, size_m=0.06):
    return dataclasses.replace(BULB, position_m=(x_m, 0.0, z_m), size_m=(size_m,) * 3)


@pytest.mark.parametrize(
    ("seen", "ratio"),
    [
        ([at(0.005, 0.085)], 1.0),
        ([at(0.01, 0.185)], 0.46),
        ([at(0.005, 0.085, 0.03)], 0.5),
        ([at(0.03, 0.085)], 0.95),
        ([at(0.06, 0.085)], None),
        ([], None),
        ([at(0.005, 0.185), at(0.005, 0.08)], 1.06),
        ([dataclasses.replace(BULB, confidence=0.4)], None),
    ],
)
def test_what_shows_in_the_objects_direction_is_compared_with_its_size_there(seen, ratio):
    found = watch().size_ratio(seen)
    assert found is None if ratio is None else found == pytest.approx(ratio, abs=0.01)


def test_beside_a_slim_object_less_is_taken_for_it_than_beside_a_wide_one():
    slim = dataclasses.replace(BULB, shape="cylinder", size_m=(0.02, 0.02, 0.2))
    aside = dataclasses.replace(slim, position_m=(0.03, 0.0, 0.085))
    assert watch(target=slim).size_ratio([slim]) == pytest.approx(1.0)
    assert watch(target=slim).size_ratio([aside]) is None


def test_of_what_an_operators_mode_closes_upon_the_camera_knows_nothing():
    watching = watch(target=None)
    watching.look([BULB])
    assert watching.feel(np.full(16, np.nan)).by == ()
