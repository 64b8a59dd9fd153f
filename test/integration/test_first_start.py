"""The first start of the plant, whose kernels are not compiled yet."""

import os
import signal
import subprocess
import sys

import pytest

SOONER_THAN_ANY_MACHINE_HAS_COMPILED_S = 10.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_plant_that_compiles_says_so_and_ends_at_a_stop_signal(domain, tmp_path, number):
    plant = subprocess.Popen(
        [sys.executable, "-m", "mbpam_ros.nodes", "plant"],
        env={**os.environ, "ROS_DOMAIN_ID": str(domain), "NUMBA_CACHE_DIR": str(tmp_path)},
        stderr=subprocess.PIPE,
        text=True,
    )
    assert "compiling the kernels" in plant.stderr.readline()
    plant.send_signal(number)
    _, said_at_the_end = plant.communicate(timeout=SOONER_THAN_ANY_MACHINE_HAS_COMPILED_S)
    assert (plant.returncode, said_at_the_end) == (0, "")
