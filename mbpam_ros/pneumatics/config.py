"""The pneumatics a user describes in ``config/pneumatics.yaml``: supply, valves, transducers, sensing, controller."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from mbpam_ros.configuration import load_config
from mbpam_ros.pneumatics.chamber import ChamberConfig
from mbpam_ros.pneumatics.controller import ControllerConfig
from mbpam_ros.pneumatics.observer import ObserverConfig
from mbpam_ros.pneumatics.probing import ProbingConfig
from mbpam_ros.pneumatics.sensing import SensingConfig
from mbpam_ros.pneumatics.transducer import TransducerConfig


@dataclass(frozen=True)
class PneumaticsConfig:
    """Everything between the supply and the chambers' measured pressures.

    Args:
        model: pneumatic model of the simulated plant, and of the valves that observers compare with.
        chamber: supply, valves and chambers of the simulated plant.
        transducer: data sheet of the transducers, simulated or real.
        sensing: how their volts are read.
        controller: the pressure loops.
        observer: what a sound machine does.
        probing: test pulses of valves at rest.
    """

    model: Literal["ideal", "lag", "iso6358"]
    chamber: ChamberConfig
    transducer: TransducerConfig
    sensing: SensingConfig
    controller: ControllerConfig
    observer: ObserverConfig = field(default_factory=ObserverConfig)
    probing: ProbingConfig = field(default_factory=ProbingConfig)

    def __post_init__(self) -> None:
        # With less noise than this a channel at rest can repeat one count for long without being stuck.
        if self.sensing.stuck_time_s > 0.0 and self.transducer.noise_v < 0.5 * self.transducer.resolution_v:
            raise ValueError(
                f"noise_v = {self.transducer.noise_v:g} V is below half a count of the converter "
                f"({0.5 * self.transducer.resolution_v:g} V): a sound channel would be called stuck; "
                "set sensing.stuck_time_s to 0"
            )


def load_pneumatics(name: str | Path = "pneumatics.yaml") -> PneumaticsConfig:
    """Read the pneumatics file ``name``.

    Raises:
        ConfigError: wrong keys or values.
    """
    return load_config(PneumaticsConfig, name)
