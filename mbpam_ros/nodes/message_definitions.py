"""Definitions of message types as their packages install them, for readers that have never heard of them."""

from __future__ import annotations

import functools
import importlib
import os
import sys
from pathlib import Path

from mbpam_ros.errors import MbpamError

_SEPARATOR = "=" * 80
_PLAIN = frozenset(
    "bool byte char float32 float64 int8 uint8 int16 uint16 int32 uint32 int64 uint64 string wstring".split()
)


class DefinitionError(MbpamError, LookupError):
    """No installed package defines a type; the message says which, and where it was looked for."""


def message_class(type_name: str) -> type:
    """Return the class of a type such as ``sensor_msgs/msg/JointState``.

    Raises:
        DefinitionError: its package is not installed.
    """
    package, kind, name = type_name.split("/")
    try:
        found: type = getattr(importlib.import_module(f"{package}.{kind}"), name)
    except (ImportError, AttributeError) as error:
        raise DefinitionError(f"{type_name}: {package} is not installed, or does not have it") from error
    return found


@functools.cache
def definition(type_name: str) -> str:
    """Return the ``.msg`` file of a type, and behind it those of all types in it, each under its name.

    The form is MCAP's ``ros2msg``, which is that of rosbag2 and Foxglove.

    Raises:
        DefinitionError: a file is not installed.
    """
    texts = {type_name: _text(type_name)}
    waiting = [type_name]
    while waiting:
        inner = waiting.pop()
        for name in _types_in(texts[inner], inner.split("/")[0]):
            if name not in texts:
                texts[name] = _text(name)
                waiting.append(name)
    (_, own), *others = texts.items()
    short = ((name.replace("/msg/", "/"), text) for name, text in others)
    return "\n".join([own, *(f"{_SEPARATOR}\nMSG: {name}\n{text}" for name, text in short)])


def _types_in(text: str, package: str) -> list[str]:
    """Full names of the types of a definition's fields that are messages themselves."""
    found = []
    for line in text.splitlines():
        kind = line.partition("#")[0].strip().partition(" ")[0].partition("[")[0].partition("<")[0]
        if kind and kind not in _PLAIN:
            parts = kind.split("/")
            owner = parts[0] if len(parts) > 1 else package
            found.append(f"{owner}/msg/{parts[-1]}")
    return found


def _text(type_name: str) -> str:
    package, kind, name = type_name.split("/")
    prefixes = [*filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)), sys.prefix]
    for prefix in prefixes:
        path = Path(prefix, "share", package, kind, f"{name}.msg")
        if path.is_file():
            return path.read_text(encoding="utf-8")
    raise DefinitionError(f"{type_name}: no {name}.msg under share/{package}/{kind} of {', '.join(prefixes)}")
