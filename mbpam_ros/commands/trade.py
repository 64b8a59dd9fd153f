"""What accuracy costs, measured.

    mbpam trade --json FILE            every case at every tier, number of modes, step and pneumatic model
    mbpam trade --json FILE --strains  rods that stretch and twist besides, and what the equations leave out
    mbpam trade --json FILE --quick    two cases, a few fidelities, a coarser reference; less than a minute

FILE becomes the list of rows (mbpam_ros.plant.fidelity.Measured), FILE.png the Pareto plot; finished runs are kept in
FILE_runs.json. A whole run also renews the table that the planner reads (--table). Errors are of the solution: against
a rod of six modes (four of twist and stretch, where the muscle has them) at 0.1 ms with ISO 6358 pneumatics at 0.5 ms.
How far that is from one mode less at twice the steps, and at rest in the air from SciPy's solution of the
boundary-value problem, is printed and kept in the table. With --strains errors of the model, converged rods beside the
whole muscle in finite elements, are printed and kept too; the tolerance of a plan is then on the sum of both.

CPU times are those of the plant's steps alone; but workers share caches and clock with each other, so a table to plan
from is measured by one.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

from mbpam_ros.actuator.rod_law import finite_element_rod_law
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.configuration import config_directory
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import TABLE, FidelityTable, ModelError
from mbpam_ros.study.fidelity import trade
from mbpam_ros.study.fidelity.cases import all_cases
from mbpam_ros.study.fidelity.model_error import model_errors, states_file
from mbpam_ros.study.fidelity.picture import draw_trade
from mbpam_ros.study.jobs import ResultFile, runs_beside
from mbpam_ros.study.pictures import PictureError
from mbpam_ros.study.provenance import machine, sources_digest, versions
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import Progress, announce

_ROUNDS = 3
_S_PER_RUN = 0.3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--json", type=Path, metavar="FILE", required=True, help="where the rows go")
    parser.add_argument("--quick", action="store_true", help="a subset, in less than a minute")
    parser.add_argument(
        "--strains", action="store_true", help="rods that stretch and twist too, and the errors of the model"
    )
    parser.add_argument("--rounds", type=int, default=_ROUNDS, help="through the grid; CPU times are their medians")
    parser.add_argument(
        "--table", type=Path, metavar="FILE", help="planner's table (default: the one it reads; none with --quick)"
    )
    add_workers(parser, default=1)


def run(options: argparse.Namespace) -> int:
    """Measure, write rows, table and picture."""
    progress, wanted = Progress(), _wanted(options)
    here, libraries = machine(), versions("numpy", "numba", "scipy")
    settings = {
        "sources": sources_digest(),
        "machine": here,
        "versions": libraries,
        "coarse": wanted.coarse,
        "rounds": wanted.rounds,
    }
    kept = ResultFile(runs_beside(options.json), settings, "runs", lambda row: row["job"])
    runs = len(wanted.runs())
    expected_s = 30.0 if options.quick else 120.0 + _S_PER_RUN * runs
    announce(f"{runs} runs and {len(wanted.cases)} references", expected_s, progress.stream)
    with executor_for(options, runs) as executor:
        rows, checks = trade.measure(wanted, load_gripper(), kept, executor, progress)
    models = _model_errors(progress) if options.strains else ()
    values = [trade.row_values(row) for row in rows]
    write_json(options.json, values)
    table = options.table or (None if options.quick else config_directory() / TABLE)
    if table is not None:
        whole = FidelityTable(tuple(rows), checks, here, libraries, models)
        write_json(table, {**dataclasses.asdict(whole), "rows": values})
        progress.say(f"table: {table}")
    try:
        picture = options.json.with_suffix(".png")
        draw_trade(rows, checks, models, picture)
        progress.say(f"picture: {picture}")
    except PictureError as error:
        progress.say(str(error))
    return 0


def _model_errors(progress: Progress) -> tuple[ModelError, ...]:
    """Return how far the equations are off the finite elements, where these are there to be compared with."""
    states = states_file()
    if states is None:
        progress.say("no states of the whole muscle (mbpam fe states): the errors of the model are not told")
        return ()
    found = model_errors(states, finite_element_rod_law(), load_gripper().geometry)
    for each in found:
        progress.say(
            f"error of the model, {', '.join(each.strains)}: {each.free_pct:.2g} % at the tip in the air, "
            f"{each.loaded_pct:.2g} % with loads on it"
        )
    return found


def _wanted(options: argparse.Namespace) -> trade.Trade:
    grid = trade.quick_fidelities() if options.quick else trade.fidelities()
    if options.strains:
        grid = trade.with_strains(grid)
    if options.quick:
        cases = tuple(case for case in all_cases() if case.name in trade.QUICK_CASES)
        return trade.Trade(cases, grid, rounds=1, coarse=True)
    return trade.Trade(all_cases(), grid, options.rounds)
