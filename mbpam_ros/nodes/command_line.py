"""What a node's command line says besides its ROS arguments: help, or what nobody would read."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from mbpam_ros.nodes.interface import SERVICES, TOPICS
from mbpam_ros.nodes.parameters import Parameter
from mbpam_ros.terminal import table

_HELP = ("-h", "--help")
_PARAMETER = ("-p", "--param")

MANAGED = "managed_"
"""Before the name of a node in the name of the module with its managed version."""

CALLED = "MBPAM_CALLED"
"""Variable with what the user typed to start the executable, where that is not its name."""


def answer(arguments: Sequence[str], factories: Sequence[Callable]) -> int | None:
    """Print help or refuse what is no ROS argument; return the exit code, None if the nodes are to run.

    Args:
        arguments: the whole command line, the executable first.
        factories: the node classes of this executable, each in the module of its node with its ``PARAMETERS``.
    """
    name, left = _called(arguments[0]), besides_ros(arguments[1:])
    if not left:
        nodes = [node_name(factory) for factory in factories]
        nodes += [argument.partition("__node:=")[2] for argument in arguments if "__node:=" in argument]
        for prefix, rule in _prefixed_rules(arguments):
            if prefix not in nodes:
                known = ", ".join(nodes)
                print(f"error: {name}: -p {prefix}:{rule}: no node {prefix} in {name}, only {known}", file=sys.stderr)
                return 2
        return None
    if any(argument in _HELP for argument in left):
        print(help_text(name, factories))
        return 0
    given = " ".join(left)
    for_ros = left[0].startswith("-") or ":=" in left[0]
    cure = f"ROS arguments follow --ros-args: {name} --ros-args {given}" if for_ros else f"see {name} -h"
    print(f"error: {name}: unknown argument {given}; {cure}", file=sys.stderr)
    return 2


def _called(executable: str) -> str:
    """Return what the user typed: what ``ros2 run`` found says so, else the executable's name."""
    return os.environ.get(CALLED, Path(executable).stem)


def besides_ros(arguments: Sequence[str]) -> list[str]:
    """Return what does not stand between ``--ros-args`` and ``--``, or the end.

    ROS would take ``old:=new`` elsewhere too, as it did long ago, and with it swallow half of ``-p name:=value``.
    """
    left, ros = [], False
    for argument in arguments:
        if argument == "--ros-args":
            ros = True
        elif ros and argument == "--":
            ros = False
        elif not ros:
            left.append(argument)
    return left


def rules_of_node(arguments: Sequence[str], node: str) -> list[str]:
    """Return the parameter rules with the prefix of this node as ROS arguments of its own; empty without any.

    ROS applies ``-p plant:scene:=tomato`` to nodes that are called ``/plant``, and leaves out ``/right/plant`` without
    a word (rcl issue 1306); given to the node itself, without the prefix, it holds in any namespace.
    """
    rules = [part for prefix, rule in _prefixed_rules(arguments) if prefix == node for part in ("-p", rule)]
    return ["--ros-args", *rules] if rules else []


def node_name(factory: Callable) -> str:
    """Return the name of the node that a node class of this package builds, unless it is remapped."""
    module = sys.modules[factory.__module__]
    stem = Path(getattr(module, "__file__", None) or module.__name__).stem  # a module run itself is called __main__
    return stem.removeprefix(MANAGED)


def _prefixed_rules(arguments: Sequence[str]) -> list[tuple[str, str]]:
    """Return (node, name:=value) of all parameter rules that name a node."""
    rules = (rule for option, rule in zip(arguments, arguments[1:], strict=False) if option in _PARAMETER)
    split = ((rule.partition(":=")[0].rpartition(":")[0], rule) for rule in rules)
    return [(node, rule[len(node) + 1 :]) for node, rule in split if node]


def help_text(program: str, factories: Sequence[Callable]) -> str:
    """Return what the executable's nodes do, and their parameters, topics and services."""
    modules = [sys.modules[factory.__module__] for factory in factories]
    nodes = [node_name(factory) for factory in factories]
    prefixes = [f"{node}:" if len(nodes) > 1 else "" for node in nodes]
    lines = [
        f"usage: {program} [-h] [--ros-args [-p NAME:=VALUE] [-r OLD:=NEW] [--params-file FILE] [-r __ns:=/NAME] ...]",
        *("", "\n".join((module.__doc__ or "").strip() for module in modules), "", "parameters"),
        table(
            ("name", "default", "range", "meaning"),
            [
                _parameter_row(prefix, parameter)
                for prefix, module in zip(prefixes, modules, strict=True)
                for parameter in module.PARAMETERS
            ],
        ),
    ]
    listens = [topic for topic in TOPICS if set(nodes) & set(topic.subscribers)]
    publishes = [topic for topic in TOPICS if set(nodes) & set(topic.publishers)]
    for title, topics in (("listens to", listens), ("publishes (and /diagnostics)", publishes)):
        if topics:
            rows = [(topic.name, topic.message_type, topic.meaning) for topic in topics]
            lines += ["", title, table(("topic", "type", "meaning"), rows)]
    services = [(each.name, each.service_type, each.meaning) for each in SERVICES if each.node in nodes]
    if services:
        lines += ["", "serves", table(("service", "type", "meaning"), services)]
    return "\n".join(lines)


def _parameter_row(prefix: str, parameter: Parameter) -> tuple[str, str, str, str]:
    default = parameter.default
    shown = str(default).lower() if isinstance(default, bool) else str(default) or "''"
    limits = "" if parameter.low is None else f"{parameter.low:g} .. {parameter.high:g}"
    changeable = "; may be set while it runs" if parameter.changeable else ""
    return prefix + parameter.name, f"{shown} ({type(default).__name__})", limits, parameter.description + changeable
