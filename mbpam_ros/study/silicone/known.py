"""Silicones by name (``config/silicones.yaml``), or as ``mbpam silicone --json FILE`` has kept them."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from mbpam_ros.configuration import ConfigError, load_config, parse_config
from mbpam_ros.study.silicone.hyperelastic import Yeoh

SILICONES_FILE = "silicones.yaml"


@dataclass(frozen=True)
class KnownSilicone:
    """Yeoh's constants of a silicone on the market.

    Args:
        c10_mpa, c20_mpa, c30_mpa: Yeoh's.
        strain_to: largest engineering strain of the test that they follow.
        source: where they, or the test, were published.
        strain_at_break: engineering strain at which a specimen tore; None where it was not published.
        strength_mpa: its engineering stress there.
    """

    c10_mpa: float
    c20_mpa: float
    c30_mpa: float
    strain_to: float
    source: str
    strain_at_break: float | None = None
    strength_mpa: float | None = None


@dataclass(frozen=True)
class _SiliconesFile:
    silicones: dict[str, KnownSilicone]


def load_silicones(name: str | Path = SILICONES_FILE) -> dict[str, KnownSilicone]:
    """Return the silicones of a file by name.

    Raises:
        ConfigError: the file is missing or holds something else.
    """
    return load_config(_SiliconesFile, name).silicones


def yeoh_constants_of(name: str) -> Yeoh:
    """Return Yeoh's constants of a name in the configuration, or of a file of ``mbpam silicone --json``.

    Raises:
        ConfigError: there is neither, or the file has no constants of Yeoh's model.
    """
    known = load_silicones()
    if name in known:
        found = known[name]
        return Yeoh(found.c10_mpa, found.c20_mpa, found.c30_mpa)
    path = Path(name)
    if not path.is_file():
        raise ConfigError(f"no silicone {name!r}, nor a file of that name; known: {', '.join(known)}")
    try:
        constants = json.loads(path.read_text(encoding="utf-8"))["models"]["yeoh"]["constants"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{name}: no file of mbpam silicone --json: it has no constants of Yeoh's model") from error
    return parse_config(Yeoh, constants, f"{name}: yeoh")


def largest_stretch_of(name: str) -> float | None:
    """Return the stretch that specimens of a silicone are known to have borne in one direction; None if none is known.

    Of a name in the configuration the stretch at break; of a file of ``mbpam silicone --json`` the end of the shortest
    of its pulls, whether that was the break or the machine was stopped before.

    Raises:
        ConfigError: there is neither, or the file is none of that command.
    """
    known = load_silicones()
    if name in known:
        strain = known[name].strain_at_break
        return None if strain is None else 1.0 + strain
    yeoh_constants_of(name)  # says what is wrong with the name or the file
    try:
        tests = json.loads(Path(name).read_text(encoding="utf-8"))["tests"]
        return 1.0 + min(float(test["strain"][1]) for test in tests)
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise ConfigError(f"{name}: no file of mbpam silicone --json: it does not say how far was pulled") from error
