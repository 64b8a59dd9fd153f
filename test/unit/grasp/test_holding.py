"""Held, empty or unknown: how the senses are weighed."""

import math

import pytest

from mbpam_ros.grasp.holding import AirWeights, Holding, HoldingConfig, HoldingJudge

WEIGHTS = {"envelope": AirWeights(-2.0, 0.2)}


def judge(**config):
    return HoldingJudge(HoldingConfig(air=WEIGHTS, **config))


def test_without_a_sense_nothing_is_known():
    verdict = judge().verdict()
    assert (verdict.holding, verdict.probability, verdict.by, verdict.confidence) == (Holding.UNKNOWN, 0.5, (), 0.0)


@pytest.mark.parametrize(
    ("shortfall_deg", "holding"), [(30.0, Holding.HELD), (-10.0, Holding.EMPTY), (10.0, Holding.UNKNOWN)]
)
def test_the_air_tells_by_how_much_less_the_fingers_are_bent(shortfall_deg, holding):
    judging = judge()
    judging.feel("envelope", shortfall_deg)
    verdict = judging.verdict()
    assert verdict.holding is holding
    assert verdict.probability == pytest.approx(1.0 / (1.0 + math.exp(2.0 - 0.2 * shortfall_deg)))


def test_a_mode_without_weights_and_an_amount_that_is_not_known_say_nothing():
    judging = judge()
    judging.feel("mid_rod", 30.0)
    judging.feel("envelope", math.nan)
    assert judging.verdict().by == ()


def test_the_camera_tells_by_the_size_in_the_image():
    judging = judge()
    judging.see(0.95)
    assert judging.verdict().holding is Holding.HELD
    judging.see(0.55)
    assert judging.verdict().holding is Holding.EMPTY


def test_senses_that_contradict_each_other_leave_it_unknown():
    judging = judge()
    judging.feel("envelope", 30.0)
    judging.see(0.5)
    verdict = judging.verdict()
    assert (verdict.holding, verdict.by) == (Holding.UNKNOWN, ("air", "camera"))


def test_a_claim_is_kept_until_it_is_clearly_less_sure():
    judging = judge(claim_from=0.95, keep_until=0.8)
    found = []
    for probability in (0.9, 0.96, 0.9, 0.82, 0.78, 0.9, 0.04, 0.15, 0.25):
        judging.feel("envelope", (math.log(probability / (1.0 - probability)) + 2.0) / 0.2)
        found.append(judging.verdict().holding.value)
    unknown = "unknown"
    assert found == [unknown, "held", "held", "held", unknown, unknown, "empty", "empty", unknown]


def test_a_new_grasp_knows_nothing_of_the_last():
    judging = judge()
    judging.feel("envelope", 40.0)
    assert judging.verdict().holding is Holding.HELD
    judging.begin()
    assert judging.verdict().holding is Holding.UNKNOWN


def test_confidence_is_that_of_the_claim():
    judging = judge()
    judging.feel("envelope", -10.0)
    verdict = judging.verdict()
    assert verdict.confidence == pytest.approx(1.0 - verdict.probability) and verdict.confidence > 0.95


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"claim_from": 0.7, "keep_until": 0.8}, "keep_until"),
        ({"air": {"hug": AirWeights(0.0, 1.0)}}, "hug is none of"),
    ],
)
def test_weights_that_cannot_be_are_refused(config, message):
    with pytest.raises(ValueError, match=message):
        HoldingConfig(**config)
