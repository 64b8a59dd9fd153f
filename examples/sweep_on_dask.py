"""Which pressure holds the bulb at which friction: independent grasps, spread over a Dask cluster.

python examples/sweep_on_dask.py [SCHEDULER]

SCHEDULER is the address of a running cluster, whose workers have mbpam_ros installed; without it, a cluster of this
machine's cores is started. Where Dask is not installed, threads do the same.
"""

import dataclasses
import itertools
import logging
import os
import sys
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import ExitStack

from mbpam_ros import load_gripper, load_scene
from mbpam_ros.study.grasp.trial import Trial, run_trial

FRICTIONS, PRESSURES_PA = (0.05, 0.6), (60e3, 100e3)  # longer lists make a finer map


def grasp(friction: float, pressure_gauge_pa: float) -> Trial:
    """Rest, close, lift and hold once; plain values in and out, so that any machine can do it."""
    scene, request = load_scene("bulb")
    scene = dataclasses.replace(scene, friction_coefficient=friction)
    return run_trial(scene, request.in_tier("arc"), load_gripper(), pressure_gauge_pa)


def open_cluster(stack: ExitStack, scheduler: str | None) -> Executor:
    """Return what runs jobs, until the stack is closed."""
    try:
        from distributed import Client, LocalCluster
    except ModuleNotFoundError:
        return stack.enter_context(ThreadPoolExecutor(os.cpu_count()))
    # Quiet: where workers take some seconds to end, on a busy machine, Dask warns of it.
    quiet = {"silence_logs": logging.ERROR, "dashboard_address": "127.0.0.1:0"}
    address = scheduler or stack.enter_context(LocalCluster(threads_per_worker=1, **quiet))
    return stack.enter_context(stack.enter_context(Client(address)).get_executor())


if __name__ == "__main__":
    cases = list(itertools.product(FRICTIONS, PRESSURES_PA))
    with ExitStack() as stack:
        cluster = open_cluster(stack, sys.argv[1] if len(sys.argv) > 1 else None)
        trials = list(cluster.map(grasp, *zip(*cases, strict=True)))
    for (friction, pressure_pa), trial in zip(cases, trials, strict=True):
        outcome = "held" if trial.held else "lost"
        print(f"friction {friction:4.2f}, {1e-3 * pressure_pa:3.0f} kPa: {outcome}, rose {1e3 * trial.rise_m:4.0f} mm")
