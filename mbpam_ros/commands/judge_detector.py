"""How well objects are detected, on random images that are drawn for it.

    mbpam judge-detector --images 120 --json judged.json --sheet worst.png

Two renderers: MuJoCo off-screen (extra "bench"; MUJOCO_GL=egl or osmesa), with tables, lamps, cameras, shapes,
textures and clutter at random, and the simulated palm camera's own. Each image is looked at alone, with images of the
empty table, and with a depth image. The sets "tune" and "report" share no table and no mesh. Same seed, same images.

    mbpam judge-detector --set tune --images 200 --fit detector.yaml

fits the weights of the confidence to all that the detector weighs in these images, and writes a detector file with
them.

    mbpam judge-detector --bent-fingers

takes the plant instead, whose hand closes over the paper's objects and over an empty table.
"""

from __future__ import annotations

import argparse
import math
import os
from collections import defaultdict
from typing import Any

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.configuration import config_path
from mbpam_ros.grasp.modes import MODE_NAMES
from mbpam_ros.study.judge.bent_fingers import (
    OBJECTS,
    PRESSURES_PA,
    BentSight,
    bent_figures,
    look_at_bent_fingers,
    mask_cost_s,
)
from mbpam_ros.study.judge.judge import Judged, contact_sheet, figures, judge_scenes, without_budget
from mbpam_ros.study.judge.reliability_diagram import draw_reliability
from mbpam_ros.study.judge.tuning import refitted, with_weights
from mbpam_ros.study.pictures import require_matplotlib
from mbpam_ros.study.provenance import machine, versions
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import Progress, table
from mbpam_ros.vision.detector import SOURCES, DetectorConfig, load_detector_config
from mbpam_ros.vision.image_file import write_image

_COLUMNS = ("recall", "shape_right", "mode_right", "wrong_mode", "width_error_p95_mm", "false_alarms_per_image")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--images", type=int, default=120, metavar="N", help="scenes of each renderer (default: 120)")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the first scene (default: 0)")
    parser.add_argument("--set", choices=("tune", "report"), default="report", help="which set (default: report)")
    parser.add_argument(
        "--renderers", nargs="+", choices=("own", "mujoco"), default=("own", "mujoco"), help="(default: both)"
    )
    parser.add_argument("--detector", default="detector.yaml", metavar="YAML", help="thresholds and weights")
    parser.add_argument(
        "--bent-fingers", action="store_true", help="instead: a hand that closes, told of its fingers and not"
    )
    parser.add_argument("--all-the-time", action="store_true", help="without the budget of processor time")
    parser.add_argument("--json", type=result_file, metavar="FILE", help="where the figures go")
    parser.add_argument(
        "--fit", type=result_file, metavar="YAML", help="where a detector file goes, its weights fitted to these images"
    )
    parser.add_argument("--diagram", type=result_file, metavar="FILE", help="where the reliability diagram goes")
    parser.add_argument("--sheet", type=result_file, metavar="FILE", help="where a picture of the worst images goes")


def run(options: argparse.Namespace) -> int:
    """Judge, print the table and write the figures."""
    os.environ.setdefault("MUJOCO_GL", "egl")
    if options.diagram is not None:
        require_matplotlib()
    config = load_detector_config(options.detector)
    if options.all_the_time:
        config = without_budget(config)
    progress = Progress()
    if options.bent_fingers:
        return _judge_bent_fingers(options, config, progress)
    judged: dict[tuple[str, str], list[Judged]] = defaultdict(list)
    seeds = range(options.seed, options.seed + options.images)
    for renderer in options.renderers:
        for count, rows in enumerate(judge_scenes(renderer, options.set, seeds, config), 1):
            for row in rows:
                judged[renderer, row.source].append(row)
            progress.show(f"{renderer}: {count} of {options.images} scenes")
    content = {
        f"{renderer} {source}": figures(judged[renderer, source])
        for renderer in options.renderers
        for source in SOURCES
        if judged[renderer, source]
    }
    print(_text(content))
    if options.json is not None:
        made_with = {**machine(), **versions("numpy", "opencv-python-headless")}
        settings = {"images": options.images, "seed": options.seed, "set": options.set, **made_with}
        write_json(options.json, {"settings": settings, "figures": content})
    if options.fit is not None:
        of_sources = {source: [row for name in options.renderers for row in judged[name, source]] for source in SOURCES}
        text = config_path(options.detector).read_text(encoding="utf-8")
        options.fit.write_text(with_weights(text, refitted(config, of_sources)), encoding="utf-8")
    if options.diagram is not None:
        draw_reliability({name: values["reliability"] for name, values in content.items()}, options.diagram)
    if options.sheet is not None:
        write_image(options.sheet, contact_sheet([item for items in judged.values() for item in items]))
    return 0


def _judge_bent_fingers(options: argparse.Namespace, config: DetectorConfig, progress: Progress) -> int:
    sights: list[BentSight] = []
    runs = len(PRESSURES_PA) * (len(OBJECTS) + len(MODE_NAMES))
    for count, run_sights in enumerate(look_at_bent_fingers(config), 1):
        sights += run_sights
        progress.show(f"{count} of {runs} times closed")
    rows = bent_figures(sights)
    head = ("over", "kPa", "told", "images", *(f"{source}: recall, false alarms" for source in SOURCES))
    print(table(head, [_bent_row(row) for row in rows]))
    costs_ms = {f"{bend_deg}": 1e3 * mask_cost_s(config, math.radians(bend_deg)) for bend_deg in (0, 12, 34, 98)}
    print("; ".join(f"mask at {bend_deg} deg: {cost_ms:.2f} ms" for bend_deg, cost_ms in costs_ms.items()))
    if options.json is not None:
        made_with = {**machine(), **versions("numpy", "opencv-python-headless")}
        write_json(options.json, {"settings": made_with, "figures": rows, "mask_ms_by_bend_deg": costs_ms})
    return 0


def _bent_row(row: dict[str, Any]) -> tuple[str, ...]:
    recall = "-" if row["over"] == "empty table" else "{:.2f}"
    shares = (f"{recall.format(row[f'{s}_recall'])}, {row[f'{s}_false_alarms']:.2f}" for s in SOURCES)
    told = "yes" if row["told"] else "no"
    return row["over"], f"{1e-3 * row['pressure_gauge_pa']:.0f}", told, f"{row['images']:.0f}", *shares


def _text(content: dict[str, dict]) -> str:
    head = ("images", "n", *(name.replace("_", " ") for name in _COLUMNS), "calibration", "CPU ms", "p99")
    rows = [
        (
            name,
            str(values["graspable"]["objects"]),
            *(f"{values['graspable'].get(column, float('nan')):.3f}" for column in _COLUMNS),
            f"{values['calibration_error']:.3f}",
            f"{values['cpu_ms_median']:.0f}",
            f"{values['cpu_ms_p99']:.0f}",
        )
        for name, values in content.items()
    ]
    return f"{table(head, rows)}\nof objects that the gripper can grasp where they are"
