"""What accuracy costs, measured.

    mbpam trade --json FILE            every case at every tier, number of modes, step and pneumatic model
    mbpam trade --json FILE --quick    two cases, a few fidelities, a coarser reference; less than a minute

FILE becomes the list of rows (mbpam_ros.plant.fidelity.Measured), FILE.png the Pareto plot; finished runs are kept in
FILE_runs.json, and the same command goes on from them. A whole run also renews the table that the planner reads
(--table): the rows, and promises made from 60 scenes drawn at random. Errors are of the solution: against a rod of six
modes (four of twist and stretch, where the muscle has them) at 0.1 ms with ISO 6358 pneumatics at 0.5 ms. How far that
is from one mode less at twice the steps, and at rest in the air from SciPy's solution of the boundary-value problem, is
printed and kept in the table. With --strains, as by default, rods that stretch and twist are there besides those that
only bend, and errors of the model, converged rods beside the whole muscle in finite elements, are printed and kept too;
the tolerance of a plan is then on the sum of both.

Errors are the same for any number of workers. CPU times, those of the plant's steps alone, are measured after them, in
one process with nothing beside it, until they repeat. If the machine was too busy to be believed, that is said, kept in
the table and told with every plan; the exit status is 1 then.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping
from datetime import date

from mbpam_ros.commands.result_arguments import result_file
from mbpam_ros.commands.workers import add_workers, executor_for
from mbpam_ros.configuration import config_directory
from mbpam_ros.gripper import load_gripper
from mbpam_ros.plant.fidelity import TABLE, FidelityTable, ModelError
from mbpam_ros.study.fidelity import trade
from mbpam_ros.study.fidelity.calibration import SCENES, calibrated
from mbpam_ros.study.fidelity.cases import all_cases
from mbpam_ros.study.fidelity.draws import ranges
from mbpam_ros.study.fidelity.model_error import model_errors, states_file
from mbpam_ros.study.fidelity.picture import draw_trade
from mbpam_ros.study.jobs import ResultFile, runs_beside
from mbpam_ros.study.pictures import PictureError
from mbpam_ros.study.provenance import machine, sources_digest, versions
from mbpam_ros.study.result_file import write_json
from mbpam_ros.terminal import Progress, announce

_S_PER_RUN, _S_PER_SCENE, _S_OF_COSTS = 0.5, 20.0, 300.0
"""CPU, a guess."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument("--json", type=result_file, metavar="FILE", required=True, help="where the rows go")
    parser.add_argument("--quick", action="store_true", help="a subset, in less than a minute")
    parser.add_argument(
        "--strains",
        action=argparse.BooleanOptionalAction,
        help="rods that stretch and twist too, and the errors of the model (default: yes, but not with --quick)",
    )
    parser.add_argument(
        "--scenes", type=int, metavar="N", help=f"drawn to make promises from (default: {SCENES}; none with --quick)"
    )
    parser.add_argument(
        "--table",
        type=result_file,
        metavar="FILE",
        help="planner's table (default: the one it reads; none with --quick)",
    )
    add_workers(parser)


def run(options: argparse.Namespace) -> int:
    """Measure, write rows, table and picture."""
    progress, wanted = Progress(), _wanted(options)
    here, libraries = machine(), versions("numpy", "numba", "scipy")
    settings = {"sources": sources_digest(), "machine": here, "versions": libraries, "coarse": wanted.coarse}
    kept = ResultFile(runs_beside(options.json), settings, "runs", lambda row: row["job"])
    runs, gripper = len(wanted.runs()), load_gripper()
    expected_s = 30.0 if options.quick else _S_PER_RUN * runs + _S_PER_SCENE * wanted.scenes + _S_OF_COSTS
    announce(
        f"{runs} runs, {wanted.scenes} drawn scenes and {len(wanted.cases)} references", expected_s, progress.stream
    )
    with executor_for(options, runs) as executor:
        found = trade.measure(wanted, gripper, kept, executor, progress)
    cost, trust = trade.measured_costs(wanted, gripper, kept, progress)
    progress.say(f"costs: {trust}")
    here = here | {"costs": str(trust), "date": date.today().isoformat()}
    rows, checks = trade.table_rows(wanted, found, cost)
    models = _model_errors(progress) if wanted.has_strains else ()
    whole = FidelityTable(tuple(rows), checks, here, libraries, models)
    if wanted.scenes:
        whole = _with_promises(whole, wanted, found, cost, progress)
    values = [trade.row_values(row) for row in rows]
    write_json(options.json, values)
    table = options.table or (None if options.quick else config_directory() / TABLE)
    if table is not None:
        promises = [trade.row_values(row) for row in whole.promises]
        write_json(table, {**dataclasses.asdict(whole), "rows": values, "promises": promises})
        progress.say(f"table: {table}")
    try:
        picture = options.json.with_suffix(".png")
        draw_trade(rows, checks, models, picture)
        progress.say(f"picture: {picture}")
    except PictureError as error:
        progress.say(str(error))
    return 0 if trust.believed or options.quick else 1


def _with_promises(
    table: FidelityTable, wanted: trade.Trade, rows: Mapping[str, dict], cost: trade.Cost, progress: Progress
) -> FidelityTable:
    draws = trade.drawn(wanted, rows)
    promises, calibration = calibrated(draws, wanted.grid, cost)
    progress.say(
        f"promises: the {100.0 * calibration['level']:.3g} % quantile over {len(draws)} drawn scenes; plans break "
        f"{100.0 * calibration['broken_share']:.2g} % of them"
    )
    return dataclasses.replace(table, promises=promises, ranges=ranges(), calibration=calibration)


def _model_errors(progress: Progress) -> tuple[ModelError, ...]:
    """Return how far the equations are off the finite elements, where these are there to be compared with."""
    states = states_file()
    if states is None:
        progress.say("no states of the whole muscle (mbpam fe states): the errors of the model are not told")
        return ()
    found = model_errors(states, load_gripper().geometry)
    for each in found:
        progress.say(
            f"error of the model, {', '.join(each.strains)}: {each.free_pct:.2g} % at the tip in the air, "
            f"{each.loaded_pct:.2g} % with loads on it"
        )
    return found


def _wanted(options: argparse.Namespace) -> trade.Trade:
    grid = trade.quick_fidelities() if options.quick else trade.fidelities()
    if options.strains or (options.strains is None and not options.quick):
        grid = trade.with_strains(grid)
    default = 0 if options.quick else SCENES
    scenes = default if options.scenes is None else options.scenes
    cases = tuple(case for case in all_cases() if not options.quick or case.name in trade.QUICK_CASES)
    return trade.Trade(cases, grid, coarse=options.quick, scenes=scenes)
