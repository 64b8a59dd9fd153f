"""Samples of the muscle's performance over its design: the paper's tables, or a user's own CSV."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mbpam_ros.actuator.design import DesignDomain
from mbpam_ros.actuator.metamodel import read_samples
from mbpam_ros.actuator.tables import read_columns

RESPONSES = {"theta_max": "deg", "f_max": "N"}
"""What a sample tells of its design, with its unit: greatest bend and blocked tip force (PDC, 100 kPa)."""


@dataclass(frozen=True)
class Samples:
    """Designs and what finite elements (or a test) gave for them.

    Args:
        design_mm: rows (a, b), shape (n, 2) [mm].
        responses: by the keys of :data:`RESPONSES`, each of shape (n,).
    """

    design_mm: NDArray[np.float64]
    responses: dict[str, NDArray[np.float64]]

    @classmethod
    def of_the_paper(cls, table: str) -> Samples:
        """Return the samples of a table in ``config/data``.

        Raises:
            ConfigError: the table is missing or unreadable.
        """
        design, theta, force = read_samples(table)
        return cls(design, {"theta_max": theta, "f_max": force})

    @classmethod
    def read(cls, path: Path) -> Samples:
        """Return the samples of a CSV with columns ``a_mm``, ``b_mm``, ``theta_max_deg``, ``f_max_n``.

        Raises:
            TableError: as :func:`mbpam_ros.actuator.tables.read_columns`.
        """
        a, b, theta, force = read_columns(path, "a_mm", "b_mm", "theta_max_deg", "f_max_n")
        return cls(np.column_stack([a, b]), {"theta_max": theta, "f_max": force})

    def digest(self) -> str:
        """Return a number for the samples: results of others are not taken over."""
        digest = hashlib.sha256()
        for numbers in (self.design_mm, *(self.responses[key] for key in RESPONSES)):
            digest.update(np.ascontiguousarray(numbers).tobytes())
        return digest.hexdigest()[:16]

    def domain(self) -> DesignDomain:
        """Return the box that the designs fill.

        Raises:
            DesignDomainError: they do not span a range in both variables.
        """
        return DesignDomain.around(self.design_mm)

    def at(self, a_mm: float, b_mm: float, domain: DesignDomain) -> tuple[float, float] | None:
        """Return angle [deg] and force [N] of the design (a, b) if it is among the samples, by ``domain.same``."""
        found = np.flatnonzero(domain.same(self.design_mm, [a_mm, b_mm]))
        if found.size == 0:
            return None
        return float(self.responses["theta_max"][found[0]]), float(self.responses["f_max"][found[0]])
