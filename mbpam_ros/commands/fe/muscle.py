"""One state of the whole finite element muscle: where its tip lies under pressures, loads on it and gravity.

    mbpam fe muscle --pattern pdc --pressure-kpa 100 --tip-force 0,0.05,0 --gravity 0,0,9.81 --json FILE

Without a symmetry plane; the same arguments and keys as "mbpam rod". FILE has the tip's position, direction, roll and
angle, the axis at each crest, mesh, wall, masses, versions and the CPU it took.
"""

from __future__ import annotations

import argparse

from mbpam_ros.commands.fe.model import add_result
from mbpam_ros.commands.fe.muscle_model import add_muscle_model, muscle_model
from mbpam_ros.commands.muscle_state import add_muscle_state, muscle_state
from mbpam_ros.study.fe.loaded_muscle import S_PER_STATE, LoadedMuscle
from mbpam_ros.study.muscle_states import answer_text
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import Progress, announce


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_muscle_state(parser)
    add_muscle_model(parser)
    add_result(parser, "where the answer goes")


def run(options: argparse.Namespace) -> int:
    """Solve, print and write."""
    wanted, model, progress = muscle_state(options), muscle_model(options), Progress()
    announce("one state from rest", S_PER_STATE[model.mesh], progress.stream)
    muscle = LoadedMuscle(model)
    row = muscle.row(wanted)
    model_row = {**model.settings(), "unknowns": muscle.unknown_count, "mass_kg": muscle.mass_kg}
    write_json(options.json, {**row, "model": model_row})
    progress.say(answer_text([row]))
    progress.say(f"{muscle.unknown_count} unknowns, {row['cpu_s']:.1f} s of CPU")
    return 0
