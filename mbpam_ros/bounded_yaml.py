"""Read YAML that somebody else wrote: what it costs grows with its size, and what cannot be meant is refused by line.

Two passes. The first goes over the parser's events, which are a flat list, and counts: depth, tags, and the nodes that
stand there once all aliases are written out, so that a few lines of aliases of aliases do not become a billion nodes.
The second builds Python's objects from what the first let pass.
"""

from __future__ import annotations

from typing import Any

import yaml

try:  # ten times as fast, and left out where PyYAML was built without libyaml
    from yaml import CSafeLoader as SafeLoader
except ImportError:
    from yaml import SafeLoader

from mbpam_ros.errors import MbpamError

LARGEST_FILE_BYTES = 1_000_000
DEEPEST_NESTING = 20
MOST_NODES = 10_000
"""Values and keys of a file, those of aliases counted where they are used. The largest of ours has 300."""


class YamlError(MbpamError, ValueError):
    """The text is not YAML, or is more or other than a configuration may be; one line, with the line number."""

    def __init__(self, message: str, mark: yaml.Mark | None = None) -> None:
        super().__init__(message if mark is None else f"line {mark.line + 1}: {message}")


class _Loader(SafeLoader):
    """YAML's safe loader without dates, which are text, and without keys that stand twice, of which the last wins."""

    yaml_implicit_resolvers = {
        first: [(tag, pattern) for tag, pattern in resolvers if tag != "tag:yaml.org,2002:timestamp"]
        for first, resolvers in SafeLoader.yaml_implicit_resolvers.items()
    }

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        keys = set()
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                raise YamlError("a key is a list or a mapping; keys are names", key.start_mark)
            if key.value in keys:
                raise YamlError(f"key {key.value} stands twice", key.start_mark)
            keys.add(key.value)
            try:
                self.construct_object(value, deep=True)
            except YamlError:
                raise
            except (ValueError, OverflowError) as error:
                raise YamlError(f"{key.value}: a number in it cannot be read", value.start_mark) from error
        mapping: dict[Any, Any] = super().construct_mapping(node, deep)
        return mapping


def parse(text: str) -> object:
    """Return what the text holds: mappings, lists, numbers, truth values, text and None.

    Args:
        text: a YAML document; anchors, aliases and merge keys may be used.

    Raises:
        YamlError: not YAML; too large, too deep or too many values; a tag; a key twice; a number that is none.
    """
    if len(text) > LARGEST_FILE_BYTES:
        raise YamlError(f"{len(text)} characters, at most {LARGEST_FILE_BYTES} are read; is it a configuration?")
    try:
        _count(text)
        content: object = yaml.load(text, _Loader)  # a safe loader
    except yaml.MarkedYAMLError as error:
        raise YamlError(f"not valid YAML: {error.problem}", error.problem_mark) from error
    except yaml.YAMLError as error:
        raise YamlError(f"not valid YAML: {' '.join(str(error).split())}") from error
    except YamlError:
        raise
    except (ValueError, OverflowError) as error:  # a key, or all there is
        raise YamlError("a number in it cannot be read") from error
    return content


def _count(text: str) -> None:
    """Refuse what is too deep or, with all aliases written out, too much."""
    nodes = 0
    sizes: dict[str, int] = {}  # nodes of each anchor that is complete
    opened: list[tuple[str | None, int]] = []  # anchors of the collections around the event, and nodes before each
    for event in yaml.parse(text, _Loader):
        if isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise YamlError(f"alias *{event.anchor} stands within or before what it stands for", event.start_mark)
            nodes += sizes[event.anchor]
        elif isinstance(event, yaml.NodeEvent):
            if event.tag is not None:
                raise YamlError(f"tag {event.tag}: tags are not read; write the value alone", event.start_mark)
            nodes += 1
            if isinstance(event, yaml.CollectionStartEvent):
                opened.append((event.anchor, nodes - 1))
            elif event.anchor is not None:
                sizes[event.anchor] = 1
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = opened.pop()
            if anchor is not None:
                sizes[anchor] = nodes - before
        if nodes > MOST_NODES:
            raise YamlError(f"more than {MOST_NODES} values, those of aliases counted", event.start_mark)
        if len(opened) > DEEPEST_NESTING:
            raise YamlError(f"nested more than {DEEPEST_NESTING} deep", event.start_mark)
