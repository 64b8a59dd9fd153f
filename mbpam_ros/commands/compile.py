"""Compile all kernels ahead, so that no node does it when it starts. What is in the cache on disk is not made anew.

The cache lies beside the sources, or in the user's cache directory where that cannot be written; numba looks at the
time of each source, and at the processor, so what has changed is compiled anew.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from numba.core import event

from mbpam_ros.actuator.chambers import CHANNEL_COUNT
from mbpam_ros.configuration import load_config
from mbpam_ros.estimation.estimator import BendEstimator, EstimatorConfig
from mbpam_ros.gripper import load_gripper
from mbpam_ros.nodes.compiling import garbage_collected_seldom
from mbpam_ros.plant.plant import build_plant
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.pneumatics.config import load_pneumatics
from mbpam_ros.pneumatics.registry import build_pneumatics, pneumatic_model_names
from mbpam_ros.study.executors import open_executor
from mbpam_ros.terminal import Progress
from mbpam_ros.vision.camera import camera_intrinsics, camera_pose, load_camera_config
from mbpam_ros.vision.depth import DepthImage
from mbpam_ros.vision.detector import ObjectDetector, load_detector_config


class _Counter(event.Listener):
    """Shows how many functions have been compiled."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._begun, self._began_s = progress, False, time.monotonic()
        self.count = 0

    def on_start(self, _: event.Event) -> None:
        if not self._begun:  # a function begins those it calls before it ends
            self._begun = True
            self._progress.say("compiling the kernels, once for this installation: up to a minute")

    def on_end(self, _: event.Event) -> None:
        self.count += 1
        self._progress.show(str(self))

    def __str__(self) -> str:
        return f"{self.count} functions compiled in {time.monotonic() - self._began_s:.0f} s"


def compile_all(progress: Progress, processes: int = 2) -> None:
    """Call every kernel once; what is not in the cache is compiled, and ``progress`` told how far.

    More than one process divide the work between two cores. Where ROS runs already, take one: it cannot be forked.
    """
    with open_executor(processes) as executor:
        beside = executor.submit(_compile_silently, (_see, _estimate))
        counter = _compile(progress, (_move, _flow))
        counter.count += beside.result()
    progress.say(str(counter) if counter.count else "all is compiled")


def _compile(progress: Progress, works: tuple[Callable[[], None], ...]) -> _Counter:
    counter = _Counter(progress)
    with garbage_collected_seldom(), event.install_listener("numba:compile", counter):
        for work in works:
            work()
    return counter


def _compile_silently(works: tuple[Callable[[], None], ...]) -> int:
    """Do it in another process; return how many functions were compiled."""
    return _compile(Progress(silent=True), works).count


def _estimate() -> None:
    estimator = BendEstimator.for_gripper(load_gripper(), load_config(EstimatorConfig, "estimator.yaml"))
    for time_s, gravity_m_s2 in ((0.0, (0.0, 0.0, 9.81)), (0.01, (9.81, 0.0, 0.0))):
        estimator.tips(estimator.update(time_s, np.zeros(CHANNEL_COUNT), gravity_m_s2))


def _flow() -> None:
    chamber = load_pneumatics().chamber
    for name in pneumatic_model_names():
        build_pneumatics(name, chamber).step(np.zeros(CHANNEL_COUNT), 0.01)


def _move() -> None:
    for scene in ("bulb", "empty"):
        build_plant(*load_scene(scene), load_gripper()).step(np.zeros(CHANNEL_COUNT), 0.01)


def _see() -> None:
    """Look for objects in a frame with a bright square, by colour and by depth."""
    camera = load_camera_config()
    intrinsics = camera_intrinsics(camera)
    detector = ObjectDetector(load_detector_config(), camera_pose(camera))
    image = np.full((intrinsics.height_px, intrinsics.width_px, 3), 60, np.uint8)
    depth_m = np.full(image.shape[:2], 0.115, np.float32)
    middle = np.s_[intrinsics.height_px // 3 : -intrinsics.height_px // 3, intrinsics.width_px // 3 : -300]
    image[middle], depth_m[middle] = 200, 0.085
    for depth in (None, DepthImage(depth_m)):
        detector.look(image, "rgb8", intrinsics, None, 0.115, depth=depth)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""


def run(options: argparse.Namespace) -> int:
    """Compile what is not compiled."""
    compile_all(Progress())
    return 0
