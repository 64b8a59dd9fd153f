"""Whether an object that is to be grasped still lies where it was seen."""

import dataclasses

import pytest

from mbpam_ros.grasp.selection import DetectedObject
from mbpam_ros.grasp.sightings import Sightings

BALL = DetectedObject("ball", "sphere", (0.06, 0.06, 0.06), (0.0, 0.0, 0.09), (0.0, 0.0, 0.0, 1.0), 0.9)


def at(x_m, y_m=0.0, target=BALL):
    return dataclasses.replace(target, position_m=(x_m, y_m, 0.09))


def seen(*looks, every_s=0.25):
    sightings = Sightings(0.015, 1.0)
    for number, objects in enumerate(looks):
        sightings.take(number * every_s, objects)
    return sightings


def test_what_rests_has_not_moved():
    assert seen([at(0.0)], [at(0.004)]).unrest(at(0.004)) is None


def test_what_was_elsewhere_before_has_moved_by_so_much():
    assert "moved by 30 mm" in seen([at(0.0)], [at(0.03)]).unrest(at(0.03))


def test_a_second_object_beside_one_that_rests_has_not_moved():
    assert seen([at(0.0)], [at(0.0), at(0.05)]).unrest(at(0.05)) is None


def test_an_object_that_was_put_there_has_not_moved():
    assert seen([], [at(0.0)]).unrest(at(0.0)) is None


def test_two_looks_too_far_apart_tell_nothing():
    assert seen([at(0.0)], [at(0.03)], every_s=2.0).unrest(at(0.03)) is None


def test_a_depth_told_otherwise_is_no_motion():
    deeper = dataclasses.replace(BALL, position_m=(0.0, 0.0, 0.11))
    assert seen([BALL], [deeper]).unrest(deeper) is None


def test_what_is_not_seen_any_more_is_named_with_its_place_and_time():
    assert "ball at (10, -20) mm was seen 0.2 s before" in seen([at(0.01, -0.02)], []).vanished()
    assert seen([], []).vanished() is None
    assert seen([at(0.0)], [at(0.05)]).vanished() is None


@pytest.mark.parametrize(
    ("looks", "words"),
    [
        ([[at(0.02)]], "moved by 20 mm"),
        ([[]], "vanished"),
        ([[at(0.0, target=dataclasses.replace(BALL, shape="box"))]], "vanished"),
    ],
)
def test_a_chosen_object_that_is_not_where_it_was_is_lost(looks, words):
    assert words in seen(*looks).lost(BALL)


def test_a_chosen_object_that_is_where_it_was_is_not_lost():
    assert seen([at(0.01), at(0.05)]).lost(BALL) is None
