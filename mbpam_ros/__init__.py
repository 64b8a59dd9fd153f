"""A four-finger gripper of multi-directional bending pneumatic artificial muscles on ROS 2, and in plain Python.

The public names; each is imported when it is first asked for, so that a node loads no more than it needs.

>>> from mbpam_ros import Simulation
>>> simulation = Simulation("bulb")
>>> seen = simulation.run(0.3)
>>> simulation.grasp().reason
'closing in envelope: light bulb: sphere is round from above, 60 mm'
"""

from __future__ import annotations

import importlib

_PUBLIC = {
    "Answer": "answer",
    "Fidelity": "plant.fidelity",
    "FidelityRequest": "plant.fidelity",
    "Gripper": "gripper",
    "MbpamError": "errors",
    "Observation": "plant.plant",
    "Phase": "grasp.phases",
    "Plant": "plant.plant",
    "Scene": "plant.scene",
    "Simulation": "simulation",
    "build_plant": "plant.plant",
    "load_gripper": "gripper",
    "load_scene": "plant.scene",
}

__all__ = sorted(_PUBLIC)


def __getattr__(name: str) -> object:
    """Import a public name."""
    if name not in _PUBLIC:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}; it has {', '.join(__all__)}")
    return getattr(importlib.import_module(f"{__name__}.{_PUBLIC[name]}"), name)


def __dir__() -> list[str]:
    """Name what can be imported."""
    return __all__
