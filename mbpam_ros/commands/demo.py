"""Six node processes on loopback grasp, lift and release the paper's objects, and the result is shown.

Where the extra "record" is installed, each grasp is recorded in its folder, as by mbpam record.
Exit status 0 only if every stage happened for every object and each object rose with the hand.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from mbpam_ros.commands.system import NodeProcesses, NodeSystemError, Operator, Service, exit_on_stop_signals  # isort: skip
import numpy as np
from domain_coordinator import domain_id
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker

from mbpam_ros.commands.recorder import Recorder
from mbpam_ros.commands.result_arguments import result_file, result_folder
from mbpam_ros.commands.watcher import Watcher
from mbpam_ros.configuration import ConfigError
from mbpam_ros.nodes.interface import NODES
from mbpam_ros.nodes.message_definitions import definition
from mbpam_ros.plant.scene import PAPER_SCENES, Scene, load_scene
from mbpam_ros.study.grasp.trial import HELD_SHARE, HOLD_S
from mbpam_ros.study.grasp_report import draw_report
from mbpam_ros.study.pictures import PictureError, require_matplotlib
from mbpam_ros.study.recordings import RecordingWriter
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import Progress, table

ALL = "all"
"""What stands for the paper's five objects on the command progress."""

LEFT_OUT = ("camera/image_raw", "camera/depth/image_raw", *(f"{node}/alive" for node in NODES))
"""Most of the bytes, and much of what costs time beside six processes."""

RECORDING_BYTES = 10**9

RECORDER_LAG_S = 0.2
"""By how much the recording, of a subscription of its own, may be behind what the grasp was told by."""

PATIENCE_S = 10.0
RETRY_S = 0.25
WATCHED_HZ = 30.0


@dataclass
class GraspResult:
    """One row of the table: what was asked for, what was seen, what came of it, what the hand itself says."""

    object: str
    mode: str
    expected_mode: str
    detected_size_m: list[float]
    true_size_m: list[float]
    held: bool
    rise_m: float
    close_s: float
    hand_says: str


def grasp(name: str, scene: Scene, tier: str, report: Path, progress: Progress, watched: bool = False) -> GraspResult:
    """Start the six processes on a scene, grasp its object by the camera's choice, lift, release, and stop them.

    Args:
        name: of the scene, or its file.
        scene: what that holds, with an object on a support; its own tier is not used.
        tier: how the plant computes the muscles.
        report: where pictures and logs go.
        progress: shows what happens.
        watched: whether somebody looks at the page: fingers are told as often as it draws them.

    Raises:
        NodeSystemError: a stage did not happen.
    """
    if scene.support is None:
        raise NodeSystemError(f"scene {scene.name}: no support to see the object on")
    smooth = ["-p", f"marker_rate_hz:={WATCHED_HZ}"] if watched else []
    arguments = {
        "plant": ["-p", f"scene:={name}", "-p", f"tier:={tier}", *smooth],
        "state_estimator": smooth,
        "object_detector": ["-p", f"support_depth_m:={scene.support.depth_m}"],
    }
    with NodeProcesses(report / scene.name, arguments) as processes:
        operator = Operator("operator", idle=processes.check)
        try:
            with _recorded(operator, report / scene.name / "grasp.mcap"):
                result = _stages(scene, operator, report, progress)
                _wait(operator, RECORDER_LAG_S, "the recording's last word")
        finally:
            operator.close()
        codes = processes.stop()
    failed = {name: code for name, code in codes.items() if code != 0}
    if failed:
        raise NodeSystemError(f"nodes did not end cleanly on SIGINT: exit codes {failed}")
    return result


@contextmanager
def _recorded(operator: Operator, path: Path) -> Iterator[None]:
    """Record, where mcap is installed, all that tells of the grasp."""
    for old in path.parent.glob(f"{path.stem}*{path.suffix}"):
        old.unlink()
    try:
        writer = RecordingWriter(path, definition, RECORDING_BYTES)
    except ModuleNotFoundError:
        yield
        return
    Recorder(operator.node, writer, left_out=LEFT_OUT)
    with closing(writer):
        yield


def _stages(scene: Scene, operator: Operator, report: Path, progress: Progress) -> GraspResult:
    spec = scene.object
    if spec is None:
        raise NodeSystemError(f"scene {scene.name}: nothing to grasp")
    name = spec.label
    watcher = Watcher(operator.node)

    def wait_for(predicate: Callable[[], bool], timeout_s: float, what: str) -> None:
        def step() -> bool:
            progress.show(
                f"{name}: {what}  [{watcher.elapsed_s:4.1f} s, {watcher.grasp.get('phase', '-')}, "
                f"{1e-3 * watcher.greatest_pressure_pa:3.0f} kPa, rise {1e3 * np.nan_to_num(watcher.rise_m):4.0f} mm]"
            )
            if watcher.grasp.get("phase") == "fault":
                raise NodeSystemError(f"{what}: fault: {watcher.grasp['reason']} ({watcher.pace})")
            return predicate()

        operator.wait_for(step, timeout_s, what)

    progress.say(f"{name}: starting {len(NODES)} node processes")
    for node in NODES:
        hint = " (compiles its contact solver on the first run)" if node == "plant" else ""
        wait_for(partial(operator.health.__contains__, f"/{node}"), 180.0, f"waiting for {node}{hint}")
    progress.show(f"{name}: waiting for readiness")
    operator.enable()
    try:
        wait_for(lambda: not watcher.unheard, 20.0, "looking")
    except NodeSystemError as error:
        _, detector_says, _ = operator.health["/object_detector"]
        unheard = ", ".join(watcher.unheard) or "-"
        raise NodeSystemError(f"{error}; not heard: {unheard}; the object detector says: {detector_says}") from error
    watcher.set_start()
    watcher.snapshot("start")
    detection = watcher.detection
    if detection is None:
        raise NodeSystemError("looking: nothing detected")
    size_m = [round(float(value), 4) for value in _size(detection)]
    progress.say(f"{name}: detected a {detection.text} of {_millimetres(size_m)} mm")

    answer = _ask_patiently(operator, Trigger, "grasp/auto")
    watcher.event("grasp/auto")
    asked_s = watcher.elapsed_s
    progress.say(f"{name}: {answer}")
    wait_for(lambda: watcher.grasp.get("phase") == "holding", 10.0, "closing")
    close_s = watcher.elapsed_s - asked_s
    mode = watcher.grasp["mode"]
    watcher.event("holding")

    operator.ask(Trigger, "plant/lift")
    watcher.event("plant/lift")
    height_m = scene.lift.height_m
    wait_for(lambda: watcher.palm_rise_m > height_m - 1e-3, 30.0 + 10.0 * scene.lift.duration_s, "lifting")
    hold_until_s = watcher.elapsed_s + HOLD_S
    wait_for(lambda: watcher.elapsed_s > hold_until_s, HOLD_S + 5.0, "holding up")
    rise_m = watcher.rise_m
    held = rise_m >= HELD_SHARE * height_m
    watcher.snapshot("lifted")
    outcome = "held" if held else "dropped"
    hand_says = operator.ask(Trigger, "grasp/check")
    watcher.event("grasp/check")
    progress.say(f"{name}: {outcome}, rose {1e3 * rise_m:.0f} of {1e3 * height_m:.0f} mm ({watcher.pace})")
    progress.say(f"{name}: the hand says {hand_says}")

    operator.ask(Trigger, "plant/lower")
    wait_for(lambda: watcher.palm_rise_m < 1e-3, 30.0 + 10.0 * scene.lift.duration_s, "lowering")
    operator.ask(Trigger, "grasp/release")
    watcher.event("grasp/release")
    wait_for(lambda: watcher.grasp.get("phase") == "idle", 15.0, "releasing")
    progress.say(f"{name}: released")

    watcher.record.title = f"{name}: {mode}, {outcome}"
    watcher.record.object_size_m, watcher.record.object_shape = spec.size_m, spec.shape
    picture = report / f"{scene.name}.png"
    draw_report(watcher.record, picture)
    progress.say(f"{name}: picture report in {picture}")
    return GraspResult(
        object=spec.name,
        mode=mode,
        expected_mode=spec.expected_mode,
        detected_size_m=size_m,
        true_size_m=list(spec.size_m),
        held=held,
        rise_m=round(rise_m, 4),
        close_s=round(close_s, 3),
        hand_says=hand_says,
    )


def _ask_patiently(operator: Operator, service_type: type[Service], name: str) -> str:
    """Ask again while refused: the server may not have discovered all its sources when we have."""
    deadline = time.monotonic() + PATIENCE_S
    while True:
        try:
            return operator.ask(service_type, name)
        except NodeSystemError:
            if time.monotonic() > deadline:
                raise
            _wait(operator, RETRY_S, "the next try")


def _wait(operator: Operator, duration_s: float, what: str) -> None:
    """Hear all that comes for so long."""
    until_s = time.monotonic() + duration_s
    operator.wait_for(lambda: time.monotonic() > until_s, PATIENCE_S + duration_s, what)


def _size(marker: Marker) -> tuple[float, float, float]:
    return marker.scale.x, marker.scale.y, marker.scale.z


def _millimetres(size_m: list[float]) -> str:
    return " x ".join(f"{1e3 * value:.1f}" for value in size_m)


def _print_table(grasped: Sequence[tuple[Scene, GraspResult]]) -> None:
    rows = [
        (
            result.object,
            _millimetres(result.detected_size_m),
            _millimetres(result.true_size_m),
            f"held, {result.expected_mode}" if scene.name in PAPER_SCENES else "-",
            result.mode,
            f"{result.close_s:.2f}",
            result.hand_says.partition(" that ")[0],
            f"{1e3 * result.rise_m:.0f}",
            "held" if result.held else "dropped",
        )
        for scene, result in grasped
    ]
    head = ("object", "detected [mm]", "true [mm]", "paper", "mode", "close [s]", "hand says", "rise [mm]", "result")
    print(table(head, rows))


def _scenes(names: Sequence[str]) -> dict[str, Scene]:
    scenes = {name: load_scene(name)[0] for name in (PAPER_SCENES if names == [ALL] else names)}
    for scene in scenes.values():
        if scene.object is None or scene.support is None:
            raise ConfigError(f"scene {scene.name}: the demo needs an object on a support")
    return scenes


@contextmanager
def _page(wanted: bool) -> Iterator[None]:
    """Serve ``mbpam view`` beside the grasps, in a process of its own so that it holds up none of them."""
    if not wanted:
        yield
        return
    import viser  # noqa: F401  says which extra is missing before anything is started

    page = subprocess.Popen([sys.executable, "-m", "mbpam_ros.commands", "view"], start_new_session=True)
    try:
        yield
    finally:
        page.terminate()
        page.wait()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        "--objects", nargs="+", default=[ALL], metavar="NAME", help="scenes or their files, or: all (default: all)"
    )
    parser.add_argument("--tier", choices=("arc", "rod"), default="rod", help="how muscles are computed (default: rod)")
    parser.add_argument("--json", type=result_file, metavar="FILE", help="write the table as JSON")
    parser.add_argument(
        "--report", type=result_folder, default=Path("report"), metavar="DIR", help="pictures and logs go here"
    )
    parser.add_argument("--view", action="store_true", help="watch it in a browser meanwhile, as with mbpam view")


def run(options: argparse.Namespace) -> int:
    """Grasp each object; return 1 if a stage did not happen or an object was dropped, 2 for what cannot be grasped."""
    exit_on_stop_signals()
    progress = Progress()
    grasped: list[tuple[Scene, GraspResult]] = []
    failures: list[str] = []
    try:
        require_matplotlib()  # before minutes are spent on what cannot be drawn
        scenes = _scenes(options.objects)
    except (ConfigError, PictureError) as error:
        print(f"mbpam demo: {error}", file=sys.stderr)
        return 2
    with domain_id() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        with _page(options.view):
            for name, scene in scenes.items():
                try:
                    grasped.append((scene, grasp(name, scene, options.tier, options.report, progress, options.view)))
                except NodeSystemError as error:
                    failures.append(f"{scene.name}: {error}")
                    progress.say(f"failed: {failures[-1]}")
    _print_table(grasped)
    if options.json is not None:
        write_json(options.json, [vars(result) for _, result in grasped])
    failures += [f"{scene.name}: dropped" for scene, result in grasped if not result.held]
    for failure in failures:
        print(f"mbpam demo: {failure}", file=sys.stderr)
    return 1 if failures else 0
