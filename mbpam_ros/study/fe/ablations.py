"""What each choice of the model does to its error at 100 kPa against the paper's Tables 1 and 2.

One thing is changed at a time, mostly on the fast mesh, and three meshes are taken with other wall thicknesses c too,
because the paper does not state c: the trilinear mesh is too stiff, and what it lacks in flexibility a thinner wall
makes up for. Fillets of the chambers' corners take a finer section, which has an effect of its own and so is given
without them too. The weight of the ends needs no finite elements of its own, so each variant is given with three.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.study.fe.design_run import FAST_WALL_MM, MESHES, NO_EQUILIBRIUM, S_PER_JOB, Run, nominal_values, settings
from mbpam_ros.study.fe.material import Silicone
from mbpam_ros.study.fe.mesh import CONVERGED, FAST, CellGeometry, Resolution
from mbpam_ros.study.fe.paper_comparison import PaperPoint
from mbpam_ros.study.fe.posture import SILICONE_DENSITY_KG_M3, weight_n_mm
from mbpam_ros.study.jobs import ResultFile, run_jobs
from mbpam_ros.terminal import Progress

SPREAD_POINTS = ("table_1:1", "table_1:3", "table_1:9", "table_1:14", "table_1:21", "table_2:1")
"""The initial design and five toward the domain's corners: enough to tell variants apart."""

ENDS = ("weightless", "hollow", "solid")

_FINE = Resolution(wave=12, wall=3, arm=4, spoke=6, sector=5)
_FINE_SECTION = Resolution(wave=8, wall=2, arm=2, spoke=6, sector=5)


def variants(template: Run) -> dict[str, Run]:
    """Return the runs to compare by name, all but a and b."""

    def of(
        mesh: Resolution, c_mm: float = FAST_WALL_MM, bulk_mpa: float = 50.0, contact: bool = False, **fillets: float
    ) -> Run:
        geometry = replace(template.geometry, c_mm=c_mm, **fillets)
        silicone = Silicone(bulk_mpa=bulk_mpa)
        return replace(template, geometry=geometry, resolution=mesh, silicone=silicone, self_contact=contact)

    trilinear, quadratic, tetrahedra = FAST, CONVERGED, MESHES["tetrahedra"]
    return {
        "trilinear, c 2.1": of(trilinear),
        "trilinear, c 2.1, K 500 MPa": of(trilinear, bulk_mpa=500.0),
        "trilinear, c 2.1, arms rest on the wall": of(trilinear, contact=True),
        "trilinear, c 2.1, crests and valleys of 0.5 mm": of(trilinear, wave_fillet_mm=0.5),
        "trilinear, c 2.1, crests and valleys of 1.5 mm": of(trilinear, wave_fillet_mm=1.5),
        "trilinear, c 2.1, finer section": of(_FINE_SECTION),
        "trilinear, c 2.1, finer section, corners of 0.5 mm": of(_FINE_SECTION, corner_fillet_mm=0.5),
        "trilinear, c 2.3": of(trilinear, 2.3),
        "20-node, c 2.3": of(quadratic, 2.3),
        "20-node, c 2.1": of(quadratic),
        "trilinear 1.5 times finer, c 2.1": of(_FINE),
        "tetrahedra in groups of 24, c 2.1": of(tetrahedra),
        "tetrahedra in groups of 24, c 2.2": of(tetrahedra, 2.2),
        "tetrahedra, each by itself, c 2.1": of(replace(tetrahedra, tetrahedra="single")),
    }


def end_weight_factors(geometry: CellGeometry) -> tuple[float, ...]:
    """Return the ends' weight per length over the waved part's mean, for each of ``ENDS``.

    ``hollow``: the section of a crest goes on through the ends; ``solid``: silicone all over.
    """
    disc_mm2 = math.pi * geometry.outer_radius_mm**2
    crest_mm2 = disc_mm2 - 4.0 * float(geometry.chamber_area_at(np.zeros(1))[0])
    mean_mm2 = weight_n_mm(geometry) / (SILICONE_DENSITY_KG_M3 * 1e-9 * GRAVITY_M_S2)
    return 0.0, crest_mm2 / mean_mm2, disc_mm2 / mean_mm2


def variant_row(variant: str, run: Run, point: PaperPoint) -> dict[str, object]:
    """Return one variant at one of the paper's designs.

    Raises:
        LoadStepError, LawError, PostureError: no equilibrium was found.
    """
    run = replace(run, geometry=replace(run.geometry, a_mm=point.a_mm, b_mm=point.b_mm))
    values = nominal_values(run, end_weight_factors(run.geometry))
    thetas = values["theta_deg_by_end_weight"]
    return {
        "job": _name(variant, point.source),
        "variant": variant,
        **asdict(point),
        "fe_free_bend_deg": values["free_bend_deg"],
        "fe_force_n": values["force_n"],
        "fe_theta_deg": dict(zip(ENDS, thetas, strict=True)),
        "fold_opening": values["fold_opening"],
        "arm_gap_mm": values["arm_gap_mm"],
    }


def ablations(template: Run, path: Path, executor: Executor, progress: Progress, points: Sequence[PaperPoint]) -> dict:
    """Run all variants at ``points`` and return their errors.

    ``path`` is kept up to date; what it holds from the same settings is not run again.

    Raises:
        ResultFileError: ``path`` is no file of this command.
    """
    runs = variants(template)
    wanted = {"template": settings(template), "variants": {name: asdict(run) for name, run in runs.items()}}
    results = ResultFile(path, wanted, "runs", lambda row: row["job"])
    jobs = {_name(name, point.source): (name, run, point) for name, run in runs.items() for point in points}
    failures = run_jobs(
        jobs, variant_row, results, executor, progress, _row_text, failing=NO_EQUILIBRIUM, s_per_job=S_PER_JOB
    )
    rows = [results.rows[job] for job in jobs if job in results.rows]
    summary = []
    for name in runs:
        members = [row for row in rows if row["variant"] == name]
        if members:
            summary += [variant_errors(f"{name}, {ends} ends", members, ends) for ends in ENDS]
    sources = [point.source for point in points]
    return results.write(list(jobs), points=sources, variants=summary, failures=failures)


def variant_errors(name: str, rows: Sequence[dict], ends: str) -> dict[str, object]:
    """Return rms, mean and worst relative errors [%] of bend and force of the rows of one variant.

    With them, the least clearance (:class:`~mbpam_ros.study.fe.self_contact.Clearance`) of any row.
    """
    errors: dict[str, object] = {"name": name, "points": len(rows)}
    for clearance in ("fold_opening", "arm_gap_mm"):
        errors[f"least_{clearance}"] = min(row[clearance] for row in rows)
    theta = np.array([row["fe_theta_deg"][ends] / row["theta_deg"] for row in rows])
    force = np.array([row["fe_force_n"] / row["force_n"] for row in rows])
    for quantity, ratio in (("theta", theta), ("force", force)):
        percent = 100.0 * (ratio - 1.0)
        errors[f"{quantity}_rms_pct"] = float(np.sqrt(np.mean(percent**2)))
        errors[f"{quantity}_mean_pct"] = float(percent.mean())
        errors[f"{quantity}_worst_pct"] = float(percent[np.abs(percent).argmax()])
    return errors


def _name(variant: str, source: str) -> str:
    return f"{variant} | {source}"


def _row_text(row: dict) -> str:
    error = 100.0 * (row["fe_theta_deg"]["weightless"] / row["theta_deg"] - 1.0)
    return f"{row['job']}: theta {row['fe_theta_deg']['weightless']:.1f} deg ({error:+.1f} %), weightless ends"
