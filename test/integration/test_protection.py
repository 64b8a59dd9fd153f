"""SROS2 asked for where there is none: one line."""

import os
import subprocess
import sys

import pytest

FILES = ("identity_ca.cert.pem", "cert.pem", "key.pem", "permissions_ca.cert.pem", "governance.p7s", "permissions.p7s")


def start(domain, **security):
    environment = os.environ | {"ROS_DOMAIN_ID": str(domain), "ROS_SECURITY_ENABLE": "true", **security}
    command = [sys.executable, "-m", "mbpam_ros.nodes", "pressure_sensor", "--ros-args", "-p", "pneumatics:=nowhere"]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("strategy", ["Enforce", "Permissive"])
def test_without_the_plug_in_a_node_with_an_enclave_says_so_in_one_line(domain, tmp_path, strategy):
    enclave = tmp_path / "enclaves"
    enclave.mkdir()
    for name in FILES:
        (enclave / name).touch()
    ended = start(domain, ROS_SECURITY_KEYSTORE=str(tmp_path), ROS_SECURITY_STRATEGY=strategy)
    assert ended.returncode == 2
    said = [line for line in ended.stderr.splitlines() if not line.startswith("[INFO]")]
    assert len(said) == 1 and "no security plug-in" in said[0] and "config/security/policy.xml" in said[0], ended.stderr


def test_without_a_keystore_it_says_that_nothing_is_protected(domain):
    ended = start(domain)
    assert [line for line in ended.stderr.splitlines() if line.startswith("warning: ROS_SECURITY_ENABLE is set")]
