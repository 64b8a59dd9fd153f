"""Random use for a short time."""

from mbpam_ros.study import soak as soak_module
from mbpam_ros.study.soak import soak


def test_some_seconds_of_random_use_repeats_and_nothing_is_wrong():
    first, again = (soak(seed=3, wall_s=60.0, simulated_s=6.0) for _ in range(2))
    assert first.wrong == [] and first.grasps > 1 and first.simulated_s >= 6.0
    told = ("simulated_s", "grasps", "held", "disturbed", "pressure_max_kpa")
    assert [getattr(first, name) for name in told] == [getattr(again, name) for name in told]
    assert 50.0 < first.pressure_max_kpa < 112.2


def test_what_is_wrong_is_told_with_its_time_and_round(monkeypatch):
    monkeypatch.setattr(soak_module, "BACK_WITHIN_S", 0.0)
    told = soak(seed=3, wall_s=60.0, simulated_s=1.0).wrong
    assert told and "not idle 0 s after a release" in told[0] and "round 0" in told[0]
