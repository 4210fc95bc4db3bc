"""Values that several commands are given: seeds, names, and the places where they are told to write."""

from pathlib import Path

import pytest

from companion.cli.operator.exit_codes import names_of, seeds_of
from companion.cli.output import check_output
from companion.core.interfaces import ConfigError


@pytest.mark.parametrize(
    ("text", "seeds"), [("3:5", (3, 4, 5)), ("0", (0,)), ("7:7", (7,)), ("1:1000", range(1, 1001))]
)
def test_seeds(text: str, seeds: tuple[int, ...]) -> None:
    assert seeds_of(text) == tuple(seeds)


@pytest.mark.parametrize("text", ["", "a", "5:1", "-1:2", "1:", ":3", "1:2:3", "1.5", "1:1001", "²:3"])
def test_no_seeds(text: str) -> None:
    with pytest.raises(ConfigError, match=f"^--seeds {text}: "):
        seeds_of(text)


def test_names_stand_between_commas_with_spaces_or_without() -> None:
    assert names_of("ellipse, figure8 ,my file.toml,", "experiments") == ("ellipse", "figure8", "my file.toml")
    with pytest.raises(ConfigError, match=r"^--experiments ' , ': give at least one name or TOML file$"):
        names_of(" , ", "experiments")


def test_trying_to_write_leaves_no_trace_but_the_folders(tmp_path: Path) -> None:
    there = tmp_path / "there.json"
    there.write_text("{}", encoding="utf-8")
    check_output(tmp_path / "out", there)
    check_output(None, tmp_path / "new" / "s.json")
    assert there.read_text(encoding="utf-8") == "{}"
    assert sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")) == ["new", "out", "there.json"]
