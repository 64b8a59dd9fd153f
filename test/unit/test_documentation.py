"""The documents: what they name and link to exists, the commands they tell to run too, and their Python runs."""

import argparse
import importlib
import re
from pathlib import Path

import pytest

from mbpam_ros.commands.mbpam import VERBS
from mbpam_ros.nodes.interface import NODES, SERVICES, TOPICS
from mbpam_ros.nodes.start import EXECUTABLES

ROOT = Path(__file__).parents[2]
PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
CODE = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)#]+)(?:#[^)]*)?\)")
OWN_FOLDERS = ("config/", "docs/", "examples/", "mbpam_ros/", "test/")


def identity(path: Path) -> str:
    return str(path.relative_to(ROOT))


def blocks(page: Path) -> list[tuple[str, str]]:
    """Language and text of every block, in order."""
    return [(language, code) for _, language, code in CODE.findall(page.read_text(encoding="utf-8"))]


def inline_code(page: Path) -> list[str]:
    return re.findall(r"`([^`\n]+)`", CODE.sub("", page.read_text(encoding="utf-8")))


def command_lines(page: Path) -> list[list[str]]:
    """What a page tells to run, in blocks and within sentences, as words."""
    joined = "\n".join(code for language, code in blocks(page) if language == "sh").replace("\\\n", " ")
    lines = [re.sub(r"\s(#|&).*", "", line) for line in [*joined.splitlines(), *inline_code(page)]]
    words = [line.replace(".venv/bin/", "").split() for line in lines]
    return [line for line in words if len(line) > 1 and re.fullmatch(r"mbpam|mbpam_[a-z]\w*|ros2|make|python", line[0])]


def parser_of(words: list[str]) -> tuple[argparse.ArgumentParser | None, list[str]]:
    """The parser of the verb that the words begin with, and what follows it; no parser where only verbs are named."""
    verbs = VERBS
    for index, word in enumerate(words):
        verb = next((each for each in verbs if each.name == word), None)
        assert verb is not None, f"no verb {word}"
        module = importlib.import_module(f"mbpam_ros.commands.{verb.module}")
        if not hasattr(module, "VERBS"):
            parser = argparse.ArgumentParser(exit_on_error=False)
            module.add_arguments(parser)
            return parser, words[index + 1 :]
        verbs = module.VERBS
    return None, []


def check_mbpam(words: list[str]) -> None:
    if words[0] in ("VERB", "--help"):
        return
    parser, rest = parser_of(words)
    if parser is not None:
        known = parser._option_string_actions
        assert not [word for word in rest if word.startswith("--") and word.partition("=")[0] not in known], words


def check_node(name: str, words: list[str]) -> None:
    assert name in (*EXECUTABLES, "demo", "NODE"), name
    if name in ("demo", "NODE"):
        return
    given = [after for word, after in zip(words, words[1:], strict=False) if word == "-p"]
    for argument in given:
        parameter = argument.partition(":=")[0]
        node, _, own = parameter.rpartition(":")
        if own == "use_sim_time" or own.startswith("qos_overrides."):
            continue
        nodes = [node] if node else list(NODES) if name == "bringup" else [name]
        known = {each.name for node in nodes for each in importlib.import_module(f"mbpam_ros.nodes.{node}").PARAMETERS}
        assert own in known, argument


def check_ros2(words: list[str]) -> None:
    if words[:2] == ["run", "mbpam_ros"]:
        check_node(words[2], words[3:])
    elif words[:2] == ["service", "call"]:
        name, kind = re.sub(r"^/(left/|right/)?", "", words[2]), words[3]
        assert (name, kind) in {(each.name, each.service_type) for each in SERVICES}, words
    elif words[:2] == ["topic", "echo"]:
        named = {word.lstrip("/") for word in words[2:] if not word.startswith("-")}
        assert named <= {name for topic in TOPICS for name in topic.names}, words


def check_make(words: list[str]) -> None:
    targets = re.findall(r"^([a-z][a-z-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    named = [word for word in words if "=" not in word and word != "..."]
    assert set(named) <= set(targets), words


def test_the_readme_can_be_read_in_ten_minutes():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 150


@pytest.mark.parametrize("page", PAGES, ids=identity)
def test_what_a_page_links_to_or_names_is_there(page):
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    assert "\n<<<<<<< " not in text, "a merge left both sides"
    linked = [target for target in LINK.findall(text) if "://" not in target]
    assert not [target for target in linked if not (page.parent / target).exists()]
    named = [code for code in inline_code(page) if code.startswith(OWN_FOLDERS) and " " not in code]
    assert not [path for path in named if not (ROOT / path).exists()]


@pytest.mark.parametrize("page", PAGES, ids=identity)
def test_what_a_page_tells_to_run_is_there(page):
    for program, *words in command_lines(page):
        if program == "mbpam":
            check_mbpam(words)
        elif program == "make":
            check_make(words)
        elif program == "ros2":
            check_ros2(words)
        elif program.startswith("mbpam_") and program not in ("mbpam_ros", "mbpam_NODE"):
            check_node(program.removeprefix("mbpam_"), words)
        elif program == "python" and words[0].startswith("examples/"):
            assert (ROOT / words[0]).is_file(), words


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in PAGES if "```python" in page.read_text("utf-8")], ids=identity)
def test_the_python_of_a_page_runs_and_prints_what_is_shown_after_it(page, capsys):
    names, python_before = {"__name__": "page"}, False
    for language, code in blocks(page):
        if language == "python":
            exec(compile(code, str(page), "exec"), names)
        elif python_before and not language:
            assert capsys.readouterr().out == code
        python_before = language == "python"


def test_every_folder_of_the_package_has_a_page_in_the_reference():
    folders = {path.name for path in (ROOT / "mbpam_ros").iterdir() if (path / "__init__.py").is_file()}
    assert {path.stem for path in (ROOT / "docs" / "reference" / "python").glob("*.rst")} == {*folders, "top"}


def test_which_pythons_will_do_is_said_alike():
    said = {name: (ROOT / name).read_text(encoding="utf-8") for name in ("setup.py", "Makefile", "CONTRIBUTING.md")}
    low = re.search(r'python_requires=">=(3\.\d+)"', said["setup.py"]).group(1)
    refused = re.search(r"\((3), (\d+)\) <= sys\.version_info\[:2\] <= \((3), (\d+)\)", said["Makefile"]).groups()
    assert ".".join(refused[:2]) == low
    spoken = f"{low} to {'.'.join(refused[2:])}"
    assert f"Python {spoken} is needed" in said["Makefile"] and f"({spoken})" in said["CONTRIBUTING.md"]
    assert f"Python {spoken}" in (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
