"""The cache on disk never serves machine code of sources that have changed."""

import ast
import importlib.util
import re
from pathlib import Path

import pytest

from mbpam_ros.plant.mechanics import step
from mbpam_ros.plant.mechanics.step import kernel_sources
from mbpam_ros.source_digest import source_digest

STEP = Path(step.__file__)


def imported_by(source: Path) -> set[Path]:
    """Files of this package that a file imports names or modules from."""
    names = set()
    for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("mbpam_ros"):
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    found = set()
    for name in names:
        try:
            spec = importlib.util.find_spec(name)
        except ModuleNotFoundError:  # a name of a module that is no package
            continue
        if spec is not None and Path(spec.origin).name != "__init__.py":
            found.add(Path(spec.origin))
    return found


def all_imported_by(source: Path) -> set[Path]:
    found, left = set(), [source]
    while left:
        file = left.pop()
        if file not in found:
            found.add(file)
            left += imported_by(file)
    return found


def test_all_compiled_code_of_the_step_is_watched():
    compiled = {file for file in all_imported_by(STEP) if re.search("njit|@kernel", file.read_text(encoding="utf-8"))}
    assert STEP in compiled and len(compiled) > 6
    # The muscle's design only has the geometry that its arrays are made from; what it compiles, a step does not call.
    assert {file for file in compiled if "actuator" not in file.parts} <= set(kernel_sources())


@pytest.mark.parametrize("place", range(len(kernel_sources())), ids=[file.name for file in kernel_sources()])
def test_a_change_of_any_of_these_files_is_another_key(place, tmp_path):
    copies = []
    for number, source in enumerate(kernel_sources()):
        copies.append(tmp_path / f"{number}.py")
        copies[-1].write_bytes(source.read_bytes())
    before = source_digest(copies)
    assert before == source_digest(kernel_sources())
    copies[place].write_bytes(copies[place].read_bytes() + b"\n")
    assert source_digest(copies) != before
