"""A tensile test: one pull from rest to its largest stress, what silicone cannot be, and the mean of repeats."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.study.silicone.machine_table import TensileTestError

Array = NDArray[np.float64]

FEWEST_ROWS = 3
"""With fewer there is no curve."""

YOUNGS_MODULUS_MPA = (0.01, 12.0)
"""Of castable silicones, from the softest gels to the hardest: beyond it a warning is given."""

_IMPOSSIBLE_FACTOR = 4.0
"""So far beyond :data:`YOUNGS_MODULUS_MPA` a test is refused."""

LARGEST_STRAIN = 25.0
"""No silicone stretches further before it breaks."""

SMALL_STRAIN = 0.25
"""Up to this strain Young's modulus is taken, to tell units that cannot be right."""


@dataclass(frozen=True)
class TensileTest:
    """One pull, from rest to its largest stress.

    Args:
        source: name of the file, or of the files whose mean it is.
        strain: engineering strain, rising, shape (n,).
        stress_mpa: engineering stress, force over the section before the test, shape (n,) [MPa].
        notes: what was assumed or left out, a line each.
        spread_mpa: standard deviation among repeats, shape (n,) [MPa]; None for one test.
    """

    source: str
    strain: Array
    stress_mpa: Array
    notes: tuple[str, ...] = ()
    spread_mpa: Array | None = None


def mean_of(tests: Sequence[TensileTest], points: int = 200) -> TensileTest:
    """Return the mean of repeats over the strains that all of them have, with their spread.

    Raises:
        TensileTestError: they have no strains in common.
    """
    if len(tests) == 1:
        return tests[0]
    low, high = max(test.strain[0] for test in tests), min(test.strain[-1] for test in tests)
    if not low < high:
        raise TensileTestError("the repeats have no range of strain in common")
    strain = np.linspace(low, high, points)
    stress_mpa = np.array([np.interp(strain, test.strain, test.stress_mpa) for test in tests])
    notes = [f"{test.source}: {note}" for test in tests for note in test.notes]
    return TensileTest(
        f"mean of {len(tests)} tests", strain, stress_mpa.mean(axis=0), tuple(notes), stress_mpa.std(axis=0, ddof=1)
    )


def first_pull(test: TensileTest) -> TensileTest:
    """Return the test from rest to its largest stress, with strains that rise.

    Raises:
        TensileTestError: it is too short, compressive, or goes back.
    """
    strain, stress, notes = test.strain, test.stress_mpa, list(test.notes)
    if strain.min() < -0.02 or stress[np.argmax(np.abs(stress))] < 0.0:
        raise TensileTestError(
            f"{test.source}: compressive: strain goes to {strain.min():.3g}, stress to {stress.min():.3g} MPa; only a "
            "pull is fitted (if the machine writes a pull as negative, turn the signs)"
        )
    peak = int(np.argmax(stress))
    if peak + 1 < stress.size:
        notes.append(f"{_points(stress.size - 1 - peak)} after the largest stress left out")
        strain, stress = strain[: peak + 1], stress[: peak + 1]
    if stress.size < FEWEST_ROWS:
        raise TensileTestError(f"{test.source}: no pull: the stress is largest at point {peak + 1} already")
    reach = np.maximum.accumulate(strain)
    back = reach - strain
    if back.max() > 0.02 * max(float(reach[-1] - strain[0]), 1e-9):
        where = int(np.argmax(back))
        raise TensileTestError(
            f"{test.source}: not one pull: strain goes back from {reach[where]:.3g} to {strain[where]:.3g} at point "
            f"{where + 1}; give one loading"
        )
    rising = np.concatenate([[True], strain[1:] > reach[:-1]])
    if not rising.all():
        notes.append(f"{_points(int((~rising).sum()))} whose strain does not rise left out")
        strain, stress = strain[rising], stress[rising]
    astray = _astray(strain, stress)
    if astray.any():
        strains = ", ".join(f"{each:.3g}" for each in strain[astray])
        notes.append(f"{_points(int(astray.sum()))} far off the neighbours left out, at strain {strains}")
        strain, stress = strain[~astray], stress[~astray]
    if strain.size < FEWEST_ROWS:
        raise TensileTestError(f"{test.source}: too short: {strain.size} points whose strain rises")
    return replace(test, strain=strain, stress_mpa=stress, notes=tuple(notes))


def plausible(test: TensileTest) -> TensileTest:
    """Return the test with notes about what is unusual.

    Raises:
        TensileTestError: noise drowns the curve, or silicone has no such strains or moduli.
    """
    if test.strain[-1] > LARGEST_STRAIN:
        raise TensileTestError(
            f"{test.source}: strain goes to {test.strain[-1]:.4g}, that is {100.0 * test.strain[-1]:.4g} %; silicone "
            f"breaks before {100.0 * LARGEST_STRAIN:g} %; a unit is wrong, perhaps by 100: see --columns"
        )
    noise = _noise_share(test.stress_mpa)
    if noise > 0.15:
        raise TensileTestError(f"{test.source}: noise of {100 * noise:.0f} % of the largest stress; nothing to fit")
    modulus = youngs_modulus_mpa(test)
    low, high = YOUNGS_MODULUS_MPA
    said = f"Young's modulus of {modulus:.3g} MPa at small strains, silicone has {low:g} to {high:g}"
    if not low / _IMPOSSIBLE_FACTOR < modulus < high * _IMPOSSIBLE_FACTOR:
        factors = {
            1000.0: "kPa and MPa",
            145.0: "psi and MPa",
            100.0: "% and a number of the strain",
            10.0: "bar or mm",
        }
        off = modulus / high if modulus > high else low / max(modulus, 1e-300)
        likely = [f"{factor:g} ({what})" for factor, what in factors.items() if off < 3.0 * factor]
        raise TensileTestError(
            f"{test.source}: {said}; a unit is wrong, perhaps by {' or '.join(likely) or 'more than 1000'}: "
            "see --columns, and the specimen's sizes"
        )
    notes = list(test.notes)
    if not low < modulus < high:
        notes.append(f"{said}: check its units")
    if noise > 0.02:
        notes.append(f"noise of {100 * noise:.0f} % of the largest stress")
    return replace(test, notes=tuple(notes))


def youngs_modulus_mpa(test: TensileTest) -> float:
    """Return Young's modulus [MPa], from neo-Hooke's curve through the points of small strain."""
    near = test.strain <= max(SMALL_STRAIN, float(np.sort(test.strain)[min(5, test.strain.size - 1)]))
    stretch = 1.0 + test.strain[near]
    shape: Array = stretch - stretch**-2
    return float(3.0 * (shape @ test.stress_mpa[near]) / max(float(shape @ shape), 1e-300))


def _points(count: int) -> str:
    return "1 point" if count == 1 else f"{count} points"


def _astray(strain: Array, stress: Array) -> NDArray[np.bool_]:
    """Return which few points lie far off the parabola through their neighbours, such as a jolt at the start.

    Far is ten times the median distance, and three tenths of the largest stress among the ten nearest.
    """
    off = np.zeros(stress.size, bool)
    if stress.size < 20:
        return off
    start = np.clip(np.arange(stress.size) - 4, 0, stress.size - 9)
    near = start[:, None] + np.arange(9)
    near = near[near != np.arange(stress.size)[:, None]].reshape(-1, 8)
    along: Array = strain[near] - strain[:, None]
    scaled = along / np.abs(along).max(axis=1)[:, None]
    powers = np.stack([np.ones_like(scaled), scaled, scaled**2], axis=-1)
    there = (np.linalg.pinv(powers) @ stress[near][..., None])[:, 0, 0]
    distance = np.abs(there - stress)
    nearby = np.array([stress[max(i - 5, 0) : i + 6].max() for i in range(stress.size)])
    far = distance > np.maximum(10.0 * np.median(distance), 0.3 * nearby)
    # a bad point spoils the parabolas of its neighbours: of each run the worst is meant
    for _ in range(3):
        if not far.any():
            break
        worst = int(np.argmax(np.where(far, distance / nearby, 0.0)))
        off[worst] = True
        far[max(worst - 4, 0) : worst + 5] = False
    return off


def _noise_share(stress: Array) -> float:
    """Return the scatter of neighbours about a straight line, over the largest stress."""
    if stress.size < 8:
        return 0.0
    second = stress[2:] - 2.0 * stress[1:-1] + stress[:-2]
    return float(np.median(np.abs(second)) / 0.6745 / np.sqrt(6.0) / max(np.abs(stress).max(), 1e-300))
