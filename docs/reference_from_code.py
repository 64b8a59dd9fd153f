"""Pages of the reference that are made from the code, so that they cannot differ from it.

====================== ============================================================================
directive              shows
====================== ============================================================================
``package NAME``       every module of a package, from the docstrings
``tables-of MODULE``   the tables in the docstring of a module
``node NAME``          what a node does, and its parameters, topics and services
``topics``             all topics
``services``           all services
``transitions``        what each request does in each state of a grasp
``verbs``              all verbs of ``mbpam`` with what ``--help`` prints
====================== ============================================================================
"""

from __future__ import annotations

import argparse
import importlib
import os
import pkgutil
import re
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import TypeVar

from docutils import nodes
from docutils.parsers.rst import Parser
from docutils.statemachine import StringList
from docutils.utils import new_document
from sphinx.application import Sphinx
from sphinx.ext.autodoc.mock import mock
from sphinx.util.docutils import SphinxDirective
from sphinx.util.nodes import nested_parse_with_titles

ROOT = "mbpam_ros"
HELP_COLUMNS = 100

_ARRAY = re.compile(r"~?numpy\.ndarray\[~?tuple\[~?typing\.Any, \.\.\.\], ~?numpy\.dtype\[~?numpy\.(\w+)\]\]")
_MARKUP = re.compile(r"\||\*+(?=args|kwargs)")


class Package(SphinxDirective):
    """A section for each module of a package; of the root for those in no package. In ``.rst`` files only."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Let autodoc document each module."""
        name = self.arguments[0]
        paths = getattr(importlib.import_module(name), "__path__", [])
        found = pkgutil.iter_modules(paths, f"{name}.") if name == ROOT else pkgutil.walk_packages(paths, f"{name}.")
        modules = [
            each.name for each in found if not (name == ROOT and each.ispkg) and not each.name.endswith("__main__")
        ]
        lines = [f".. automodule:: {name}", *(["   :no-members:"] if modules else []), ""]
        for module in modules:
            title = module.removeprefix(f"{name}.")
            lines += [title, "-" * len(title), "", f".. automodule:: {module}", ""]
        section = nodes.section()
        section.document = self.state.document
        nested_parse_with_titles(self.state, StringList(lines, source=name), section)
        return section.children


class TablesOf(SphinxDirective):
    """The tables in a module's docstring."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Parse the docstring and keep its tables."""
        module = importlib.import_module(self.arguments[0])
        self.env.note_dependency(module.__file__)
        document = new_document(module.__name__, self.state.document.settings)
        Parser().parse(module.__doc__, document)
        tables = list(document.findall(nodes.table))
        if not tables:
            raise self.error(f"no table in the docstring of {module.__name__}")
        return [table.deepcopy() for table in tables]


class GripperNode(SphinxDirective):
    """A node: its docstring, parameters, topics and services."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Show what ``--help`` prints, as tables."""
        from mbpam_ros.nodes.interface import SERVICES, TOPICS

        name = self.arguments[0]
        module = importlib.import_module(f"mbpam_ros.nodes.{name}")
        self.env.note_dependency(module.__file__)
        told = module.__doc__.strip().partition(": ")[2]
        shown: list[nodes.Node] = [nodes.paragraph("", told[:1].upper() + told[1:])]
        shown += _titled("Parameters", ("name", "default", "range", "meaning"), map(_parameter_row, module.PARAMETERS))
        for title, side in (("Listens to", "subscribers"), ("Publishes", "publishers")):
            topics = [topic for topic in TOPICS if name in getattr(topic, side)]
            rows = [(f"``{each.name}``", f"``{each.message_type}``", each.meaning) for each in topics]
            shown += _titled(title, ("topic", "type", "meaning"), rows)
        services = [each for each in SERVICES if each.node == name]
        rows = [(f"``{each.name}``", f"``{each.service_type}``", each.meaning) for each in services]
        return shown + _titled("Serves", ("service", "type", "meaning"), rows)


class Topics(SphinxDirective):
    """All topics."""

    def run(self) -> list[nodes.Node]:
        """Show them as one table."""
        from mbpam_ros.nodes import interface

        self.env.note_dependency(interface.__file__)
        rows = [
            (
                f"``{topic.name}``" + (", latched" if topic.latched else ""),
                f"``{topic.message_type}``",
                ", ".join(topic.publishers),
                ", ".join(topic.subscribers),
                topic.meaning,
            )
            for topic in interface.TOPICS
        ]
        return [_table(("topic", "type", "from", "to", "meaning"), rows)]


class Services(SphinxDirective):
    """All services."""

    def run(self) -> list[nodes.Node]:
        """Show them as one table."""
        from mbpam_ros.nodes import interface

        self.env.note_dependency(interface.__file__)
        rows = [
            (f"``{each.name}``", f"``{each.service_type}``", each.node, each.meaning) for each in interface.SERVICES
        ]
        return [_table(("service", "type", "node", "meaning"), rows)]


class Transitions(SphinxDirective):
    """What each request does in each state of a grasp, and two that arrive together."""

    def run(self) -> list[nodes.Node]:
        """Ask the arbiter."""
        from mbpam_ros.grasp import transitions

        self.env.note_dependency(transitions.__file__)
        alone = [(row.state, f"``{row.request}``", _outcome(row), row.answer) for row in transitions.transitions()]
        pairs = [
            tuple(f"``{each}``" for each in row.request.split(", then ")) + (_outcome(row), row.answer)
            for row in transitions.together()
        ]
        shown = _titled("One request", ("state", "request", "done, then", "answer"), alone)
        return shown + _titled(
            "Two at once, at an idle gripper", ("first", "second", "done, then", "answer to the second"), pairs
        )


def _outcome(row: object) -> str:
    return f"{'yes' if row.accepted else 'refused'}, {row.then}"


class Verbs(SphinxDirective):
    """All verbs of ``mbpam``."""

    def run(self) -> list[nodes.Node]:
        """A section each, with its help."""
        from mbpam_ros.commands import mbpam

        self.env.note_dependency(mbpam.__file__)
        os.environ["COLUMNS"] = str(HELP_COLUMNS)
        with mock(self.config.autodoc_mock_imports):
            return list(self._sections("mbpam", mbpam.VERBS))

    def _sections(self, program: str, verbs: Sequence) -> Iterable[nodes.Node]:
        for verb in verbs:
            name = f"{program} {verb.name}"
            module = importlib.import_module(f"mbpam_ros.commands.{verb.module}")
            self.env.note_dependency(module.__file__)
            section = nodes.section("", nodes.title("", name), ids=[nodes.make_id(name)], names=[name])
            section += nodes.paragraph("", verb.summary[:1].upper() + verb.summary[1:] + ".")
            if hasattr(module, "VERBS"):
                section += self._sections(name, module.VERBS)
            else:
                parser = argparse.ArgumentParser(
                    name, description=module.__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
                )
                module.add_arguments(parser)
                section += nodes.literal_block("", parser.format_help(), language="text")
            yield section


def _parameter_row(parameter: object) -> tuple[str, str, str, str]:
    default = parameter.default
    shown = str(default).lower() if isinstance(default, bool) else str(default) or "''"
    limits = "" if parameter.low is None else f"{parameter.low:g} .. {parameter.high:g}"
    changeable = "; may be set while it runs" if parameter.changeable else ""
    return (
        f"``{parameter.name}``",
        f"``{shown}`` ({type(default).__name__})",
        limits,
        parameter.description + changeable,
    )


def _titled(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> list[nodes.Node]:
    rows = list(rows)
    return [nodes.rubric("", title), _table(header, rows)] if rows else []


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> nodes.table:
    """A table of cells in which ````...```` is literal."""
    group = nodes.tgroup(cols=len(header))
    group += [nodes.colspec(colwidth=1) for _ in header]
    group += nodes.thead("", _row(header))
    group += nodes.tbody("", *(_row(row) for row in rows))
    return nodes.table("", group, classes=["colwidths-auto"])


def _row(cells: Sequence[str]) -> nodes.row:
    return nodes.row("", *(nodes.entry("", nodes.paragraph("", "", *_inline(cell))) for cell in cells))


def _inline(text: str) -> list[nodes.Node]:
    parts = re.split(r"(``.*?``)", text)
    return [nodes.literal("", part.strip("`")) if part.startswith("``") else nodes.Text(part) for part in parts if part]


def show_formulas_as_they_stand(
    app: Sphinx, what: str, name: str, target: object, options: object, lines: list[str]
) -> None:
    """Make docstrings, which are written to be read in an editor, into reStructuredText.

    A block that is set in after an empty line is a formula or a command; a bar elsewhere is an absolute value.
    """
    shown: list[str] = []
    block_indent, last_indent, last_text = 0, 0, ""
    after_empty = in_block = False
    for line in lines:
        indent = len(line) - len(line.lstrip())
        if not line.strip():
            shown.append(line)
            after_empty = True
            continue
        if in_block and indent < block_indent:
            in_block = False
        if not in_block and after_empty and indent > last_indent:
            in_block, block_indent = True, indent
            if not last_text.endswith("::"):
                shown += [" " * last_indent + "::", ""]
        shown.append(line if in_block else _escaped(line))
        after_empty = False
        if not in_block:
            last_indent, last_text = indent, line.rstrip()
    # Napoleon takes what stands before a colon in the first line about a value for the value's type.
    lines[:] = ["", *shown] if what in ("attribute", "data", "property") else shown


def shorten_types(
    app: Sphinx, what: str, name: str, target: object, options: object, signature: str | None, returns: str | None
) -> tuple[str | None, str | None]:
    """Write arrays as the code does."""
    return _with_short_arrays(signature), _with_short_arrays(returns)


def _with_short_arrays(annotation: str | None) -> str | None:
    return annotation and _ARRAY.sub(r"NDArray[\1]", annotation)


def leave_out_object(app: Sphinx, doctree: nodes.document) -> None:
    """Name bases only where they say something."""
    for paragraph in list(doctree.findall(nodes.paragraph)):
        if paragraph.astext() == "Bases: object":
            paragraph.parent.remove(paragraph)


def _escaped(line: str) -> str:
    """Escape bars, and the stars of arguments, outside of literal text."""
    parts = re.split(r"(``.*?``)", line)
    return "".join(part if part.startswith("``") else _MARKUP.sub(r"\\\g<0>", part) for part in parts)


def leave_type_variables(app: Sphinx, env: object, node: nodes.Element, content: nodes.Element) -> nodes.Element | None:
    """Show a type variable, which has no place of its own to refer to, as it is."""
    module, _, name = str(node.get("reftarget")).rpartition(".")
    if not module.startswith(ROOT):
        return None
    with mock(app.config.autodoc_mock_imports), suppress(ImportError):
        if isinstance(getattr(importlib.import_module(module), name, None), TypeVar):
            return content
    return None


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives, and what makes the docstrings readable."""
    app.add_directive("package", Package)
    app.add_directive("tables-of", TablesOf)
    app.add_directive("node", GripperNode)
    app.add_directive("topics", Topics)
    app.add_directive("services", Services)
    app.add_directive("transitions", Transitions)
    app.add_directive("verbs", Verbs)
    app.connect("autodoc-process-docstring", show_formulas_as_they_stand, priority=100)  # before Napoleon
    app.connect("autodoc-process-signature", shorten_types)
    app.connect("doctree-read", leave_out_object)
    app.connect("missing-reference", leave_type_variables)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
