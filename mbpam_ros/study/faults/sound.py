"""A sound machine in use for long: whatever is found of it is a false alarm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mbpam_ros.actuator.chambers import CHANNEL_COUNT
from mbpam_ros.grasp.arbitration import Phase
from mbpam_ros.grasp.modes import MODE_NAMES
from mbpam_ros.plant.scene import load_scene
from mbpam_ros.plant.tiers.base import PlantDivergedError
from mbpam_ros.pneumatics.machine_faults import MachineFault
from mbpam_ros.pneumatics.registry import pneumatic_model_names
from mbpam_ros.simulation import TICK_S, Simulation
from mbpam_ros.study.faults.draws import SCENES, SEED

SPAN_S = 120.0
"""Simulated time of one job."""

LEAK_TIME_CONSTANT_S = 100e3 / 150.0
"""Of every chamber: 150 Pa/s at 100 kPa, a leak within the data sheet."""

S_PER_SPAN = 12.0


def sound_jobs(
    hours: float, tiers: tuple[str, ...], model: str | None = None, seed: int = SEED
) -> dict[str, tuple[str, str, int, str | None, int]]:
    """Return what :func:`sound_row` is given for each span, by name; together they make so many hours."""
    spans = max(1, round(3600.0 * hours / SPAN_S))
    return {
        name: (name, tiers[number % len(tiers)], number, model, seed)
        for number in range(spans)
        for name in (f"sound, {tiers[number % len(tiers)]}, {number}{'' if model is None else f', {model}'}",)
    }


def sound_row(
    name: str, tier: str, number: int, model: str | None = None, seed: int = SEED, span_s: float = SPAN_S
) -> dict:
    """Grasp, lift, hold, lower and release at random for a while; return what was found though nothing was wrong.

    The pneumatic model is drawn where none is given.

    A plant that cannot go on (an object that fell is pressed through its stand by the lowered hand) is started anew.
    """
    random = np.random.default_rng([seed, number])
    scene_name, drawn = str(random.choice(SCENES)), str(random.choice(pneumatic_model_names()))
    model = model or drawn
    simulation = _sound_machine(scene_name, model, tier, number)
    found: list[str] = []
    ended: list[str] = []
    before_s = 0.0
    grasps = faults = 0
    while before_s + simulation.seen.time_s < span_s:
        try:
            _idle(simulation, random, found)
            asked = None if random.random() < 0.5 else str(random.choice(MODE_NAMES))
            grasps += simulation.grasp(asked).accepted
            _use(simulation, random, found)
            faults += simulation.decision.phase is Phase.FAULT
            simulation.release()
            _run(simulation, 1.0, found)
            simulation.reset()
        except PlantDivergedError as error:
            ended.append(str(error))
            before_s += simulation.seen.time_s
            simulation = _sound_machine(scene_name, model, tier, number)
    return {
        "job": name,
        "tier": tier,
        "scene": scene_name,
        "pneumatics": model,
        "seconds": before_s + simulation.seen.time_s,
        "grasps": grasps,
        "faults": faults,
        "found": found,
        "ended": ended,
    }


def _sound_machine(scene_name: str, model: str, tier: str, number: int) -> Simulation:
    scene, request = load_scene(scene_name)
    simulation = Simulation(scene, replace(request.in_tier(tier), pneumatics=model), seed=number)
    for channel in range(CHANNEL_COUNT):
        simulation.inject(MachineFault("leak", channel, LEAK_TIME_CONSTANT_S))
    return simulation


def _idle(simulation: Simulation, random: np.random.Generator, found: list[str]) -> None:
    _run(simulation, random.uniform(0.2, 3.0), found)


def _use(simulation: Simulation, random: np.random.Generator, found: list[str]) -> None:
    """Close, and stop half-way or lift, hold and lower."""
    if random.random() < 0.2:
        _run(simulation, random.uniform(0.05, 0.5), found)
        return
    _run(simulation, 1.2, found)
    simulation.lift()
    _run(simulation, random.uniform(1.0, 20.0), found)
    simulation.lower()
    _run(simulation, random.uniform(0.2, 2.0), found)


def _run(simulation: Simulation, duration_s: float, found: list[str]) -> None:
    """Let time pass, and note each finding when it comes up."""
    for _ in range(round(duration_s / TICK_S)):
        standing = {(finding.fault, finding.channels) for finding in simulation.findings}
        simulation.tick()
        for finding in simulation.findings:
            if (finding.fault, finding.channels) not in standing:
                found.append(f"{simulation.seen.time_s:.2f} s: {finding.text}")


def sound_text(rows: list[dict]) -> str:
    """Return what came of it in a line, and what was found below it."""
    hours = sum(row["seconds"] for row in rows) / 3600.0
    grasps, found = (
        sum(row["grasps"] for row in rows),
        [f"{row['job']}: {each}" for row in rows for each in row["found"]],
    )
    faults = sum(row["faults"] for row in rows)
    ended = [f"{row['job']}: the plant {each}" for row in rows for each in row["ended"]]
    head = f"{hours:.2f} h of a sound machine, {grasps} grasps: {len(found)} false findings, {faults} faults"
    return "\n".join([head, *found, *ended])


def span_text(row: dict) -> str:
    """Return the line of a finished span."""
    return f"{row['job']}: {row['scene']}, {row['pneumatics']}, {row['grasps']} grasps, {len(row['found'])} findings"
