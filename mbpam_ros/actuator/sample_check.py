"""What samples must have before a metamodel is fitted to them: enough of them, all different, and off a line or conic.

One check for all metamodels, on the designs scaled to [-1, 1]^2 over their own range, so that units and offsets do not
matter. A metamodel is asked everywhere in its box; where the samples lie on a line, or on a conic such as two lines, a
circle or a parabola, a function that is zero there may be added to it without any sample telling, and neither a spline
nor kriging's deviation knows of that. Curves of higher order are recognised only as far as the metamodel's own
polynomials reach.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from mbpam_ros.actuator.design import SAME_DESIGN_SHARE, DesignDomain
from mbpam_ros.errors import MbpamError

Powers = Sequence[tuple[int, int]]
"""Terms of a polynomial, each by its power of a and of b."""

QUADRATIC: Powers = ((0, 0), (1, 0), (0, 1), (2, 0), (0, 2), (1, 1))
"""All terms up to second order. Through any five designs there is a conic, so six are the fewest."""

LARGEST_LINE_CONDITION = 10.0
"""Of the centred and scaled designs, as wide as a tenth of their length: a correlation of a and b of 0.98. The paper's
samples have 1.02; of random Latin hypercubes of seven or more designs one in a thousand has more than 7.4."""

LARGEST_CURVE_CONDITION = 300.0
"""Of the polynomial terms at the scaled designs. The paper's samples have 4.3 (quadratic) and 8.6 (its cubic); of
random Latin hypercubes of nine designs one in a thousand has more than 105 (quadratic); designs within 1 % of the range
of a parabola have 600."""


class MetamodelError(MbpamError, ValueError):
    """These samples do not determine this metamodel; the message says what is missing."""


def monomials(points: NDArray[np.float64], powers: Powers) -> NDArray[np.float64]:
    """Return the terms a^i b^j at ``points``, shape (n, 2), as shape (n, terms)."""
    a, b = points.T
    return np.column_stack([a**i * b**j for i, j in powers])


def require_determining(
    design_mm: NDArray[np.float64], domain: DesignDomain, least: int, powers: Powers = QUADRATIC
) -> None:
    """Check that samples at ``design_mm``, shape (n, 2), can carry a metamodel over ``domain``.

    The condition numbers are those of Belsley, Kuh and Welsch, Regression Diagnostics (1980), chapter 3: largest over
    smallest singular value.

    Args:
        design_mm: inside the domain.
        domain: what "the same design" is relative to.
        least: fewest samples.
        powers: the terms of the metamodel's own polynomial, beyond the quadratic ones that all must determine.

    Raises:
        MetamodelError: too few designs; one that occurs twice; a variable that does not vary; or designs on, or nearly
            on, a line or a curve. The message names the designs, the direction or the curve, and what to do.
    """
    if len(design_mm) < least:
        raise MetamodelError(f"expected at least {least} designs, found {len(design_mm)}")
    _require_variation(design_mm)
    _require_distinct(design_mm, domain)
    own = DesignDomain.around(design_mm)
    scaled = own.scale(design_mm)
    _require_off_a_line(scaled, own)
    for terms in dict.fromkeys((tuple(QUADRATIC), tuple(powers))):
        _require_off_a_curve(scaled, own, domain, terms)


def _require_variation(design_mm: NDArray[np.float64]) -> None:
    for name, values in zip("ab", design_mm.T, strict=True):
        spread, rounding = float(np.ptp(values)), float(np.spacing(np.abs(values).max()))
        if spread * SAME_DESIGN_SHARE <= rounding:
            raise MetamodelError(
                f"{name} is {values[0]:g} mm in all samples and spans no range (found {spread:.1g} mm); nothing is "
                f"known of other values: add samples with another {name}"
            )


def _require_distinct(design_mm: NDArray[np.float64], domain: DesignDomain) -> None:
    # Scaled so that one is the tolerance, in the distance that DesignDomain.same measures: the larger of both shares.
    pairs = KDTree(domain.scale(design_mm) / (2.0 * SAME_DESIGN_SHARE)).query_pairs(
        1.0, p=np.inf, output_type="ndarray"
    )
    if len(pairs):
        first, second = pairs[np.lexsort(pairs.T[::-1])[0]]
        apart = np.abs(design_mm[first] - design_mm[second]).max()
        raise MetamodelError(
            f"samples {first + 1} and {second + 1} have the same design a = {design_mm[first, 0]:g}, "
            f"b = {design_mm[first, 1]:g} mm ({apart:.2g} mm apart; {SAME_DESIGN_SHARE:g} of the range or less is the "
            "same), so it occurs twice: keep one of them"
        )


def _require_off_a_line(scaled: NDArray[np.float64], own: DesignDomain) -> None:
    _, sizes, directions = np.linalg.svd(scaled - scaled.mean(axis=0), full_matrices=False)
    condition = _ratio(sizes)
    if condition > LARGEST_LINE_CONDITION:
        along, across = (_in_mm(direction, own) for direction in directions)
        raise MetamodelError(
            f"the designs lie on a line along (a, b) = ({along[0]:.3g}, {along[1]:.3g}), or nearly: the condition "
            f"number of the scaled designs is {condition:.2g}, at most {LARGEST_LINE_CONDITION:g} may be; nothing is "
            f"known in direction ({across[0]:.3g}, {across[1]:.3g}): add samples with designs off the line"
        )


def _require_off_a_curve(scaled: NDArray[np.float64], own: DesignDomain, domain: DesignDomain, powers: Powers) -> None:
    _, sizes, combinations = np.linalg.svd(monomials(scaled, powers), full_matrices=False)
    condition = _ratio(sizes)
    if condition <= LARGEST_CURVE_CONDITION:
        return
    kind = "cubic" if max(map(max, powers)) > 2 else "quadratic"
    refused = (
        f"these designs do not determine the terms of a {kind} (condition number of the scaled terms {condition:.2g}, "
        f"at most {LARGEST_CURVE_CONDITION:g} may be): "
    )
    for index, name in enumerate("ab"):
        needed = 1 + max(power[index] for power in powers)
        values = _different(own.scale(domain.bounds_mm), scaled, index)
        if len(values) < needed:
            raise MetamodelError(
                f"{refused}{name} has only {len(values)} different values, a {kind} needs at least {needed}: add "
                f"samples with another {name}"
            )
    curve = _curve_text(combinations[-1], powers)
    raise MetamodelError(
        f"{refused}all lie on one curve, or nearly: {curve} = 0 with a and b scaled to -1 ... 1 over the samples; "
        "nothing is known off it: add samples there"
    )


def _different(bounds: NDArray[np.float64], scaled: NDArray[np.float64], index: int) -> list[float]:
    """Return the values of one scaled variable of which each is more than the tolerance above the one before."""
    tolerance = SAME_DESIGN_SHARE * float(np.ptp(bounds[:, index]))
    values = np.sort(scaled[:, index])
    return [values[0], *values[1:][np.diff(values) > tolerance]]


def _curve_text(combination: NDArray[np.float64], powers: Powers) -> str:
    """Return a polynomial in words, largest coefficient 1, without those that do not show."""
    combination = combination / combination[np.argmax(np.abs(combination))]
    terms = []
    for weight, (i, j) in zip(combination, powers, strict=True):
        if abs(weight) >= 0.005:
            factors = [name + (f"^{power}" if power > 1 else "") for name, power in (("a", i), ("b", j)) if power]
            terms.append(f"{weight:+.2f}" + "".join(f" {factor}" for factor in factors))
    return " ".join(terms).removeprefix("+")


def _in_mm(direction: NDArray[np.float64], own: DesignDomain) -> NDArray[np.float64]:
    """Return a direction of the scaled box in (a, b), of length one, its first component not negative."""
    low, high = own.bounds_mm
    turned: NDArray[np.float64] = direction * (high - low)
    turned = turned / np.linalg.norm(turned)
    return -turned if turned[0] < 0.0 else turned


def _ratio(sizes: NDArray[np.float64]) -> float:
    return float(sizes[0] / sizes[-1]) if sizes[-1] > 0.0 else float("inf")
