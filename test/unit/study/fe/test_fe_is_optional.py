import ast
from pathlib import Path

import mbpam_ros

PACKAGE = Path(mbpam_ros.__file__).parent
FE = PACKAGE / "study" / "fe"
USERS = {FE, PACKAGE / "commands" / "fe", PACKAGE / "study" / "muscle", PACKAGE / "commands" / "muscle"}


def imports_of(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module


def test_nothing_but_their_verbs_and_the_building_of_muscles_needs_finite_elements():
    others = [path for path in PACKAGE.rglob("*.py") if not USERS & set(path.parents)]
    assert len(others) > 30
    for path in others:
        wanted = [name for name in imports_of(path) if name.startswith(("felupe", "pypardiso", "mbpam_ros.study.fe"))]
        assert not wanted, path


def test_only_the_solid_body_talks_to_felupe():
    users = {path.name for path in FE.glob("*.py") if any(name == "felupe" for name in imports_of(path))}
    assert users == {"solid_body.py"}
