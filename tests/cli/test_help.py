"""First things that a newcomer sees: --help, --version, words that are no commands, completion."""

import re
from collections.abc import Iterator

import pytest
from typer.testing import CliRunner, Result

from companion import __version__
from companion.cli.catalogue import COMMANDS, ROOT
from companion.cli.commands import app
from companion.cli.lazy import Command, Group, imported

_WIDTH = 80


def every_command(group: Group = ROOT, above: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Command]]:
    """All commands with the words that lead to them."""
    for entries in group.panels.values():
        for name, entry in entries.items():
            if isinstance(entry, Group):
                yield from every_command(entry, (*above, name))
            else:
                yield (*above, name), entry


ALL = [pytest.param(words, entry, id=" ".join(words)) for words, entry in every_command()]


def typed(*words: str) -> Result:
    """Return what `companion WORDS` prints in a narrow terminal."""
    return CliRunner(env={"COLUMNS": str(_WIDTH), "TERM": "dumb"}).invoke(app, words)


def test_the_version_is_printed_before_any_command_is_asked_for() -> None:
    for words in (("--version",), ("--version", "status"), ("status", "--help")):
        said = typed(*words)
        assert said.exit_code == 0
        assert (said.output == f"{__version__}\n") == (words[0] == "--version")


def test_without_a_word_the_help_is_shown() -> None:
    assert typed().output == typed("--help").output == typed("help").output
    assert (typed("--help").exit_code, typed("help").exit_code) == (0, 0)


def test_help_names_every_command_in_one_line() -> None:
    lines = typed("--help").output.splitlines()
    for name, entry in COMMANDS.items():
        line = next(line for line in lines if line.strip().startswith(f"{name}  "))
        assert line.endswith(entry.summary), "it is not wrapped or cut off"


@pytest.mark.parametrize(("words", "entry"), ALL)
def test_the_help_of_a_command_is_whole_at_80_columns(words: tuple[str, ...], entry: Command) -> None:
    said = typed(*words, "--help")
    assert said.exit_code == 0
    assert said.output == typed("help", *words).output
    assert "<bool>" not in said.output
    assert "…" not in said.output
    lines = said.output.splitlines()
    example = {f"  companion {line}" for line in entry.examples}
    assert all(len(line) <= _WIDTH for line in lines if line not in example)
    assert example <= set(lines)
    assert len(entry.examples) >= 1
    assert all(len(line) <= _WIDTH for line in example)


@pytest.mark.parametrize(("words", "entry"), ALL)
def test_the_examples_are_commands_that_can_be_typed(words: tuple[str, ...], entry: Command) -> None:
    command = imported(words[-1], entry)
    for example in entry.examples:
        arguments = [word.strip("'") for word in re.findall(r"'[^']*'|\S+", example)]
        typed_words = " ".join(words).split()
        assert arguments[: len(typed_words)] == typed_words
        context = command.make_context(words[-1], arguments[len(typed_words) :])
        assert context.info_name == words[-1]


@pytest.mark.parametrize(
    ("word", "remedies"),
    [
        ("stop", ("companion hold", "companion land", "companion abort", "companion kill", "FALLS")),
        ("emergency", ("companion land", "companion kill")),
        ("abort!", ("Did you mean 'abort'?",)),
        ("HALT", ("companion land", "companion kill")),
        ("rtl", ("companion goto", "companion land")),
        ("fly", ("companion arm", "companion takeoff")),
        ("start", ("companion demo", "companion serve")),
        ("logs", ("companion records", "journalctl")),
        ("version", ("companion --version",)),
        ("takeof", ("Did you mean 'takeoff'?",)),
    ],
)
def test_a_word_that_is_no_command_leads_to_the_right_ones(word: str, remedies: tuple[str, ...]) -> None:
    said = typed(word)
    assert said.exit_code == 2
    assert f"No such command '{word}'." in said.output
    for remedy in remedies:
        assert remedy in said.output
    assert all(len(line) <= _WIDTH for line in said.output.splitlines())


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("companion tak", {"takeoff"}),
        ("companion help tak", {"takeoff"}),
        ("companion arms live p", {"play"}),
        ("companion track e", {"ellipse"}),
        ("companion controller p", {"pid", "practical", "precise", "paper", "paper-repaired"}),
        ("companion demo --controller pi", {"pid"}),
        ("companion demo --arms s", {"swing"}),
        ("companion arms play re", {"reach"}),
        ("companion arms live play ti", {"tips"}),
        ("companion simulate fig", {"figure8"}),
        ("companion dry-run --trajectory fi", {"figure8"}),
        ("companion experiments --experiments ellipse,f", {"ellipse,figure8"}),
        ("companion experiments --controllers pid,prac", {"pid,practical"}),
    ],
)
def test_completion_offers_names(line: str, offered: set[str]) -> None:
    words = line.split()
    completing = {"_COMPANION_COMPLETE": "complete_bash", "COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1)}
    shown = CliRunner(env=completing).invoke(app, prog_name="companion").output
    assert {word for word in shown.split() if not word.endswith((".toml", ".csv", "/"))} == offered


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("demo", "--laps", "x"), "Invalid value for '--laps': must be a whole number, not x"),
        (("simulate", "--demo", "--size", "7"), "Invalid value for '--size': must be at most 3, not 7"),
        (("takeoff", "--timeout", "nan"), "Invalid value for '--timeout': must be at least 0.1, not nan"),
        (("goto", "a", "1", "1"), "Invalid value for 'x': must be a number, not a"),
        (("arms", "grip", "opne"), "'opne' is not one of 'open', 'close'"),
    ],
)
def test_a_wrong_value_of_an_option_is_told_in_plain_words(words: tuple[str, ...], said: str) -> None:
    ended = typed(*words)
    assert ended.exit_code == 2
    assert said in ended.stderr
