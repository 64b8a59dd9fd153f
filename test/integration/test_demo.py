"""``mbpam demo`` with its six processes, on the one object for which pressure and tier matter most."""

import json
import subprocess
import sys
from itertools import groupby

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.serialization import deserialize_message

from mbpam_ros.study.recordings import read_recording


@pytest.mark.usefixtures("compiled_plant", "log_directory")
def test_the_demo_grasps_lifts_and_releases_the_tube(tmp_path):
    report, file = tmp_path / "report", tmp_path / "tube.json"
    command = [sys.executable, "-m", "mbpam_ros.commands", "demo", "--objects", "tube"]
    ended = subprocess.run([*command, "--report", str(report), "--json", str(file)], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    (row,) = json.loads(file.read_text())
    assert (row["object"], row["mode"], row["held"]) == ("aluminium_tube", "slender_rod", True)
    assert abs(row["rise_m"] - 0.1) < 0.01
    assert max(abs(a - b) for a, b in zip(row["detected_size_m"], row["true_size_m"], strict=True)) < 0.005
    assert (report / "tube.png").read_bytes().startswith(b"\x89PNG")
    assert "aluminium tube: released" in ended.stdout
    pytest.importorskip("mcap")
    phases = []
    for message in read_recording(report / "tube" / "grasp.mcap"):
        if message.topic == "/grasp_state":
            state = deserialize_message(message.data, DiagnosticStatus)
            phases.append(next(item.value for item in state.values if item.key == "phase"))
    assert [phase for phase, _ in groupby(phases)][-4:] == ["closing", "holding", "releasing", "idle"]
