"""The pneumatic models by name."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path

from mbpam_ros.pneumatics.chamber import ChamberConfig, PneumaticModel, PneumaticsInputError

_MODELS = {
    "ideal": ("mbpam_ros.pneumatics.chamber", "IdealChambers"),
    "lag": ("mbpam_ros.pneumatics.chamber", "LagChambers"),
    "iso6358": ("mbpam_ros.pneumatics.iso6358", "IsoChambers"),
}
"""Modules are imported when asked for: a model that is not used costs nothing, neither does its compiler."""


HAS_VOLUME = ("iso6358",)
"""Models that know the chambers' volumes, and so what air is in them."""


def pneumatic_model_names() -> tuple[str, ...]:
    """Return the names of all models, cheapest first."""
    return tuple(_MODELS)


def build_pneumatics(name: str, config: ChamberConfig, gas_law: Path | None = None) -> PneumaticModel:
    """Return the pneumatic model ``name``, vented and closed.

    Args:
        name: of the model.
        config: supply, valve and chamber.
        gas_law: file of the chambers' volumes, for models that know them; None for the paper's muscle.

    Raises:
        PneumaticsInputError: no such model; the message lists those there are.
    """
    if name not in _MODELS:
        raise PneumaticsInputError(f"no pneumatic model {name!r}; known: {', '.join(_MODELS)}")
    module, model = _MODELS[name]
    build: Callable[[ChamberConfig, Path | None], PneumaticModel] = getattr(importlib.import_module(module), model)
    return build(config, gas_law)
