"""What a muscle's rod may do besides keeping its shape; shear is left out."""

from __future__ import annotations

from collections.abc import Sequence

STRAINS = ("bend", "stretch", "twist")
"""What a rod may do. It always bends."""


def check_strains(strains: Sequence[str]) -> None:
    """Check that all strains are known, each is there once, and ``bend`` among them.

    Raises:
        ValueError: they are not.
    """
    if "bend" not in strains or len(set(strains)) != len(strains) or not set(strains) <= set(STRAINS):
        raise ValueError(
            f"strains must be some of {', '.join(STRAINS)}, bend always, found {', '.join(strains) or 'none'}"
        )
