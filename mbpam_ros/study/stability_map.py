"""Where the plant's steps are stable, over step size, contact stiffness and tier.

In each cell the four muscles close on a sphere (60 mm, 46 g) that stands between them: the air rises to 80 kPa in 0.3 s
and stays for 0.5 s (free 2 s), or five steps where that is longer. The stiffness is that of muscles on the object and
on each other; the column ``free`` has no object, and fingers that pass through each other. An object at rest is held
only where it belongs: within 1 mm of where steps of 0.5 ms leave it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbpam_ros.actuator.chambers import pressurised_chambers
from mbpam_ros.actuator.equilibrium import GRAVITY_M_S2
from mbpam_ros.configuration import load_config
from mbpam_ros.gripper import Gripper, load_gripper
from mbpam_ros.plant.fidelity import Fidelity
from mbpam_ros.plant.planner import CONTACT_MODES, FREE_MODES
from mbpam_ros.plant.tiers.base import (
    Actuation,
    PlantConfig,
    PlantDivergedError,
    RigidBody,
    Tier,
    TierError,
    TierSetup,
    TierState,
)
from mbpam_ros.plant.tiers.registry import build_tier
from mbpam_ros.study.provenance import sources_digest, versions

TIERS = ("static", "arc", "rod")
STEPS_S = (1e-5, 1e-4, 1e-3, 2e-3, 5e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0)
STIFFNESSES_N_M = (1e2, 1e3, 2e3, 1e4, 1e5, 1e6, 1e7, 1e8)
QUICK_STEPS_S = (1e-3, 1e-2, 0.1, 1.0)
QUICK_STIFFNESSES_N_M = (2e3, 1e5, 1e8)

PRESSURE_GAUGE_PA = 80e3
CLOSING_S, HOLDING_S, FREE_HOLDING_S, FEWEST_STEPS = 0.3, 0.5, 2.0, 5
AT_REST_M_S = 1e-3
"""Speed of the object, and of the free tips, below which a cell is at rest."""

REFERENCE_STEP_S, PLACE_M = 5e-4, 1e-3
"""Step of the run that says where the object belongs, and how far off it may be."""

S_PER_CELL = 0.7
"""CPU of a cell of the whole map, whose shortest steps cost most."""

_SIZE_M, _MASS_KG, _DEPTH_M = 0.060, 0.046, 0.085
_STAND_M = np.array([[_DEPTH_M + 0.5 * _SIZE_M, 0.01, 0.01], [0.315, np.inf, np.inf]])


@dataclass(frozen=True)
class Cell:
    """One cell of the map.

    Args:
        tier: how the muscles are computed.
        step_s: length of a step.
        stiffness_n_m: of the contacts of muscles; none in the column ``free``.
        outcome: ``at_rest``, ``astray`` (at rest, but not where it belongs), ``moving``, ``stopped`` (a typed error) or
            ``fault``.
        force_error_pct: what is left of the forces on the object over its weight; none unless held at rest.
        message: of the error; empty without one.
        off_mm: distance of an object at rest from where it belongs; none without one.
    """

    tier: str
    step_s: float
    stiffness_n_m: float | None
    outcome: str
    force_error_pct: float | None
    message: str
    off_mm: float | None = None


def run_cell(tier: str, step_s: float, stiffness_n_m: float | None, gripper: Gripper, config: PlantConfig) -> Cell:
    """Close the muscles in one cell and say what came of it."""
    if stiffness_n_m is not None:
        config = dataclasses.replace(
            config,
            finger_object=dataclasses.replace(config.finger_object, stiffness_n_m=stiffness_n_m),
            finger_finger=dataclasses.replace(config.finger_finger, stiffness_n_m=stiffness_n_m),
        )
    state: TierState | None = None
    outcome, message, error_pct, off_mm = "", "", None, None
    try:
        state = _ended(tier, step_s, stiffness_n_m, gripper, config)
        outcome = _outcome(state, gripper)
        if state.body is not None and outcome == "at_rest":
            reference = _ended(tier, REFERENCE_STEP_S, stiffness_n_m, gripper, config).body
            off_mm = 1e3 * float(np.linalg.norm(state.body.position_m - reference.position_m)) if reference else None
            outcome = "at_rest" if off_mm is not None and off_mm < 1e3 * PLACE_M else "astray"
            error_pct = _force_error_pct(state)
    except (PlantDivergedError, TierError) as error:
        outcome, message = "stopped", str(error)
    except Exception as error:  # any other kind is what this command looks for
        outcome, message = "fault", f"{type(error).__name__}: {error}"
    return Cell(tier, step_s, stiffness_n_m, outcome, error_pct, message, off_mm)


def _ended(tier: str, step_s: float, stiffness_n_m: float | None, gripper: Gripper, config: PlantConfig) -> TierState:
    """Return the state when the time of a cell is over."""
    modes = 1 if tier != "rod" else FREE_MODES if stiffness_n_m is None else CONTACT_MODES
    muscles = build_tier(_setup(stiffness_n_m is not None, gripper, config), Fidelity(tier, modes, step_s))
    _close(muscles, step_s, FREE_HOLDING_S if stiffness_n_m is None else HOLDING_S, gripper)
    return muscles.state()


def cell_jobs(
    steps_s: Sequence[float], stiffnesses_n_m: Sequence[float]
) -> dict[str, tuple[str, float, float | None, Gripper, PlantConfig]]:
    """Return what :func:`run_cell` is given for the cells of all tiers by name, row by row.

    The tier ``static`` has the column ``free`` only.

    Raises:
        ConfigError: the gripper's or the plant's file is wrong.
    """
    gripper, config = load_gripper(), load_config(PlantConfig, "plant.yaml")
    return {
        _name(tier, step_s, stiffness): (tier, step_s, stiffness, gripper, config)
        for tier in TIERS
        for step_s in steps_s
        for stiffness in (None, *(() if tier == "static" else stiffnesses_n_m))
    }


def cell_row(tier: str, step_s: float, stiffness_n_m: float | None, gripper: Gripper, config: PlantConfig) -> dict:
    """Return :func:`run_cell` as plain values."""
    return dataclasses.asdict(run_cell(tier, step_s, stiffness_n_m, gripper, config))


def row_name(row: dict) -> str:
    """Return the name of the job that made a row, as in :func:`cell_jobs`."""
    return _name(row["tier"], row["step_s"], row["stiffness_n_m"])


def settings() -> dict[str, object]:
    """Return what all rows depend on."""
    return {"sources": sources_digest(), "versions": versions("numpy", "numba", "scipy")}


def map_text(cells: Sequence[Cell]) -> str:
    """Return the map as text, the messages of typed errors below it."""
    messages = list(dict.fromkeys(_without_step(cell.message) for cell in cells if cell.message))
    lines = []
    for tier in dict.fromkeys(cell.tier for cell in cells):
        own = [cell for cell in cells if cell.tier == tier]
        columns = list(dict.fromkeys(cell.stiffness_n_m for cell in own))
        lines += [f"tier {tier}", f"{'N/m':>10}" + "".join(f"{_column(column):>9}" for column in columns)]
        for step_s in dict.fromkeys(cell.step_s for cell in own):
            row = {cell.stiffness_n_m: cell for cell in own if cell.step_s == step_s}
            lines.append(f"{1e3 * step_s:>7g} ms" + "".join(f"{_text(row[c], messages):>9}" for c in columns))
        lines.append("")
    lines += [f"{number}: {message}" for number, message in enumerate(messages, 1)]
    return "\n".join(lines).rstrip() + "\n"


def _setup(with_object: bool, gripper: Gripper, config: PlantConfig) -> TierSetup:
    body = RigidBody("sphere", (_SIZE_M,) * 3, _MASS_KG, np.array([0.0, 0.0, _DEPTH_M]), np.array([0.0, 0.0, 0.0, 1.0]))
    return TierSetup(
        geometry=gripper.rod_geometry,
        finger_base_m=gripper.finger_base_m,
        gravity_m_s2=GRAVITY_M_S2,
        body=body if with_object else None,
        planes_m=_STAND_M if with_object else np.empty((0, 3)),
        config=config,
        fingers_touch=with_object,
    )


def _close(muscles: Tier, step_s: float, holding_s: float, gripper: Gripper) -> None:
    none, full = (_inward(share * PRESSURE_GAUGE_PA, gripper) for share in (0.0, 1.0))
    muscles.reset(none)
    for duration_s, fewest in ((CLOSING_S, 1), (holding_s, FEWEST_STEPS)):
        still = np.zeros(max(round(duration_s / step_s), fewest) + 1)
        muscles.step(full, still, still)


def _inward(pressure_gauge_pa: float, gripper: Gripper) -> Actuation:
    law = gripper.rod_law()
    inward = np.arctan2(-gripper.finger_base_m[:, 1], -gripper.finger_base_m[:, 0])
    chambers = np.array([pressurised_chambers(azimuth) for azimuth in inward], dtype=float)
    return Actuation(*law.moment_and_stiffness(pressure_gauge_pa * chambers))


def _outcome(state: TierState, gripper: Gripper) -> str:
    tip_m_s = gripper.geometry.length_m * np.abs(state.bend_rate_rad_s).max()
    numbers = [state.bend_rad, state.centreline_m, state.finger_force_n, state.between_fingers_force_n, tip_m_s]
    speed = tip_m_s
    if state.body is not None:
        speed = np.linalg.norm(state.body.velocity_m_s)
        numbers += [state.body.position_m, state.body.orientation_xyzw, speed, state.support_force_n]
    if not all(np.isfinite(number).all() for number in numbers):
        return "fault"
    return "at_rest" if speed < AT_REST_M_S else "moving"


def _force_error_pct(state: TierState) -> float:
    weight_n = _MASS_KG * GRAVITY_M_S2
    total = state.finger_force_n.sum(axis=0) + state.support_force_n + state.palm_force_n
    return 100.0 * float(np.linalg.norm(total + [0.0, 0.0, weight_n])) / weight_n


def _name(tier: str, step_s: float, stiffness_n_m: float | None) -> str:
    return f"tier {tier}, {1e3 * step_s:g} ms, {_column(stiffness_n_m)} N/m"


def _column(stiffness_n_m: float | None) -> str:
    return "free" if stiffness_n_m is None else f"{stiffness_n_m:.0e}"


def _text(cell: Cell, messages: Sequence[str]) -> str:
    if cell.message:
        return f"{'FAULT' if cell.outcome == 'fault' else 'stop'} {messages.index(_without_step(cell.message)) + 1}"
    if cell.outcome == "astray":
        return f"{cell.off_mm:.0f} mm off"
    if cell.outcome != "at_rest":
        return "FAULT" if cell.outcome == "fault" else cell.outcome
    return "at rest" if cell.force_error_pct is None else f"{cell.force_error_pct:.1f}"


def _without_step(message: str) -> str:
    """Return the message without its step and tier, which the map shows."""
    return message.split(" s: ", 1)[-1]
