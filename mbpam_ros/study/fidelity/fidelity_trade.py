"""Command ``fidelity_trade``: what accuracy costs, measured.

    fidelity_trade --json FILE            every case at every tier, number of modes, step and pneumatic model
    fidelity_trade --json FILE --quick    two cases, a few fidelities, a coarser reference; less than a minute

FILE becomes the list of rows (:class:`~mbpam_ros.plant.fidelity.Measured`), FILE.png the Pareto plot. A whole run also
renews the table that the planner reads (``--table``). Errors are against a rod of six modes at 0.1 ms with ISO 6358
pneumatics at 0.5 ms. How far that is from one mode less at twice the steps, and at rest in the air from SciPy's
solution of the boundary-value problem, is printed and kept in the table.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import platform
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from mbpam_ros.configuration import ConfigError, config_directory
from mbpam_ros.gripper import Gripper, load_gripper
from mbpam_ros.plant.fidelity import TABLE, FidelityTable, Measured
from mbpam_ros.study.announcement import announce
from mbpam_ros.study.fidelity.boundary_value import BoundaryValueError, boundary_value_error_pct
from mbpam_ros.study.fidelity.cases import Case, all_cases
from mbpam_ros.study.fidelity.errors import errors
from mbpam_ros.study.fidelity.picture import PictureError, draw_trade
from mbpam_ros.study.fidelity.runs import Record, run_coarser_reference, run_reference
from mbpam_ros.study.fidelity.trade import QUICK_CASES, can_run, fidelities, measure, quick_fidelities
from mbpam_ros.study.progress_bar import ProgressBar
from mbpam_ros.study.result_file import ResultFileError, write_json

_ROUNDS = 3
_S_PER_RUN = 0.3


def reference_check(case: Case, reference: Record, gripper: Gripper) -> dict[str, float]:
    """Return how far the reference of a case is converged, and how far it is off the boundary-value problem [%].

    Raises:
        BoundaryValueError: that problem was not solved.
    """
    off = errors(case, run_coarser_reference(case, gripper), reference, gripper.geometry.active_length_m)
    check = {"static_pct": off.static_pct, "transient_pct": off.transient_pct}
    if off.contact_force_pct is not None:
        check["contact_force_pct"] = off.contact_force_pct
    else:
        check["boundary_value_pct"] = boundary_value_error_pct(case, reference, gripper)
    return check


def row_values(row: Measured) -> dict[str, str | float]:
    """Return a row as JSON has it: to four figures, and without a contact force where nothing touches."""
    return {
        name: float(f"{value:.4g}") if isinstance(value, float) else value
        for name, value in dataclasses.asdict(row).items()
        if value is not None
    }


def machine() -> dict[str, str]:
    """Return what the CPU times depend on besides the code."""
    return {"processor": _processor(), "cores": str(os.cpu_count()), "system": platform.system()}


def versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries in the loop."""
    return {"python": platform.python_version(), **{name: version(name) for name in ("numpy", "numba", "scipy")}}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    options = _parser().parse_args(arguments)
    try:
        return _trade(options)
    except KeyboardInterrupt:
        print("fidelity_trade: interrupted; nothing was written", file=sys.stderr)
        return 130
    except (ConfigError, BoundaryValueError, ResultFileError) as error:
        print(f"fidelity_trade: {error}", file=sys.stderr)
        return 1


def _trade(options: argparse.Namespace) -> int:
    gripper, progress, quick = load_gripper(), ProgressBar(), options.quick
    cases = [case for case in all_cases() if not quick or case.name in QUICK_CASES]
    grids = [
        [fidelity for fidelity in (quick_fidelities() if quick else fidelities()) if can_run(case, fidelity)]
        for case in cases
    ]
    repeats = 1 if quick else options.rounds
    runs = repeats * sum(map(len, grids))
    announce(f"{runs} runs and {len(cases)} references", 30.0 if quick else 120.0 + _S_PER_RUN * runs, sys.stdout)
    progress.start(runs, 0)
    rows, checks = [], {}
    for case, grid in zip(cases, grids, strict=True):
        progress.say(f"{case.name}: reference")
        if quick:
            reference = run_coarser_reference(case, gripper)
        else:
            reference = run_reference(case, gripper)
            checks[case.name] = reference_check(case, reference, gripper)
            progress.say(
                f"{case.name}: reference converged to "
                + ", ".join(f"{name.removesuffix('_pct')} {value:.2g} %" for name, value in checks[case.name].items())
            )
        rows += measure(case, grid, reference, gripper, repeats, progress.job_ended)
    values = [row_values(row) for row in rows]
    write_json(options.json, values)
    table = options.table or (None if quick else config_directory() / TABLE)
    if table is not None:
        whole = FidelityTable(tuple(rows), checks, machine(), versions())
        write_json(table, {**dataclasses.asdict(whole), "rows": values})
        progress.say(f"table: {table}")
    try:
        picture = options.json.with_suffix(".png")
        draw_trade(rows, checks, picture)
        progress.say(f"picture: {picture}")
    except PictureError as error:
        progress.say(str(error))
    return 0


def _processor() -> str:
    """Return the processor's name, where the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "fidelity_trade", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, metavar="FILE", required=True, help="where the rows go")
    parser.add_argument("--quick", action="store_true", help="a subset, in less than a minute")
    parser.add_argument("--rounds", type=int, default=_ROUNDS, help="through the grid; CPU times are their medians")
    parser.add_argument(
        "--table", type=Path, metavar="FILE", help="planner's table (default: the one it reads; none with --quick)"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
