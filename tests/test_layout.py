"""The layout of docs/architecture.md, held against the tree."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PRODUCT = ("companion", "mock_autopilot")
ENTRY_POINTS = {
    "companion": {"__init__.py", "law_api.py"},
    "mock_autopilot": {"__init__.py", "__main__.py", "config.py", "config_errors.py", "simulator.py", "world.py"},
}
MOST_FILES = 21
RIDDLES = ("What", "Whether", "How", "Where", "Of", "From", "As")
RIDDLE = re.compile(rf"""["']\s*[,:]*(?:{"|".join(RIDDLES)})\b""")
"""A string that begins with one, docstring or not."""


def packages(root: str) -> set[str]:
    """Return the packages directly in a root package."""
    return {path.parent.name for path in (ROOT / root).glob("*/__init__.py")}


def listed(root: str) -> set[str]:
    """Return the packages that the table of docs/architecture.md gives for a root package."""
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    (table,) = re.findall(rf"\| package in `{root}/` \|.*\n\|[-| ]+\n((?:\|.*\n)+)", page)
    return set(re.findall(r"^\| `(\w+)/?` \|", table, re.MULTILINE))


@pytest.mark.parametrize("root", PRODUCT)
def test_the_table_of_packages_is_the_tree(root: str) -> None:
    assert listed(root) - {path.stem for path in (ROOT / root).glob("*.py")} == packages(root)


@pytest.mark.parametrize("root", PRODUCT)
def test_no_module_lies_flat_but_entry_points(root: str) -> None:
    assert {path.name for path in (ROOT / root).glob("*.py")} == ENTRY_POINTS[root]


@pytest.mark.parametrize("root", PRODUCT)
def test_no_folder_is_crowded(root: str) -> None:
    folders = {path.parent for path in (ROOT / root).rglob("*.py")}
    assert [str(folder) for folder in folders if len(list(folder.glob("*.py"))) > MOST_FILES] == []


def docstrings(node: ast.AST) -> Iterator[tuple[int, str]]:
    """Return line and text of each docstring of a module, its classes and its functions."""
    if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        text = ast.get_docstring(node)
        if text:
            yield getattr(node, "lineno", 1), text
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.stmt | ast.excepthandler):  # no expression holds a docstring
            yield from docstrings(child)


def test_no_docstring_begins_with_a_riddle() -> None:
    folders = (*PRODUCT, "benchmarks", "tests", "examples")
    files = {
        path: path.read_text(encoding="utf-8") for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))
    }
    found = [
        f"{path.relative_to(ROOT)}:{line}: {text.splitlines()[0]}"
        for path, code in files.items()
        if RIDDLE.search(code)  # parsing all of them would take ten seconds
        for line, text in docstrings(ast.parse(code))
        if text.split()[0].strip(",:") in RIDDLES
    ]
    assert found == []


@cache
def modules_of_the_tree() -> list[str]:
    """Return the path of every Python file of the project."""
    folders = (*PRODUCT, "benchmarks", "config", "examples", "tests")
    return [path.as_posix() for folder in folders for path in (ROOT / folder).rglob("*.py")]


PAGES = [*sorted((ROOT / "docs").glob("*.md")), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_module_that_a_page_names_is_there(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    files = set(re.findall(r"`((?:\w+/)*\w+\.py)`", text))
    gone = {file for file in files if not any(path.endswith(f"/{file}") for path in modules_of_the_tree())}
    modules = set(re.findall(r"python -m ((?:companion|mock_autopilot|tests|benchmarks)[\w.]*)", text))
    paths = {module: ROOT / module.rstrip(".").replace(".", "/") for module in modules}
    gone |= {name for name, path in paths.items() if not (path.with_suffix(".py").is_file() or path.is_dir())}
    assert not gone


def test_every_name_in_the_table_of_changes_is_in_its_file() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    section = page.partition("## Where to change what")[2].partition("\n## ")[0]
    assert section
    gone = []
    for file, names in re.findall(r"`([\w/]+\.py)`(?: \(((?:`\w+`(?:, | and )?)+))?", section):
        path = next((ROOT / root / file for root in ("", "companion") if (ROOT / root / file).is_file()), None)
        text = path.read_text(encoding="utf-8") if path else ""
        gone += [file] if "/" in file and path is None else []
        gone += [f"{file}: {name}" for name in re.findall(r"`(\w+)`", names) if not re.search(rf"\b{name}\b", text)]
    assert gone == []
