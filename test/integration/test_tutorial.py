"""The tutorial's commands for a machine without ROS, run as they stand."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from mbpam_ros.commands.system import NodeProcesses, Operator

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"```sh\n(\.venv/bin/mbpam_bringup &\n.*?)```", re.DOTALL)


@pytest.mark.usefixtures("compiled_plant")
def test_the_nodes_by_hand_grasp_lift_and_let_go_of_the_bulb(domain, log_directory, launch):
    started, *commands = BLOCK.search((ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8"))[1].splitlines()
    executable = re.fullmatch(r"\.venv/bin/mbpam_(\w+) &", started)[1]
    environment = {"ROS_DOMAIN_ID": str(domain)}
    said = []
    with NodeProcesses(log_directory, None, (), [executable], environment, launch) as processes:
        operator = Operator("test_operator", idle=processes.check, domain_id=domain)
        operator.wait_for_nodes()
        for command in commands:
            program, *arguments = command.split()
            assert program == ".venv/bin/python"
            ended = subprocess.run(
                [sys.executable, *arguments],
                cwd=ROOT,
                env=os.environ | environment,
                capture_output=True,
                text=True,
                timeout=60.0,
                check=False,
            )
            assert ended.returncode == 0, f"{command}: {ended.stdout}{ended.stderr}"
            said += ended.stdout.splitlines()
            phase = {"grasp/auto": "holding", "grasp/release": "idle"}.get(arguments[-1])
            if phase is not None:
                operator.wait_for(lambda wanted=phase: operator.grasp.get("phase") == wanted, 20.0, f"phase {phase}")
        operator.close()
    assert [line.partition(":")[0] for line in said] == [
        "valve_controller/enable",
        "grasp/auto",
        "plant/lift",
        "grasp/release",
    ]
