"""The command ``demo`` around its grasps: which, in which tier, what it prints, and how it ends."""

import contextlib
import json
import sys
import types

import pytest

from mbpam_ros.commands import demo  # isort: skip
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from mbpam_ros.commands.demo import GraspResult, Watcher
from mbpam_ros.commands.mbpam import main
from mbpam_ros.commands.system import NodeSystemError
from mbpam_ros.nodes.interface import NODES
from mbpam_ros.plant.scene import PAPER_SCENES, load_scene
from mbpam_ros.terminal import Progress

FIELDS = ["object", "mode", "expected_mode", "detected_size_m", "true_size_m", "held", "rise_m", "close_s", "hand_says"]


@pytest.fixture
def grasps(monkeypatch):
    """Scenes and tiers that were grasped; names in ``dropped`` and ``failing`` end so."""

    class Grasps(list):
        dropped, failing = (), ()

        def __call__(self, name, scene, tier, report, progress, watched):
            self.append((name, tier))
            if scene.name in self.failing:
                raise NodeSystemError("closing: not within 10 s")
            mode, size_m = scene.object.expected_mode, list(scene.object.size_m)
            held = scene.name not in self.dropped
            return GraspResult(scene.object.name, mode, mode, size_m, size_m, held, 0.1 * held, 0.58, "unknown")

    calls = Grasps()
    monkeypatch.setattr(demo, "grasp", calls)
    monkeypatch.setattr(demo, "exit_on_stop_signals", lambda: None)
    monkeypatch.setenv("ROS_DOMAIN_ID", "1")  # put back afterwards: the command takes one of its own
    return calls


class FakeOperator:
    """All nodes are healthy; hands a message to whoever listens to a topic."""

    health = {f"/{name}": (DiagnosticStatus.OK, "running", {}) for name in NODES}

    def __init__(self):
        self._heard = {}
        self.node = types.SimpleNamespace(create_subscription=lambda _, topic, heard, __: self.hear(topic, heard))

    def hear(self, topic, heard):
        self._heard[topic] = heard

    def publish_values(self, topic, **values):
        status = DiagnosticStatus(values=[KeyValue(key=key, value=value) for key, value in values.items()])
        self._heard[topic](DiagnosticArray(status=[status]) if topic == "/diagnostics" else status)


@pytest.mark.parametrize("arguments", [[], ["--objects", "all"]])
def test_by_default_the_papers_five_objects_are_grasped_by_rods(grasps, arguments):
    assert main(["demo", *arguments]) == 0
    assert grasps == [(name, "rod") for name in PAPER_SCENES] and len(grasps) == 5


def test_objects_and_tier_can_be_chosen(grasps):
    assert main(["demo", "--objects", "bulb", "tube", "--tier", "arc"]) == 0
    assert grasps == [("bulb", "arc"), ("tube", "arc")]


def test_a_tier_that_knows_no_objects_is_refused(grasps):
    with pytest.raises(SystemExit, match="2"):
        main(["demo", "--tier", "static"])
    assert not grasps


def test_a_scene_without_an_object_is_refused_before_anything_is_grasped(grasps, capsys):
    assert main(["demo", "--objects", "bulb", "empty"]) == 2
    assert not grasps and "scene empty: the demo needs an object" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [[], ["--objects", "all"], ["--objects", "tube"]])
def test_a_dropped_object_fails_the_demo(grasps, arguments, capsys):
    grasps.dropped = ("tube",)
    assert main(["demo", *arguments]) == 1
    shown = capsys.readouterr()
    assert shown.err == "mbpam demo: tube: dropped\n"
    assert [line.split()[-1] for line in shown.out.splitlines() if line.startswith("aluminium_tube")] == ["dropped"]


def test_a_stage_that_did_not_happen_fails_the_demo_and_the_other_objects_still_get_their_turn(grasps, capsys):
    grasps.failing = ("bulb",)
    assert main(["demo"]) == 1
    shown = capsys.readouterr()
    assert shown.err == "mbpam demo: bulb: closing: not within 10 s\n"
    assert len(grasps) == 5
    assert [line.split()[0] for line in shown.out.splitlines() if line.rstrip().endswith(" held")] == [
        "tomato", "banana", "aluminium_tube", "carton",
    ]  # fmt: skip


def test_the_table_has_the_papers_result_beside_the_own(grasps, capsys):
    main(["demo", "--objects", "carton"])
    head, _, row = capsys.readouterr().out.splitlines()
    column = head.index("paper")
    assert row[column:].startswith("held, mid_rod  mid_rod") and row.startswith("carton") and row.split()[-1] == "held"


def test_the_json_is_a_list_of_the_grasps(grasps, tmp_path):
    file = tmp_path / "objects.json"
    main(["demo", "--objects", "bulb", "carton", "--json", str(file)])
    rows = json.loads(file.read_text())
    assert [row["object"] for row in rows] == ["bulb", "carton"]
    assert [list(row) for row in rows] == [FIELDS, FIELDS]


def test_the_watcher_tells_the_slowest_pace_of_the_plant_in_the_grasp():
    operator = FakeOperator()
    watcher = Watcher(operator.node)
    operator.publish_values("grasp_state", phase="idle")
    operator.publish_values("/diagnostics", real_time_factor="0.30")  # starting
    assert watcher.pace == "the plant has not told its pace"
    operator.publish_values("grasp_state", phase="holding")
    for factor in ("1.00", "0.87", "0.99"):
        operator.publish_values("/diagnostics", real_time_factor=factor, tier="rod")
    assert watcher.pace == "the plant at 0.87 of real time or more"


def test_a_fault_ends_the_grasp_at_once_with_its_reason(monkeypatch, tmp_path):
    class FaultyOperator(FakeOperator):
        def wait_for(self, predicate, timeout_s, what):
            self.publish_values("grasp_state", phase="fault", reason="16 of 16 channels at fault")
            predicate()

        def close(self):
            pass

    processes = contextlib.nullcontext(types.SimpleNamespace(check=lambda: None))
    monkeypatch.setattr(demo, "NodeProcesses", lambda *_: processes)
    monkeypatch.setattr(demo, "Operator", lambda *_, **__: FaultyOperator())
    monkeypatch.setattr(demo, "_recorded", lambda *_: contextlib.nullcontext())
    with pytest.raises(NodeSystemError, match="waiting for plant.*: fault: 16 of 16 channels at fault"):
        demo.grasp("bulb", load_scene("bulb")[0], "rod", tmp_path, Progress())


@pytest.mark.parametrize(
    ("answers", "said"),
    [
        (["held: 98%"], "held: 98%"),
        (["unknown: 50% that something is held, by no sense", "unknown: 22%", "empty: 3%"], "empty: 3%"),
    ],
)
def test_the_hand_is_asked_again_until_an_image_has_told_it_whether_it_holds_something(monkeypatch, answers, said):
    told = iter(answers)
    operator = types.SimpleNamespace(ask=lambda *_: next(told))
    monkeypatch.setattr(demo, "_wait", lambda *_: None)
    assert demo._ask_while_unknown(operator) == said
    assert list(told) == []


def test_a_hand_that_does_not_get_to_know_is_believed_in_the_end(monkeypatch):
    now = iter(range(100))
    monkeypatch.setattr(demo.time, "monotonic", lambda: next(now))
    monkeypatch.setattr(demo, "_wait", lambda *_: None)
    assert demo._ask_while_unknown(types.SimpleNamespace(ask=lambda *_: "unknown: 22%")) == "unknown: 22%"
    assert next(now) - 1 > demo.CHECK_S


def test_the_plant_gets_the_scene_s_file_as_it_was_given(monkeypatch, tmp_path):
    given = {}

    def processes(_, arguments):
        given.update(arguments)
        raise NodeSystemError("enough")

    monkeypatch.setattr(demo, "NodeProcesses", processes)
    file = tmp_path / "bulb.yaml"
    with pytest.raises(NodeSystemError):
        demo.grasp(str(file), load_scene("bulb")[0], "rod", tmp_path, Progress())
    assert f"scene:={file}" in given["plant"]


def test_without_matplotlib_nothing_is_grasped(grasps, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    assert main(["demo"]) == 2
    assert "pictures need matplotlib" in capsys.readouterr().err
    assert grasps == []
