"""Find the configuration files and turn their mappings into checked dataclasses.

The files are found wherever the package was put: in a source tree or an editable install (``config/`` beside
``package.xml``), in a colcon install and in a pip install (``share/mbpam_ros/config`` of the prefix).
``MBPAM_CONFIG_DIR`` overrides the search.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import os
import re
import reprlib
import types
import typing
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from mbpam_ros import bounded_yaml
from mbpam_ros.errors import MbpamError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

PACKAGE = "mbpam_ros"
LARGEST_NUMBER = 1e12
"""No length, pressure, modulus, time or count of a gripper is larger; squares and cubes of it are still finite."""

DIRECTORY_VARIABLE = "MBPAM_CONFIG_DIR"

Config = TypeVar("Config", bound="DataclassInstance")


class ConfigError(MbpamError, ValueError):
    """A configuration file is missing, unreadable, or holds a key or value that cannot be used."""


def config_directory() -> Path:
    """Return the directory of the configuration files.

    Raises:
        ConfigError: no directory with ``gripper.yaml`` in it was found; the message lists where it was sought.
    """
    override = os.environ.get(DIRECTORY_VARIABLE)
    if override:
        candidates = [Path(override)]
    else:
        package = Path(__file__).parent
        candidates = [package.parent / "config", package.resolve().parent / "config"]
        candidates += [parent / "share" / PACKAGE / "config" for parent in package.parents]
    for candidate in candidates:
        if (candidate / "gripper.yaml").is_file():
            return candidate
    sought = ", ".join(str(candidate) for candidate in candidates)
    raise ConfigError(f"no configuration directory found; looked in {sought}; set {DIRECTORY_VARIABLE} to it")


def config_path(name: str | Path) -> Path:
    """Return the file ``name``: a path as given if it exists, else a file of the configuration directory.

    Raises:
        ConfigError: there is no such file.
    """
    given = Path(name).expanduser()
    if given.is_file():
        return given
    path = config_directory() / name
    if not path.is_file():
        raise ConfigError(f"{name}: no such file, neither as given nor in {config_directory()}")
    return path


def load_yaml(name: str | Path) -> dict[str, Any]:
    """Read a YAML file that holds a mapping.

    Raises:
        ConfigError: the file is missing or unreadable, is not YAML or is more than a configuration may be
            (:mod:`~mbpam_ros.bounded_yaml`), or is not a mapping.
    """
    path = config_path(name)
    try:
        content = bounded_yaml.parse(path.read_text(encoding="utf-8"))
    except bounded_yaml.YamlError as error:
        raise ConfigError(f"{path}: {error}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not valid YAML: not text in UTF-8") from error
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: expected a mapping at the top, found {type(content).__name__}")
    return content


def load_config(cls: type[Config], name: str | Path) -> Config:
    """Read the YAML file ``name`` into the dataclass ``cls`` (see :func:`parse_config`)."""
    return parse_config(cls, load_yaml(name), where=str(name))


def parse_config(cls: type[Config], mapping: Any, where: str, **decided: object) -> Config:
    """Build the dataclass ``cls`` from a mapping, strictly.

    Every key must be a field and every field without a default must be given. Values are checked against the
    field's type: numbers must be finite, lists become tuples of the stated length, nested dataclasses are built from
    nested mappings. What a dataclass refuses in ``__post_init__`` (a ``ValueError``) is reported with its place.

    Args:
        cls: a dataclass type.
        mapping: what the file holds.
        where: name of the place, for messages, e.g. ``gripper.yaml``.
        decided: values of fields that the mapping may not have.

    Raises:
        ConfigError: names the place, what is wrong, and what would be right.
    """
    config: Config = parse_together((cls,), mapping, where, **decided)[0]
    return config


def parse_together(
    classes: tuple[type[DataclassInstance], ...], mapping: Any, where: str, **decided: object
) -> tuple[Any, ...]:
    """Build several dataclasses from one mapping, each as :func:`parse_config` does; they share out its keys.

    Raises:
        ConfigError: names the place, what is wrong, and what would be right.
    """
    if not isinstance(mapping, dict):
        raise ConfigError(f"{where}: expected a mapping, found {mapping!r}")
    fields = {
        field.name: field
        for cls in classes
        for field in dataclasses.fields(cls)
        if field.init and field.name not in decided
    }
    unknown = sorted(str(key) for key in mapping if key not in fields)
    if unknown:
        raise ConfigError(f"{where}: unknown key {', '.join(unknown)}; known: {', '.join(fields)}")
    missing = [
        name
        for name, field in fields.items()
        if name not in mapping and field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    ]
    if missing:
        raise ConfigError(f"{where}: missing key {', '.join(missing)}")
    return tuple(_build(cls, mapping, where, decided) for cls in classes)


_type_hints = functools.lru_cache(maxsize=256)(typing.get_type_hints)


def _build(cls: type[DataclassInstance], mapping: dict[str, Any], where: str, decided: dict[str, object]) -> object:
    hints = _type_hints(cls)
    names = [field.name for field in dataclasses.fields(cls)]
    values = {name: _convert(hints[name], mapping[name], f"{where}: {name}") for name in names if name in mapping}
    values |= {name: value for name, value in decided.items() if name in names}
    try:
        return cls(**values)
    except ConfigError:
        raise
    except ValueError as error:
        raise ConfigError(f"{where}: {error}") from error


def require_positive(owner: object, *names: str) -> None:
    """Raise ``ValueError`` unless every named attribute of ``owner`` (a number or a tuple of them) is > 0."""
    for name in names:
        value = getattr(owner, name)
        if not all(item > 0 for item in (value if isinstance(value, tuple) else (value,))):
            raise ValueError(f"{name} must be greater than 0, found {value}")


def _convert(expected: Any, value: Any, where: str) -> Any:
    origin, arguments = typing.get_origin(expected), typing.get_args(expected)
    if origin in (typing.Union, types.UnionType):
        if value is None and type(None) in arguments:
            return None
        return _convert(next(item for item in arguments if item is not type(None)), value, where)
    if origin is typing.Literal:
        if value not in arguments:
            raise ConfigError(f"{where}: {_shown(value)} is not one of {', '.join(map(str, arguments))}")
        return value
    if isinstance(expected, type) and dataclasses.is_dataclass(expected):
        return value if isinstance(value, expected) else parse_config(expected, value, where)
    if origin is dict:
        if not isinstance(value, dict):
            raise ConfigError(f"{where}: expected a mapping, found {_shown(value)}")
        return {str(key): _convert(arguments[1], item, f"{where}: {key}") for key, item in value.items()}
    if origin is tuple:
        return _convert_tuple(arguments, value, where)
    return _convert_scalar(expected, value, where)


def _convert_tuple(arguments: tuple[Any, ...], value: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise ConfigError(f"{where}: expected a list, found {_shown(value)}")
    if len(arguments) == 2 and arguments[1] is Ellipsis:
        arguments = (arguments[0],) * len(value)
    if len(value) != len(arguments):
        raise ConfigError(f"{where}: expected {len(arguments)} values, found {len(value)}")
    parts = enumerate(zip(arguments, value, strict=True))
    return tuple(_convert(expected, part, f"{where}[{i}]") for i, (expected, part) in parts)


def _convert_scalar(expected: type, value: Any, where: str) -> Any:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{where}: expected a finite number, found {value}")
    if is_number and abs(value) > LARGEST_NUMBER:
        raise ConfigError(f"{where}: expected a number up to {LARGEST_NUMBER:g}, found {_shown(value)}")
    if expected is float and is_number:
        return float(value)
    if expected is int and isinstance(value, bool) or not isinstance(value, expected):
        hint = ""
        if expected is float and isinstance(value, str) and re.fullmatch(r"[-+]?[0-9.]+[eE][0-9]+", value):
            hint = f"; YAML reads it as text, write {value.lower().replace('e', 'e+')} with a point"
        raise ConfigError(f"{where}: expected {expected.__name__}, found {_shown(value)}{hint}")
    return value


def _shown(value: object) -> str:
    """Return the value as in Python, shortened so that it stays one line."""
    return reprlib.repr(value)
