"""Picture of a test with its models, as the paper's Fig. 4a."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mbpam_ros.study.pictures import new_figure, save_figure
from mbpam_ros.study.silicone.fit import Fit
from mbpam_ros.study.silicone.tensile_test import TensileTest

_STYLES = {"yeoh": "-", "mooney-rivlin": "--", "ogden": "-.", "neo-hooke": ":"}


def draw_fits(tests: list[TensileTest], mean: TensileTest, fits: Mapping[str, Fit], path: Path) -> None:
    """Draw engineering stress over engineering strain: the tests, and each model where it was fitted and a little on.

    Raises:
        PictureError: matplotlib is not installed, or the file cannot be written.
    """
    figure = new_figure(7.2, 5.0)
    axis = figure.subplots()
    low, high = next(iter(fits.values())).stretch_range
    shown = low + 1.25 * (high - low)
    for test in tests:
        seen = test.strain <= shown - 1.0
        axis.plot(100.0 * test.strain[seen], test.stress_mpa[seen], ".", ms=4, color="0.6", label=test.source)
    if mean.spread_mpa is not None:
        axis.fill_between(
            100.0 * mean.strain,
            mean.stress_mpa - mean.spread_mpa,
            mean.stress_mpa + mean.spread_mpa,
            color="0.85",
            label="mean and spread of the repeats",
        )
    stretch = np.linspace(1.0, shown, 200)
    for name, fit in fits.items():
        label = f"{name}: R² {fit.r2:.4f}, RMSE {1e3 * fit.rmse_mpa:.2g} kPa"
        axis.plot(100.0 * (stretch - 1.0), fit.model.stress_mpa(stretch), _STYLES[name], lw=1.4, label=label)
    axis.axvspan(100.0 * (low - 1.0), 100.0 * (high - 1.0), color="tab:green", alpha=0.07, label="fitted here")
    axis.set_xlim(0.0, 100.0 * (shown - 1.0))
    axis.set_ylim(0.0, 1.4 * float(np.interp(shown - 1.0, mean.strain, mean.stress_mpa)))
    axis.set_xlabel("engineering strain [%]")
    axis.set_ylabel("engineering stress [MPa]")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
    save_figure(figure, path)
