"""Signs of life: who is there, and how many."""

import pytest

from mbpam_ros.nodes.heartbeat import LIFE_LOOK_S, PERIOD_S, SILENCE_S, Instance, SignsOfLife

ONE, OTHER = Instance("alpha", 17, "0a"), Instance("beta", 17, "0b")


def alive_after(signs, seconds, start_s, look_s=LIFE_LOOK_S):
    """Look steadily, hearing nothing; return who is alive at the end, and the time."""
    now_s = start_s
    while now_s < start_s + seconds:
        now_s += look_s
        alive = signs.look(now_s)
    return alive, now_s


def test_nobody_is_there_before_the_first_sign():
    assert SignsOfLife().look(5.0) == ()


def test_a_node_is_gone_when_it_has_been_silent_and_not_before():
    signs = SignsOfLife()
    signs.look(1.0)
    signs.hear(ONE)
    alive, now_s = alive_after(signs, SILENCE_S - 2 * LIFE_LOOK_S, 1.0)
    assert alive == (ONE,)
    alive, _ = alive_after(signs, 3 * LIFE_LOOK_S, now_s)
    assert alive == ()


def test_death_is_known_within_0_3_s_of_it():
    assert SILENCE_S + LIFE_LOOK_S < 0.3
    assert SILENCE_S > 5 * PERIOD_S  # five lost in a row


@pytest.mark.parametrize("held_up_s", [0.5, 5.0, 3600.0])
def test_what_the_listener_has_slept_through_is_no_silence_of_others(held_up_s):
    signs = SignsOfLife()
    signs.look(1.0)
    signs.hear(ONE)
    assert signs.look(1.0 + held_up_s) == (ONE,)  # its signs wait to be taken
    signs.hear(ONE)
    assert signs.look(1.02 + held_up_s) == (ONE,)


def test_a_listener_that_was_held_up_itself_gives_others_as_much_more_time():
    signs = SignsOfLife()
    signs.look(0.0)
    signs.hear(ONE)
    for k in range(1, 21):
        assert signs.look(0.02 * k, held_up_s=0.2) == (ONE,)
    assert signs.look(0.42, held_up_s=0.0) == ()


def test_two_of_one_name_are_told_apart_until_one_is_silent():
    signs = SignsOfLife()
    for k in range(40):
        signs.hear(ONE)
        if k < 10:
            signs.hear(OTHER)
        alive = signs.look(0.02 * k)
        if k < 10:
            assert set(alive) == {ONE, OTHER}
    assert alive == (ONE,)


def test_an_instance_survives_its_text_and_a_foreign_text_stands_for_itself():
    own = Instance.of_this_process()
    assert Instance.read(str(own)) == own != Instance.of_this_process()
    assert Instance.read("some_driver") == Instance("some_driver", 0, "")
    assert Instance.read("a b c") == Instance("a b c", 0, "")
    assert Instance.read("") == Instance("", 0, "")
