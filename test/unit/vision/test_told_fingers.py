"""Which shapes of the fingers count for an image, and when they are trusted."""

import itertools

import numpy as np
import pytest

from mbpam_ros.gripper import load_gripper
from mbpam_ros.vision.detector import Detection, open_fingers
from mbpam_ros.vision.told_fingers import STALE_S, ToldFingers, UnderHand

OPEN = open_fingers(load_gripper())


def shape(bend_m, points=5):
    """Fingers whose tips are aside along x by ``bend_m``."""
    share = np.linspace(0.0, 1.0, points)[:, None]
    return OPEN[:, :1] + share * (OPEN[:, 1:] - OPEN[:, :1]) + bend_m * share**2 * [1.0, 0.0, 0.0]


def told(*words):
    fingers = ToldFingers(OPEN)
    for stamp_s, bend_m in words:
        fingers.tell(stamp_s, None if bend_m is None else shape(bend_m))
    return fingers


def answers(events):
    """What is told of each image when words and images come in this order."""
    fingers, waiting, result = ToldFingers(OPEN), [], {}
    for kind, stamp_s in events:
        if kind == "image":
            waiting.append(stamp_s)
        else:
            fingers.tell(stamp_s, shape(stamp_s / 10.0))
        for image_s in [each for each in waiting if not fingers.awaited(each)]:
            waiting.remove(image_s)
            result[image_s] = fingers.at(image_s).tobytes()
    return result


def test_an_image_is_told_the_same_in_whatever_order_image_and_words_are_delivered():
    words = [("word", 0.1 * k) for k in range(1, 7)]
    images = [("image", 0.35), ("image", 0.5)]
    results = []
    # Each topic keeps its order; between them anything may happen, once the first word is there.
    for places in itertools.combinations_with_replacement(range(1, len(words) + 1), len(images)):
        events = list(words)
        for place, image in sorted(zip(places, images, strict=True), reverse=True):
            events.insert(place, image)
        results.append(answers(events))
    assert len(results) > 10 and set(results[0]) == {0.35, 0.5}
    assert all(result == results[0] for result in results)


def test_an_image_waits_for_the_first_word_at_or_after_it():
    fingers = told((1.0, 0.03))
    assert fingers.awaited(1.05)
    fingers.tell(1.1, shape(0.05))
    assert not fingers.awaited(1.05) and not fingers.awaited(1.1)
    np.testing.assert_allclose(fingers.at(1.05), np.concatenate([shape(0.03), shape(0.07)]))


def test_nothing_is_awaited_of_who_has_not_spoken_for_long_or_never():
    assert not told().awaited(1.0)
    assert told().at(1.0) is None
    silent = told((1.0, 0.03))
    assert not silent.awaited(1.0 + STALE_S + 0.01)
    assert silent.at(1.0 + STALE_S + 0.01) is None


def test_stamps_of_another_clock_say_nothing():
    fingers = told((1000.0, 0.03), (1000.1, 0.03))
    for stamp_s in (3.0, 5000.0):
        assert not fingers.awaited(stamp_s)
        assert fingers.at(stamp_s) is None


def test_after_time_was_set_back_only_what_was_told_since_counts():
    fingers = told((9.9, 0.03), (10.0, 0.03), (9.8, 0.05))
    np.testing.assert_array_equal(fingers.at(9.8), shape(0.05))


def test_open_fingers_and_unknown_ones_are_not_told():
    assert told((1.0, 4e-4), (1.1, 0.0)).at(1.1) is None
    assert told((1.0, 0.03), (1.1, None)).at(1.05) is None
    assert told((1.0, None), (1.1, 0.03)).at(1.05) is None
    assert told((1.0, 0.0), (1.1, 0.03)).at(1.05) is not None


def test_between_words_of_different_numbers_of_points_nothing_is_told():
    fingers = told((1.0, 0.03))
    fingers.tell(1.1, shape(0.05, points=9))
    assert fingers.at(1.05) is None


def test_fingers_that_stand_still_but_for_noise_are_told_once():
    fingers = told((1.0, 0.03), (1.1, 0.0301))
    first = fingers.at(1.05)
    assert first.shape == (4, 5, 3)
    fingers.tell(1.2, shape(0.03015))
    assert fingers.at(1.15) is first
    fingers.tell(1.3, shape(0.04))
    assert fingers.at(1.25).shape == (8, 5, 3)


def detection(x_m, length_m=0.06):
    place, upright = np.array([x_m, 0.0, 0.1]), np.array([0.0, 0.0, 0.0, 1.0])
    return Detection("sphere", np.full(3, length_m), place, upright, 0.9, "sphere", np.zeros((4, 2)))


@pytest.mark.parametrize(
    ("seen", "is_empty"),
    [([], True), ([detection(0.0)], False), ([detection(0.08)], False), ([detection(0.2)], True)],
    ids=["nothing", "under the palm", "with its edge", "aside"],
)
def test_under_the_hand_is_nothing_if_no_object_reaches_in_where_fingers_close(seen, is_empty):
    under = UnderHand(0.06)
    assert not under.is_empty
    under.seen(seen)
    assert under.is_empty is is_empty
