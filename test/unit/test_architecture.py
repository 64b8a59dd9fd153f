"""The layout's promises: imports run one way, ROS stays in nodes/, and what is public is typed and documented."""

import ast
import builtins
import functools
import inspect
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

import mbpam_ros

pytestmark = pytest.mark.xdist_group("architecture")  # each file is parsed and walked once
PACKAGE = Path(mbpam_ros.__file__).parent
MODULES = sorted(path for path in PACKAGE.rglob("*.py"))

GROUND = {"answer", "configuration", "errors", "geometry", "source_digest"}
MACHINE = GROUND | {"actuator", "pneumatics", "gripper"}
ALLOWED = {
    "errors": set(),
    "answer": set(),
    "bounded_yaml": {"errors"},
    "configuration": {"errors", "bounded_yaml"},
    "geometry": set(),
    "source_digest": set(),
    "actuator": GROUND,
    "pneumatics": GROUND | {"actuator"},
    "gripper": GROUND | {"actuator"},
    "description": MACHINE,
    "plant": MACHINE,
    "estimation": MACHINE,
    "grasp": MACHINE,
    "vision": MACHINE,
    "simulation": MACHINE | {"plant", "estimation", "grasp", "vision"},
    "terminal": set(),
    "study": MACHINE | {"plant", "estimation", "grasp", "vision", "simulation", "terminal"},
    "nodes": MACHINE | {"description", "plant", "estimation", "grasp", "vision", "terminal"},
    "commands": MACHINE
    | {"description", "plant", "estimation", "grasp", "vision", "simulation", "study", "nodes", "terminal"},
}
"""Which parts of the package a part may import, besides itself."""

STATEMENTS = (ast.stmt, ast.ExceptHandler, ast.match_case)
"""Nodes that may be, or hold, an import."""

ROS = ("rclpy", "_msgs", "_srvs", "_interfaces")


@functools.cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@functools.cache
def nodes_of(path: Path) -> list[ast.AST]:
    return list(ast.walk(tree_of(path)))


def part_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


@functools.cache
def imports_of(path: Path) -> set[str]:
    names = set()
    for node in nodes_of(path):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(node.module)
    return names


def module_name(path: Path) -> str:
    return ".".join(("mbpam_ros", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__")


NAMES = {module_name(path) for path in MODULES}


def named_by(node: ast.AST) -> set[str]:
    """What an import may load: modules, and names in them that may be modules."""
    if isinstance(node, ast.ImportFrom):
        return {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return {alias.name for alias in node.names} if isinstance(node, ast.Import) else set()


def modules_imported_at_once(path: Path) -> set[str]:
    """Modules of the package that are loaded with one: all its imports but those inside functions."""

    def found_in(part: ast.AST) -> set[str]:
        inside = [node for node in ast.iter_child_nodes(part) if isinstance(node, STATEMENTS)]
        at_once = [node for node in inside if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))]
        return set().union(*(named_by(node) | found_in(node) for node in at_once))

    return found_in(tree_of(path)) & NAMES


def modules_referred_to(path: Path) -> set[str]:
    """Modules of the package that are ever imported from one: at once, in a function, or by a name in a table."""
    nodes = nodes_of(path)
    named = {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    return set().union(named, *map(named_by, nodes)) & NAMES


def public_functions(path: Path) -> list[tuple[ast.FunctionDef, bool]]:
    """Public functions and methods, each with whether it may inherit its docstring."""
    tree = tree_of(path)
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")]
    bodies = [(tree.body, False), *((node.body, bool(node.bases)) for node in classes)]
    return [
        (node, inherits)
        for body, inherits in bodies
        for node in body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
    ]


def identity(path: Path) -> str:
    return str(path.relative_to(PACKAGE))


def modules_outside(*parts: str) -> list[Path]:
    return [path for path in MODULES if part_of(path) not in parts]


def test_imports_run_one_way():
    imported = {
        path: {name.split(".")[1] for name in imports_of(path) if name.startswith("mbpam_ros.")}
        for path in modules_outside("__init__")
    }
    against = {identity(path): parts - {part_of(path)} - ALLOWED[part_of(path)] for path, parts in imported.items()}
    assert not {path: parts for path, parts in against.items() if parts}


def test_ros_stays_in_nodes_and_commands():
    ros = {
        identity(path): [name for name in imports_of(path) if name.split(".")[0].endswith(ROS)]
        for path in modules_outside("nodes", "commands")
    }
    assert not {path: names for path, names in ros.items() if names}


def test_what_is_public_is_typed_and_documented():
    assert not [identity(path) for path in MODULES if not ast.get_docstring(tree_of(path))], "module docstring"
    for path in MODULES:
        for function, may_inherit in public_functions(path):
            where = f"{identity(path)}:{function.lineno} {function.name}"
            assert may_inherit or ast.get_docstring(function), f"{where}: docstring"
            arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
            untyped = [item.arg for item in arguments if item.annotation is None and item.arg not in ("self", "cls")]
            assert not untyped, f"{where}: no type for {', '.join(untyped)}"
            assert function.returns is not None, f"{where}: no return type"


def is_python_s_own_error(base: ast.expr) -> bool:
    kind = getattr(builtins, base.id, None) if isinstance(base, ast.Name) else None
    return isinstance(kind, type) and issubclass(kind, Exception)


def test_every_error_has_the_one_root():
    classes = [node for path in MODULES for node in nodes_of(path) if isinstance(node, ast.ClassDef)]
    rootless = {
        node.name
        for node in classes
        if not node.name.startswith("_")
        and any(is_python_s_own_error(base) for base in node.bases)
        and "MbpamError" not in [getattr(base, "id", None) for base in node.bases]
    }
    assert rootless == {"MbpamError"}


@pytest.mark.parametrize("reach", [modules_imported_at_once, modules_referred_to])
def test_no_module_leads_back_to_itself(reach):
    graph = {module_name(path): reach(path) - {module_name(path)} for path in MODULES}
    TopologicalSorter(graph).prepare()  # a CycleError names the modules of the circle


def test_the_public_module_list_is_read_from_the_package_under_test():
    assert inspect.getfile(mbpam_ros) == str(PACKAGE / "__init__.py")
    assert len(MODULES) > 30


@pytest.mark.parametrize(
    "module", ["mbpam_ros.gripper", "mbpam_ros.pneumatics.valve_guard", "mbpam_ros.grasp.responses"]
)
def test_what_the_valve_controller_needs_loads_neither_the_compiler_nor_scipy(module):
    """They would more than double the time until it can close a valve."""
    code = f"import sys, {module}; print(*sorted({{'numba', 'scipy'}} & set(sys.modules)))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert loaded.stdout.strip() == ""
