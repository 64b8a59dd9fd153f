"""What the whole muscle does at 100 kPa, in three dimensions.

    mbpam fe whole --json FILE                       every study
    mbpam fe whole --json FILE --study plate         one of them: unit_cell, ends, plate, mesh
    mbpam fe whole --json FILE --pictures DIR        and pictures of the deformed muscles, with matplotlib

"unit_cell" sets the weightless muscle beside as many unit cells; "ends" compares end pieces under gravity; "plate"
blocks the tip by a plate, with and without friction and weight, and for three thicknesses b of the cross; "mesh"
refines the elements. A muscle takes minutes. FILE is kept up to date, and muscles that it holds are not run again.
"""

from __future__ import annotations

import argparse

from mbpam_ros.commands.fe.model import add_result
from mbpam_ros.commands.result_arguments import result_folder
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.study.fe import whole_muscle_report
from mbpam_ros.study.pictures import require_matplotlib
from mbpam_ros.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    add_result(parser, "result, kept up to date")
    names = sorted(whole_muscle_report.STUDIES)
    parser.add_argument("--study", choices=names, action="append", help="one study; may be repeated")
    parser.add_argument("--pictures", type=result_folder, metavar="DIR", help="draw the muscles that the result holds")
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Run the muscles that FILE does not hold; draw all if asked."""
    progress, names = Progress(), options.study or list(whole_muscle_report.STUDIES)
    if options.pictures:
        require_matplotlib()
    with executor_for(options, len(whole_muscle_report.cases_of(names))) as executor:
        muscles = whole_muscle_report.run_studies(names, options.json, executor, progress)
    if options.pictures:
        for path in whole_muscle_report.draw(muscles, options.pictures):
            progress.say(str(path))
    return 0
