"""Commands that the documents tell one to type, and the links between them."""

import re
import shlex
from pathlib import Path

import pytest

from companion.cli.catalogue import COMMANDS
from companion.cli.lazy import Group, imported
from companion.config.companion_config import load_config
from companion.config.trajectory_files import read_waypoints
from companion.trajectories.room_check import check_trajectory

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
_BLOCK = re.compile(r"```console\n(.*?)```", re.DOTALL)
_INLINE = re.compile(r"`(?:\.venv/bin/)?companion ([a-z][^`]*)`")
_TYPED = re.compile(r"^\$ (?:[^#\n]* )?(?:\.venv/bin/)?companion (.*)$", re.MULTILINE)
_LINK = re.compile(r"\]\(([^)#:]+)(?:#[^)]*)?\)")
_ANCHOR = re.compile(r"\]\(([^)#:]*\.md)#([^)]+)\)")
_HEADING = re.compile(r"^#+ (.*)$", re.MULTILINE)


def lines_of(page: Path) -> list[str]:
    """Return the words behind `companion` in a page: those in blocks, then those in sentences."""
    text = page.read_text(encoding="utf-8")
    blocks = [line for block in _BLOCK.findall(text) for line in _TYPED.findall(block)]
    return [*blocks, *(line.replace("\n", " ") for line in _INLINE.findall(text))]


def options_of(words: list[str]) -> tuple[set[str], list[str]]:
    """Options of the command that `words` begin with, and the words behind it."""
    entry, name = COMMANDS[words[0]], words[0]
    rest = words[1:]
    while isinstance(entry, Group):
        inside = {key: one for entries in entry.panels.values() for key, one in entries.items()}
        if not rest or rest[0] not in inside:
            return {"--help"}, rest
        name, entry, rest = rest[0], inside[rest[0]], rest[1:]
    return {option for one in imported(name, entry).params for option in (*one.opts, *one.secondary_opts)}, rest


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_command_of_a_page_exists_with_its_options(page: Path) -> None:
    for line in lines_of(page):
        words = shlex.split(line.partition(" #")[0].replace("\u2026", "").replace("'", "").rstrip("\\"))
        if words[0] in {"COMMAND", "stop", "rtl", "help"}:
            continue
        assert words[0] in COMMANDS, f"{page.name}: companion {line}"
        known, rest = options_of(words)
        given = {word.partition("=")[0] for word in rest if word.startswith("--")} - {"--help"}
        assert given <= known, f"{page.name}: companion {line}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_of_a_page_leads_to_a_file(page: Path) -> None:
    for target in _LINK.findall(page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), f"{page.name}: {target}"


def anchor_of(heading: str) -> str:
    """Return the anchor that a heading gets where the pages are shown: lower case, hyphens, no other signs."""
    return re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_anchor_of_a_page_is_a_heading(page: Path) -> None:
    for target, anchor in _ANCHOR.findall(page.read_text(encoding="utf-8")):
        headings = _HEADING.findall((page.parent / target).read_text(encoding="utf-8"))
        assert anchor in map(anchor_of, headings), f"{page.name}: {target}#{anchor}"


def test_every_document_is_in_the_index() -> None:
    index = (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    for page in sorted((ROOT / "docs").glob("*.md")):
        assert page.name == "README.md" or f"]({page.name})" in index, f"{page.name} is in no list"
    assert "docs/README.md" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_readme_and_glossary_stay_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 100
    entries = (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").count("\n| ") - 2
    assert entries <= 40, "words that fewer pages use are explained there"


def test_the_formula_in_the_demo_page_gives_a_path_that_may_be_flown(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "demo.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    exec(code.replace('"my-path.csv"', repr(str(tmp_path / "my-path.csv"))), {})
    room = load_config(ROOT / "config" / "demo.toml").room
    check_trajectory(read_waypoints(tmp_path / "my-path.csv"), room, "my-path.csv")
