"""What a 100 Hz sample costs the valve controller: the loops alone, and with observers and test pulses around them.

A grasp of one chamber a finger closes and is held on the simulated valves, without muscles; its readings are kept, and
then given to loops and to guarded loops again, sample by sample, with nothing else between them.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.chambers import CHAMBERS_PER_FINGER, CHANNEL_COUNT
from mbpam_ros.pneumatics.config import PneumaticsConfig
from mbpam_ros.pneumatics.controller import PressureController
from mbpam_ros.pneumatics.registry import build_pneumatics
from mbpam_ros.pneumatics.sensing import PressureSensing
from mbpam_ros.pneumatics.transducer import Transducer
from mbpam_ros.pneumatics.valve_guard import GuardedValves

Readings = list[NDArray[np.float64]]

TICK_S, GRASP_S = 0.01, 10.0
LIMIT_PA, OVER_PRESSURE_PA = 110e3, 120e3
GRIP_PA = np.where(np.arange(CHANNEL_COUNT) % CHAMBERS_PER_FINGER == 0, 100e3, 0.0)
MODELS = ("lag", "iso6358")
ALONE = "loops alone"


def guard_costs_us(config: PneumaticsConfig, repeats: int) -> dict[str, list[float]]:
    """Return the CPU time of a sample [us], of each repeat: loops alone, and guarded as for each model's valves.

    What is compared is measured in turn, so that a busy computer is busy for all.
    """
    readings = {model: _readings(config, model) for model in MODELS}
    costs: dict[str, list[float]] = {ALONE: [], **{model: [] for model in MODELS}}
    for _ in range(repeats):
        loops = PressureController(config.controller, LIMIT_PA, OVER_PRESSURE_PA)
        loops.enable(True)
        loops.request(GRIP_PA)
        costs[ALONE].append(_cost_us(loops.update, readings[MODELS[0]]))
        for model in MODELS:
            costs[model].append(_cost_us(_guarded(config, model).update, readings[model]))
    return costs


def _guarded(config: PneumaticsConfig, model: str) -> GuardedValves:
    valves = GuardedValves(config, LIMIT_PA, OVER_PRESSURE_PA, switched_on=True, model=model)
    valves.switch.request(GRIP_PA)
    return valves


def _readings(config: PneumaticsConfig, model: str) -> Readings:
    """Return the readings of a grasp on valves of this model."""
    chambers = build_pneumatics(model, config.chamber)
    transducer, sensing = (
        Transducer(config.transducer, CHANNEL_COUNT, 0),
        PressureSensing(config.sensing, config.transducer),
    )
    valves, readings = _guarded(config, model), []
    for tick in range(round(GRASP_S / TICK_S)):
        volts = transducer.measure(chambers.pressure_gauge_pa)
        readings.append(sensing.update(tick * TICK_S, volts).pressure_gauge_pa)
        chambers.step(valves.update(tick * TICK_S, readings[-1]).spool, TICK_S)
    return readings


def _cost_us(update: Callable[[float, NDArray[np.float64]], object], readings: Readings) -> float:
    began_s = time.process_time()
    for tick, reading in enumerate(readings):
        update(tick * TICK_S, reading)
    return 1e6 * (time.process_time() - began_s) / len(readings)
