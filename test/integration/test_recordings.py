"""Recordings: what is written is what was sent, for other readers too, even of a recorder that was killed."""

import shutil

import numpy as np
import pytest

pytest.importorskip("mcap")

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from mbpam_ros.actuator.chambers import CHANNEL_NAMES
from mbpam_ros.commands.mbpam import main
from mbpam_ros.commands.recorder import SHARED, Recorder
from mbpam_ros.commands.report import grasp_record, last_grasp_ns
from mbpam_ros.configuration import load_config
from mbpam_ros.estimation.estimator import BendEstimator, EstimatorConfig
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.interface import TOPICS
from mbpam_ros.nodes.message_definitions import DefinitionError, definition, message_class
from mbpam_ros.nodes.messages import joint_state, time_stamp
from mbpam_ros.nodes.runtime import LATCHED, NEWEST
from mbpam_ros.study.recordings import Recorded, RecordingError, RecordingWriter, read_recording

WHOLE = 10**9
TYPES = sorted({topic.message_type for topic in TOPICS})


def pressures(number):
    return joint_state(time_stamp(0.01 * number), CHANNEL_NAMES, effort=1e3 * np.arange(16) * (1 + number % 3))


@pytest.fixture
def recording(tmp_path):
    """A recording of 30 pressures 10 ms apart, of one gripper and of another in a namespace."""
    path = tmp_path / "pressures.mcap"
    writer = RecordingWriter(path, definition, WHOLE)
    for number in range(30):
        for topic in ("/chamber_states", "/right/chamber_states"):
            data = serialize_message(pressures(number))
            writer.write(Recorded(topic, "sensor_msgs/msg/JointState", 10**9 + 10**7 * number, data), "")
    writer.close()
    return path


def test_what_is_sent_is_recorded_and_read_by_another_implementation_though_nobody_finished_it(graph, tmp_path):
    states = graph.test_node.create_publisher(DiagnosticStatus, "right/grasp_state", LATCHED)
    states.publish(DiagnosticStatus(name="grasp", message="idle"))  # before anybody listens
    readings = graph.test_node.create_publisher(JointState, "right/chamber_states", NEWEST)
    left_out = graph.test_node.create_publisher(JointState, "right/transducers", NEWEST)
    node = graph._adopt(Node("recorder", context=graph._context, namespace="right", use_global_arguments=False))
    writer = RecordingWriter(tmp_path / "r.mcap", definition, 4000)
    recorder = Recorder(node, writer, left_out=["transducers"])
    graph.spin_until(lambda: readings.get_subscription_count() and recorder.counts, "the recorder")
    for number in range(40):
        readings.publish(pressures(number))
        left_out.publish(pressures(number))
        graph.spin_until(lambda sent=number: recorder.counts["/right/chamber_states"] > sent, "a reading written")
        if number % 10 == 9:
            writer.flush()
    killed = tmp_path / "killed"
    killed.mkdir()
    for path in writer.paths:  # what a killed recorder leaves
        shutil.copy(path, killed)
    writer.close()
    assert len(writer.paths) >= 2 and not recorder.lost
    for folder in (tmp_path, killed):
        read = list(read_recording(folder / "r.mcap"))
        assert [each.topic for each in read].count("/right/chamber_states") == 40
        assert {each.topic for each in read} == {"/right/chamber_states", "/right/grasp_state"} | (
            {each.topic for each in read} & set(SHARED)
        )
        times = [each.received_ns for each in read]
        assert times == sorted(times)
    reader = pytest.importorskip("rosbags.highlevel").AnyReader(writer.paths)
    with reader:
        said = [
            reader.deserialize(data, each.msgtype)
            for each, _, data in reader.messages()
            if each.topic == "/right/chamber_states"
        ]
        types = {each.topic: each.msgtype for each in reader.connections}
        offered = {each.topic: each.ext.offered_qos_profiles[0] for each in reader.connections}
    assert types["/right/chamber_states"] == "sensor_msgs/msg/JointState"
    assert [list(each.effort) for each in said] == [list(pressures(number).effort) for number in range(40)]
    assert offered["/right/grasp_state"].durability.name == "TRANSIENT_LOCAL"
    assert offered["/right/chamber_states"].reliability.name == "BEST_EFFORT"


def test_definitions_are_those_that_another_implementation_has_of_the_types(graph):
    typesys = pytest.importorskip("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    for name in TYPES:
        found = typesys.get_types_from_msg(definition(name).partition("=" * 80)[0], name)
        assert found[name] == store.fielddefs[name], name
        inner = [line.split()[1] for line in definition(name).splitlines() if line.startswith("MSG: ")]
        assert len(inner) == len(set(inner))
    with pytest.raises(DefinitionError, match="nobody_msgs"):
        definition("nobody_msgs/msg/Nothing")
    with pytest.raises(DefinitionError, match="nobody_msgs"):
        message_class("nobody_msgs/msg/Nothing")


def test_a_replayed_node_says_the_same_in_every_run_and_what_it_computes(recording, tmp_path, capsys):
    runs = []
    for name in ("a.mcap", "b.mcap"):
        command = ["replay", str(recording), "--into", "state_estimator", "--namespace", "right"]
        assert main([*command, "--out", str(tmp_path / name)]) == 0
        told = [
            (each, deserialize_message(each.data, message_class(each.type_name)))
            for each in read_recording(tmp_path / name)
        ]
        runs.append([(each.topic, each.received_ns, message) for each, message in told])
    assert runs[0] == runs[1] and "heard: 30 of /right/chamber_states" in capsys.readouterr().out
    bends = [message.position for topic, _, message in runs[0] if topic == "/right/joint_states"]
    estimator = BendEstimator.for_gripper(load_gripper(), load_config(EstimatorConfig, "estimator.yaml"))
    expected = [estimator.update(0.01 * number, pressures(number).effort).bend_rad.ravel() for number in range(30)]
    np.testing.assert_allclose(bends, expected, atol=1e-15)  # of the stamps' rounding
    assert {topic for topic, _, _ in runs[0]} >= {"/right/finger_tips", "/right/finger_markers", "/diagnostics"}


def test_a_recording_is_not_written_over_nor_made_up(recording, tmp_path, capsys):
    assert main(["record", str(recording)]) == 1
    assert "is there already" in capsys.readouterr().err
    assert main(["report", str(recording)]) == 1
    assert "no grasp in it" in capsys.readouterr().err
    (tmp_path / "text.mcap").write_text("no MCAP at all")
    for path in ("text.mcap", "missing.mcap"):
        with pytest.raises(RecordingError, match=path):
            list(read_recording(tmp_path / path))


def test_the_last_grasp_of_a_recording_is_found_and_told():
    said = {0: "idle", 10: "closing", 12: "holding", 20: "releasing", 21: "idle", 30: "closing", 31: "fault"}
    messages = []
    for time_s, phase in said.items():
        told = {"phase": phase, "mode": "envelope", "reason": "why"}
        values = [KeyValue(key=key, value=value) for key, value in told.items()]
        data = serialize_message(DiagnosticStatus(values=values))
        messages.append(Recorded("/grasp_state", "diagnostic_msgs/msg/DiagnosticStatus", time_s * 10**9, data))
    assert last_grasp_ns(messages) == (25 * 10**9, 31 * 10**9)
    assert last_grasp_ns(messages[:5]) == (5 * 10**9, 21 * 10**9)
    assert last_grasp_ns(messages, "right") is None
    record = grasp_record(messages[4:])
    assert record.title == "envelope, fault: why"
    assert record.events == {"closing": pytest.approx(9.0), "fault": pytest.approx(10.0)}
