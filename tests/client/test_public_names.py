"""The names that scripts rely on: they change knowingly, and docs/python.md has them as they are."""

import re
from pathlib import Path

import pytest

import companion.client as package
from companion.client import sync
from companion.client.errors import VehicleError
from companion.core.errors import CompanionError
from tests.client.api_table import rows

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")


def test_the_public_names_are_these() -> None:
    assert package.__all__ == [
        "Arms", "Check", "CompanionError", "ConfigError", "Curve", "FailedError", "Happened", "Kind", "NoServiceError",
        "Progress", "RejectedError", "State", "TimedOutError", "UnknownOutcomeError", "Vehicle", "VehicleError",
        "connect", "connect_all", "together", "vehicles",
    ]  # fmt: skip
    assert sync.__all__ == ["Arms", "Vehicle", "connect", "connect_all", "together", "vehicles"]


@pytest.mark.parametrize("name", package.__all__)
def test_every_public_name_can_be_imported_and_is_explained(name: str) -> None:
    assert getattr(package, name).__name__ == name
    assert re.search(rf"`{name}\b", PAGE), f"docs/python.md does not have {name}"


def test_other_names_are_not_there() -> None:
    with pytest.raises(AttributeError, match=r"module 'companion.client' has no attribute 'Console'"):
        _ = package.Console


def test_the_errors_are_one_tree() -> None:
    errors = [getattr(package, name) for name in package.__all__ if name.endswith("Error")]
    assert all(issubclass(error, CompanionError) for error in errors)
    replies = [package.NoServiceError, package.RejectedError, package.FailedError, package.UnknownOutcomeError]
    assert all(issubclass(error, VehicleError) for error in replies)
    assert issubclass(package.TimedOutError, TimeoutError | package.UnknownOutcomeError)


def test_the_tables_of_the_page_are_the_code() -> None:
    """Print them again: `python -m tests.client.api_table`."""
    wanted = rows()
    missing = [row for row in wanted if row not in PAGE.splitlines()]
    assert missing == []
    tables = PAGE.partition("## The vehicle")[2].partition("\n## ")[0]
    listed = [row for row in tables.splitlines() if row.startswith("| `")]
    assert [row for row in listed if row not in wanted] == []


def test_the_example_in_the_page_is_the_file() -> None:
    code = (ROOT / "examples" / "hello_flight.py").read_text(encoding="utf-8")
    assert code.partition('"""\n\n')[2] in PAGE
    assert len(code.splitlines()) <= 25
