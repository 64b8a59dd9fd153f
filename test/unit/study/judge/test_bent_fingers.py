"""The judge of the detector under a hand that closes."""

import pytest

from mbpam_ros.study.judge.bent_fingers import BentSight, bent_figures, look_at_bent_fingers
from mbpam_ros.vision.detector import SOURCES, load_detector_config


def sights(over, told, is_seen, false_alarms, pressure_pa=60e3):
    return [BentSight(over, pressure_pa, source, told, is_seen, false_alarms) for source in SOURCES]


def test_figures_are_shares_of_the_images_by_what_is_below_pressure_and_word():
    rows = bent_figures(
        [
            *sights("bulb", True, True, 0),
            *sights("tube", True, False, 1),
            *sights("empty", True, False, 2),
            *sights("bulb", False, False, 0),
            *sights("bulb", True, True, 5, pressure_pa=100e3),
        ]
    )
    found = {(row["over"], row["pressure_gauge_pa"], row["told"]): row for row in rows}
    assert len(found) == len(rows) == 4
    objects = found["object", 60e3, 1.0]
    assert objects["images"] == 2
    assert (objects["image_recall"], objects["depth_false_alarms"]) == (0.5, 0.5)
    assert found["empty table", 60e3, 1.0]["background_false_alarms"] == 2.0
    assert found["object", 60e3, 0.0]["image_recall"] == 0.0


@pytest.mark.slow
def test_the_same_images_are_judged_told_and_not_and_the_object_is_seen_before_the_hand_closes():
    run = next(look_at_bent_fingers(load_detector_config(), ("bulb",)))
    told, untold = (
        [(each.source, each.pressure_gauge_pa) for each in run if each.told is word] for word in (True, False)
    )
    assert told == untold and len(told) > 3 * len(SOURCES)
    open_hand = [each for each in run if each.pressure_gauge_pa == 0.0]
    assert len(open_hand) == 2 * len(SOURCES)
    assert all(each.is_seen and each.false_alarms == 0 for each in open_hand)
