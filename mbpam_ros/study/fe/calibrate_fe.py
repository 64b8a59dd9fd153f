"""Command ``python -m mbpam_ros.study.fe.calibrate_fe``: the finite element muscle beside the paper's.

    calibrate_fe --json FILE                                  the paper's 32 designs (Tables 1, 2, 5) and PSC
    calibrate_fe --design A,B,C,N --pattern psc --json FILE   one design: bend against pressure
    calibrate_fe --law FILE                                   M(p, kappa), V(p, kappa), stretch of the initial design

Angles are those of the paper's posture (base down, tip up, weight on; :mod:`~mbpam_ros.study.fe.posture`). The blocked
force is that of the straight propped rod, F = M0 int(x) / int(x^2), with the moment M0 that holds the cell straight.

The reading (c, n, active length, weightless ends; not stated by the paper) was chosen on Tables 1 and 2, so the errors
there are those of a fit; Table 5 was kept apart.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from mbpam_ros.actuator.design import MuscleGeometry
from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.actuator.planar_rod import blocked_tip_force_per_moment
from mbpam_ros.actuator.tables import read_table
from mbpam_ros.study.fe.law import BendingLaw, LawError
from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import PATTERNS, CellGeometry, Resolution
from mbpam_ros.study.fe.posture import (
    END_LENGTH_MM,
    END_WEIGHT_FACTOR,
    PostureError,
    upright_tip_angle_rad,
    weight_n_mm,
)
from mbpam_ros.study.fe.solve import LoadStepError
from mbpam_ros.study.fe.unit_cell import UnitCell

NOMINAL_KPA = 100.0
NOT_MODELLED = ("self-contact", "viscosity", "end caps", "sliding contact of the blocked tip")
MEASURED_PSC_DEG, MEASURED_PSC_N = 120.0, 0.466  # paper, section 3.1

_TABLES = {"table_1": "doe_training.csv", "table_2": "doe_validation.csv", "table_5": "pareto_checks.csv"}
_COLUMNS = {"table_5": ("no", "a_mm", "b_mm", "theta_fe_deg", "f_fe_n")}
_LAW_BENDS_DEG = tuple(range(-60, 181, 30))
_LAW_PRESSURES_KPA = tuple(range(0, 121, 10))


class CalibrationError(RuntimeError):
    """The command cannot do what was asked; the message says why."""


@dataclass(frozen=True)
class PaperPoint:
    """A design with the paper's values at 100 kPa: finite elements, but for the measured ``psc``."""

    source: str
    a_mm: float
    b_mm: float
    theta_deg: float
    force_n: float
    pattern: str = "pdc"


@dataclass(frozen=True)
class Run:
    """One finite element job; a plain value, so that any executor can send it anywhere."""

    geometry: CellGeometry
    pattern: str
    resolution: Resolution = field(default_factory=Resolution)
    silicone: Silicone = field(default_factory=Silicone)
    end_length_mm: float = END_LENGTH_MM
    end_weight_factor: float = END_WEIGHT_FACTOR

    def cell(self) -> UnitCell:
        """Return the unit cell of this job."""
        return UnitCell(self.geometry, self.pattern, self.resolution, self.silicone)

    def upright_tip_angle_rad(self, law: BendingLaw) -> float:
        """Return the tip angle in the paper's posture with the law of one pressure.

        Raises:
            LoadStepError, LawError, PostureError: no equilibrium was found.
        """
        return upright_tip_angle_rad(law, self.geometry, self.end_length_mm, self.end_weight_factor)


def paper_points() -> list[PaperPoint]:
    """Return the paper's 32 finite element designs, then the measured initial design under PSC.

    Raises:
        ConfigError: a table is missing or unreadable.
    """
    points = []
    for name, file in _TABLES.items():
        columns = _COLUMNS.get(name, ("no", "a_mm", "b_mm", "theta_max_deg", "f_max_n"))
        for no, a_mm, b_mm, theta_deg, force_n in read_table(file, *columns).T.tolist():
            points.append(PaperPoint(f"{name}:{no:.0f}", a_mm, b_mm, theta_deg, force_n))
    return [*points, PaperPoint("measured:psc", 2.5, 2.0, MEASURED_PSC_DEG, MEASURED_PSC_N, "psc")]


def nominal_values(run: Run) -> dict[str, object]:
    """Return what one design does at 100 kPa: bend [deg] without and with weight, held-straight moment, blocked force.

    The law's samples come with it, so that other postures and weights need no finite elements.

    Raises:
        LoadStepError, LawError, PostureError: the finite elements or the rod found no equilibrium.
    """
    cell = run.cell()
    pressure_mpa = 1e-3 * NOMINAL_KPA
    free = cell.free_bend(pressure_mpa)
    law = BendingLaw(cell, [free])
    upright_rad = run.upright_tip_angle_rad(law)
    straight = cell.held_bend(pressure_mpa, 0.0)
    moment_n_mm = -straight.moment_n_mm
    length_m, end_m = 1e-3 * run.geometry.active_length_mm, 1e-3 * run.end_length_mm
    rod = MuscleGeometry(
        1e-3 * run.geometry.outer_radius_mm, end_m, length_m, 1e3 * weight_n_mm(run.geometry) / GRAVITY_M_S2
    )
    return {
        "free_bend_deg": math.degrees(free.angle_rad) * cell.angle_per_muscle,
        "theta_deg": math.degrees(upright_rad),
        "straight_moment_n_mm": moment_n_mm,
        "force_n": 1e-3 * moment_n_mm * blocked_tip_force_per_moment(rod),
        "bend_samples_deg": np.degrees(law.bend_rad).tolist(),
        "moment_samples_n_mm": law.moment_n_mm.tolist(),
        "axis_stretch_samples": law.axis_stretch.tolist(),
    }


def bend_curve(run: Run, pressures_kpa: Sequence[float]) -> dict[str, list[float]]:
    """Return ``p_kpa`` and ``theta_deg`` in the paper's posture, pressures rising.

    Raises:
        LoadStepError, LawError, PostureError: as in :func:`nominal_values`.
    """
    cell = run.cell()
    state, angles = cell.rest(), []
    for pressure_kpa in pressures_kpa:
        state = cell.free_bend(1e-3 * pressure_kpa, state)
        law = BendingLaw(cell, [state])
        angles.append(math.degrees(run.upright_tip_angle_rad(law)))
    return {"p_kpa": [float(value) for value in pressures_kpa], "theta_deg": angles}


def law_at_pressure(run: Run, pressure_kpa: float, bends_deg: Sequence[float]) -> dict[str, object]:
    """Return moment, stretch and gas volume of the active length at one pressure, held at each bend.

    Bends that have no equilibrium are left out, with the reason under ``missing``.
    """
    cell = run.cell()
    law = BendingLaw(cell, [cell.held_bend(1e-3 * pressure_kpa, 0.0)])
    missing = []
    for bends in ([bend for bend in bends_deg if bend > 0], [bend for bend in reversed(bends_deg) if bend < 0]):
        for bend in bends:
            try:
                law.add(math.radians(bend))
            except LoadStepError as error:
                missing.append({"bend_deg": bend, "reason": str(error)})
                break
    moment, bend = law.moment_n_mm, law.bend_rad
    slope, offset = np.polyfit(bend, moment, 1) if bend.size > 1 else (math.nan, moment[0])
    straight = float(np.interp(0.0, bend, moment))
    return {
        "pattern": run.pattern,
        "p_kpa": float(pressure_kpa),
        "bend_deg": np.degrees(bend).round(9).tolist(),
        "moment_n_mm": moment.tolist(),
        "axis_stretch": law.axis_stretch.tolist(),
        "gas_volume_mm3": law.gas_volume_mm3.tolist(),
        "straight_moment_n_mm": -straight,
        "line_stiffness_n_mm2": float(slope) * run.geometry.active_length_mm,
        "line_moment_n_mm": -float(offset),
        "line_rms_n_mm": float(np.sqrt(np.mean((slope * bend + offset - moment) ** 2))),
        "missing": missing,
    }


def settings(run: Run) -> dict[str, object]:
    """Return what the numbers depend on besides a and b, and the versions they were made with."""
    geometry = asdict(run.geometry)
    del geometry["a_mm"], geometry["b_mm"]
    versions = {name: _version(name) for name in ("felupe", "numpy", "scipy", "pypardiso")}
    return {
        "convention": "outer radius R - a/2 (1 - cos(2 pi z / lambda)); radial wall c; chambers x, y > b/2",
        "geometry": {**geometry, "end_length_mm": run.end_length_mm, "end_weight_factor": run.end_weight_factor},
        "resolution": asdict(run.resolution),
        "silicone": asdict(run.silicone),
        "not_modelled": list(NOT_MODELLED),
        "versions": versions,
    }


def error_summary(rows: Iterable[dict]) -> dict[str, dict[str, float]]:
    """Return rms and worst relative errors [%] of theta and force, for the fit (Tables 1, 2), Table 5 and PSC."""
    groups: dict[str, list[dict]] = {}
    for row in rows:
        table = row["source"].split(":")[0]
        groups.setdefault("tables_1_2" if table in ("table_1", "table_2") else table, []).append(row)
    summary = {}
    for name, members in groups.items():
        summary[name] = {"points": len(members)}
        for key in ("theta", "force"):
            errors = np.array([member[f"{key}_error_pct"] for member in members])
            summary[name][f"{key}_rms_pct"] = float(np.sqrt(np.mean(errors**2)))
            summary[name][f"{key}_mean_pct"] = float(errors.mean())
            summary[name][f"{key}_worst_pct"] = float(errors[np.abs(errors).argmax()])
    return summary


def compare_with_paper(
    template: Run, path: Path, executor: Executor, report: Callable[[str], None], points: Sequence[PaperPoint]
) -> dict:
    """Run all points and keep ``path`` up to date; points that it holds from the same settings are not run again.

    Args:
        template: all but a, b and the pattern.
        executor: any executor of ``concurrent.futures``' kind whose futures ``as_completed`` understands.
        report: told one line per finished point.

    Raises:
        CalibrationError: ``path`` is no file of this command.
    """
    wanted = settings(template)
    rows = {row["source"]: row for row in _finished(path, wanted, "points")}
    futures = {}
    for point in points:
        if point.source not in rows:
            geometry = replace(template.geometry, a_mm=point.a_mm, b_mm=point.b_mm)
            run = replace(template, geometry=geometry, pattern=point.pattern)
            futures[executor.submit(nominal_values, run)] = point
    failures = {}
    for future in as_completed(futures):
        point = futures[future]
        try:
            values = future.result()
        except (LoadStepError, LawError, PostureError) as error:
            failures[point.source] = str(error)
            report(f"{point.source}: {error}")
            continue
        rows[point.source] = {
            **asdict(point),
            **{f"fe_{key}": value for key, value in values.items()},
            "theta_error_pct": 100.0 * (values["theta_deg"] / point.theta_deg - 1.0),
            "force_error_pct": 100.0 * (values["force_n"] / point.force_n - 1.0),
        }
        report(_row_text(rows[point.source], f"{len(rows)}/{len(points)}"))
        _write(path, {"settings": wanted, "points": list(rows.values())})
    ordered = [rows[point.source] for point in points if point.source in rows]
    result = {"settings": wanted, "errors": error_summary(ordered), "failures": failures, "points": ordered}
    _write(path, result)
    return result


def rod_law(run: Run, path: Path, executor: Executor, report: Callable[[str], None]) -> dict:
    """Return M, V and stretch over pressure and bend for PDC and PSC, with the straight line through each.

    ``path`` is kept up to date; pressures that it holds from the same settings are not run again.

    Raises:
        CalibrationError: ``path`` is no law of this command.
    """
    wanted = {**settings(run), "design": {"a_mm": run.geometry.a_mm, "b_mm": run.geometry.b_mm}}
    tables = {(row["pattern"], row["p_kpa"]): row for row in _finished(path, wanted, "tables")}
    cases = [(pattern, float(pressure)) for pattern in PATTERNS for pressure in _LAW_PRESSURES_KPA]
    futures, failures = {}, []
    for pattern, pressure in cases:
        if (pattern, pressure) not in tables:
            job = replace(run, pattern=pattern)
            futures[executor.submit(law_at_pressure, job, pressure, _LAW_BENDS_DEG)] = (pattern, pressure)
    for future in as_completed(futures):
        pattern, pressure = futures[future]
        try:
            tables[pattern, pressure] = future.result()
        except (LoadStepError, LawError) as error:
            failures.append({"pattern": pattern, "p_kpa": pressure, "reason": str(error)})
            report(f"{pattern} {pressure:g} kPa: {error}")
            continue
        _write(path, {"settings": wanted, "tables": [tables[case] for case in cases if case in tables]})
        report(f"[{len(tables)}/{len(cases)}] {pattern} {pressure:g} kPa")
    result = {
        "settings": wanted,
        "tables": [tables[case] for case in cases if case in tables],
        "failures": failures,
    }
    _write(path, result)
    return result


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return its exit status."""
    options = _parser().parse_args(arguments)
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # the jobs share the cores among themselves
    os.environ.setdefault("MKL_NUM_THREADS", "1")
    try:
        template = _template(options)
        if options.json is None and options.law is None:
            raise CalibrationError("nothing to write: give --json FILE or --law FILE")
        with ProcessPoolExecutor(options.workers) as executor:
            if options.law is not None:
                rod_law(template, options.law, executor, _say)
            if options.json is not None and options.design is not None:
                pressures = np.linspace(0.0, NOMINAL_KPA, 11)
                _write(options.json, executor.submit(bend_curve, template, pressures.tolist()).result())
            elif options.json is not None:
                result = compare_with_paper(template, options.json, executor, _say, paper_points())
                _say(json.dumps(result["errors"], indent=1))
                return 1 if result["failures"] else 0
    except (CalibrationError, LoadStepError, LawError, PostureError, ValueError) as error:
        print(f"calibrate_fe: {error}", file=sys.stderr)
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("calibrate_fe", description=__doc__.split("\n\n")[0])
    default = CellGeometry()
    parser.add_argument("--json", type=Path, metavar="FILE", help="where the comparison or the curve goes")
    parser.add_argument("--law", type=Path, metavar="FILE", help="where the law M(p, kappa) goes")
    parser.add_argument("--design", metavar="A,B,C,N", help="one design: lengths a, b, c in mm, number of waves")
    parser.add_argument("--pattern", choices=PATTERNS, default="pdc", help="of --design")
    parser.add_argument("--wall", type=float, default=default.c_mm, metavar="C", help="wall c of the 32 designs [mm]")
    parser.add_argument("--waves", type=float, default=default.wave_count, metavar="N", help="waves of the 32 designs")
    parser.add_argument("--active-length", type=float, default=default.active_length_mm, metavar="MM")
    parser.add_argument("--end-length", type=float, default=END_LENGTH_MM, metavar="MM")
    parser.add_argument(
        "--end-weight", type=float, default=END_WEIGHT_FACTOR, metavar="F", help="of the ends, per length, over waves'"
    )
    parser.add_argument("--quadratic", action="store_true", help="20-node elements, reduced integration")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes (default: one a core)")
    return parser


def _template(options: argparse.Namespace) -> Run:
    a_mm, b_mm, c_mm, waves = CellGeometry().a_mm, CellGeometry().b_mm, options.wall, options.waves
    if options.design is not None:
        try:
            a_mm, b_mm, c_mm, waves = (float(part) for part in options.design.split(","))
        except ValueError as error:
            raise CalibrationError(f"--design wants four numbers A,B,C,N, found {options.design!r}") from error
    resolution = QUADRATIC if options.quadratic else Resolution()
    geometry = CellGeometry(a_mm, b_mm, c_mm, waves, options.active_length)
    ends = {"end_length_mm": options.end_length, "end_weight_factor": options.end_weight}
    return Run(geometry, options.pattern, resolution, **ends)


QUADRATIC = Resolution(wave=6, wall=1, arm=2, spoke=2, sector=2, quadratic=True)
"""A mesh of 20-node elements, converged to about 0.5 % of the free bend at 100 kPa."""


def _finished(path: Path, wanted: dict, key: str) -> list[dict]:
    """What an earlier, perhaps interrupted command with the same settings left in ``path``."""
    if not path.exists():
        return []
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return found[key] if found["settings"] == wanted else []
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise CalibrationError(f"{path} exists and is no such result of this command; give another file") from error


def _row_text(row: dict, count: str) -> str:
    return (
        f"[{count}] {row['source']:>13} {row['pattern']} a {row['a_mm']:.2f} b {row['b_mm']:.2f}: "
        f"theta {row['fe_theta_deg']:6.1f} deg ({row['theta_error_pct']:+5.1f} %), "
        f"force {row['fe_force_n']:.3f} N ({row['force_error_pct']:+5.1f} %)"
    )


def _write(path: Path, content: dict) -> None:
    """Write JSON so that an interrupt leaves the old file or the new one."""
    beside = path.with_name(path.name + ".part")
    beside.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    beside.replace(path)


def _version(name: str) -> str | None:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def _say(text: str) -> None:
    print(text, flush=True)


if __name__ == "__main__":
    raise SystemExit(main())
