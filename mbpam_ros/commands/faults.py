"""Faults of the machine, drawn at random, one a grasp: who sees them, how soon, and what comes of it.

    mbpam faults --json FILE                            every row, twenty trials in each tier
    mbpam faults --row "valve stuck open" --trials 5    one row
    mbpam faults --pneumatics iso6358                   on a machine with orifices, a tank and volumes
    mbpam faults --list                                 the rows
    mbpam faults --sound 2 --json FILE                  two hours of a machine without faults: are there false alarms?

In simulated time without ROS, through the gripper's own sensing, observers, arbitration and loops. Channel, moment,
size and object are drawn from a seed. While closing the fault comes at any moment of it, while holding after the lift.
Then the machine is mended, and the gripper must come back to where a grasp is accepted, by release and reset alone. The
table is printed in Markdown; the exit status is 1 where a row is not what it should be.

With --json, an interrupt (Ctrl-C) keeps the finished trials beside FILE; the same command goes on from there.
"""

from __future__ import annotations

import argparse

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.pneumatics.registry import pneumatic_model_names
from mbpam_ros.study.faults.draws import ROWS, SEED, row_named
from mbpam_ros.study.faults.sound import S_PER_SPAN, sound_jobs, sound_row, sound_text, span_text
from mbpam_ros.study.faults.table import (
    ROW_NAMES,
    S_PER_TRIAL,
    TIERS,
    settings,
    shortcomings,
    table_rows,
    table_text,
    trial_jobs,
    trial_text,
)
from mbpam_ros.study.faults.trial import trial_row
from mbpam_ros.study.jobs import ResultFile, run_jobs, runs_beside
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import Progress


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--json", type=result_file, metavar="FILE", help="where the table goes")
    parser.add_argument("--row", action="append", metavar="NAME", help="a row of the table, may be given again")
    parser.add_argument("--trials", type=int, default=20, metavar="N", help="in each row, phase and tier (default: 20)")
    parser.add_argument("--seed", type=int, default=SEED, metavar="N", help=f"of what is drawn (default: {SEED})")
    parser.add_argument("--tier", choices=TIERS, help="how muscles are computed (default: both)")
    parser.add_argument(
        "--pneumatics",
        choices=pneumatic_model_names(),
        help="how valves and chambers are computed (default: lag; with --sound drawn for each two minutes)",
    )
    parser.add_argument("--sound", type=float, metavar="HOURS", help="no fault: count false alarms in so many hours")
    parser.add_argument("--list", action="store_true", help="print the names of the rows and end")
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Try the faults, and print the table; return 1 if a row is not what it should be."""
    if options.list:
        print("\n".join(ROW_NAMES))
        return 0
    tiers = TIERS if options.tier is None else (options.tier,)
    if options.sound is not None:
        return _use_a_sound_machine(options, tiers)
    rows = [row_named(name) for name in options.row] if options.row else list(ROWS)
    jobs = trial_jobs(rows, tiers, options.trials, options.pneumatics or "lag", options.seed)
    kept = ResultFile(runs_beside(options.json), settings(options.seed), "trials", lambda trial: trial["job"])
    with executor_for(options, len(jobs)) as executor:
        run_jobs(jobs, trial_row, kept, executor, Progress(), trial_text, s_per_job=S_PER_TRIAL)
    table = table_rows(kept.write(list(jobs))["trials"])
    if options.json is not None:
        write_json(options.json, table)
    print(table_text(table))
    return 1 if any(shortcomings(row) for row in table) else 0


def _use_a_sound_machine(options: argparse.Namespace, tiers: tuple[str, ...]) -> int:
    jobs = sound_jobs(options.sound, tiers, options.pneumatics, options.seed)
    kept = ResultFile(options.json, settings(options.seed), "spans", lambda row: row["job"])
    with executor_for(options, len(jobs)) as executor:
        run_jobs(jobs, sound_row, kept, executor, Progress(), span_text, s_per_job=S_PER_SPAN)
    spans = kept.write(list(jobs))["spans"]
    print(sound_text(spans))
    return 1 if any(row["found"] for row in spans) else 0
