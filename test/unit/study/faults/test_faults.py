"""Faults at random in whole grasps: trials, the table of them, the verb, and a sound machine beside."""

import json

import numpy as np
import pytest

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, CHANNEL_COUNT
from mbpam_ros.commands.mbpam import main
from mbpam_ros.pneumatics.machine_faults import FAULT_KINDS
from mbpam_ros.study.faults.draws import ROWS, FaultRowError, row_named
from mbpam_ros.study.faults.sound import sound_row
from mbpam_ros.study.faults.table import shortcomings, table_rows, table_text
from mbpam_ros.study.faults.trial import trial_row

KEYS = [
    "fault", "phase", "trials", "detected", "right_channel", "detect_s_worst", "pressure_max_kpa",
    "seconds_above_limit", "object_kept", "back_to_idle",
]  # fmt: skip


@pytest.mark.parametrize(
    ("row", "phase", "tier", "answer"),
    [
        ("stuck but noisy", "closing", "arc", "vent all"),
        ("valve stuck open", "holding", "arc", "cut the supply"),
        ("leak", "holding", "rod", "regulate on"),
    ],
)
def test_a_fault_is_found_answered_and_got_over(row, phase, tier, answer):
    trial = trial_row("one", row, phase, tier, seed=1)
    assert trial["detected_by"] == "observer" and trial["right_channel"]
    assert trial["answer"] == answer and trial["back_s"] is not None
    assert trial["pressure_max_pa"] < 125e3 and trial["above_limit_s"] <= 0.02
    assert trial["object_kept"] is (True if phase == "holding" else None)


def test_a_sound_machine_is_left_in_peace():
    row = sound_row("one", "arc", number=3, span_s=10.0)
    assert row["grasps"] >= 1 and row["found"] == [] and row["faults"] == 0


def test_every_kind_of_fault_is_tried_with_sizes_and_channels_within_the_row():
    assert {row.kind for row in ROWS} == set(FAULT_KINDS)
    random, inflated = np.random.default_rng(0), np.arange(CHANNEL_COUNT) % CHAMBERS_PER_FINGER == 2
    for row in ROWS:
        drawn = [row.draw(random, inflated) for _ in range(60)]
        assert all(row.smallest <= abs(fault.size) <= row.largest for fault in drawn)
        assert len({fault.channel for fault in drawn}) == (CHANNEL_COUNT if row.any_channel else 4)
        assert any(fault.size < 0.0 for fault in drawn) is row.either_sign


def trial(**changes):
    good = {
        "fault": "leak", "phase": "holding", "detected_by": "observer", "detect_s": 0.2, "right_channel": True,
        "answer": "regulate on", "safe_s": 0.3, "pressure_max_pa": 101e3, "above_limit_s": 0.0, "above_110_kpa_s": 0.0,
        "object_kept": True, "back_s": 1.0,
    }  # fmt: skip
    return {**good, **changes}


def test_the_table_has_the_agreed_keys_and_says_what_is_not_reached():
    (row,) = table_rows([trial(), trial(detect_s=0.6, pressure_max_pa=104e3)])
    assert list(row)[: len(KEYS)] == KEYS
    assert (row["detected"], row["detect_s_worst"], row["pressure_max_kpa"]) == (1.0, 0.6, 104.0)
    assert shortcomings(row) == [] and "every row is as it should be" in table_text([row])
    for change, said in (
        ({"detected_by": ""}, "detected 50%"),
        ({"right_channel": False}, "right channel 50%"),
        ({"above_limit_s": 0.03, "pressure_max_pa": 113e3}, "113.0 kPa"),
        ({"object_kept": False}, "1 objects lost"),
        ({"back_s": None}, "back to idle 50%"),
    ):
        (row,) = table_rows([trial(), trial(**change)])
        assert shortcomings(row) == [said] and said in table_text([row])
    (row,) = table_rows([trial(answer="vent all", object_kept=False)])
    assert shortcomings(row) == []


def test_the_verb_writes_a_list_and_goes_on_from_finished_trials(tmp_path, capsys):
    command = ["faults", "--row", "broken wire", "--trials", "1", "--tier", "arc", "--workers", "1"]
    command += ["--json", str(tmp_path / "faults.json")]
    assert main(command) == 0
    table = json.loads((tmp_path / "faults.json").read_text())
    assert [(row["fault"], row["phase"]) for row in table] == [("broken wire", "closing"), ("broken wire", "holding")]
    assert "sensor after" in capsys.readouterr().out
    assert main(command) == 0
    assert "sensor after" not in capsys.readouterr().out
    with pytest.raises(FaultRowError, match="valve stuck open"):
        row_named("rust")
    assert main(["faults", "--row", "rust"]) == 1
