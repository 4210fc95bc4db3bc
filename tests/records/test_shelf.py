"""Rotation by size and age, names, and a file that takes all it is given."""

import os
from pathlib import Path

import pytest

from companion.config_records import RecordsConfig
from companion.records.shelf import Shelf, Unbreakable

NOW_S = 1.8e9
DAY_S = 86400.0


def shelf(folder: Path, **config: float) -> Shelf:
    return Shelf(RecordsConfig(folder=str(folder), **config), "one")  # type: ignore[arg-type]


def record(folder: Path, name: str, age_days: float, size: int = 1_000_000) -> Path:
    path = folder / name
    path.write_bytes(bytes(size))
    os.utime(path, (NOW_S - age_days * DAY_S,) * 2)
    return path


def test_the_oldest_flights_go_until_the_rest_fits(tmp_path: Path) -> None:
    paths = [record(tmp_path, f"2026010{day}-120000-one.mcap", 10.0 - day) for day in range(1, 6)]
    assert shelf(tmp_path, keep_mb=3.0).rotate(now_s=NOW_S) == paths[:2]
    assert sorted(tmp_path.iterdir()) == paths[2:]


def test_flights_too_old_go_whatever_their_size(tmp_path: Path) -> None:
    old, new = record(tmp_path, "20250101-120000-one.mcap", 400.0, 1), record(tmp_path, "20260101-120000-one.mcap", 1.0)
    assert shelf(tmp_path).rotate(now_s=NOW_S) == [old]
    assert new.exists()


def test_what_is_not_a_record_of_ours_or_is_being_written_never_goes(tmp_path: Path) -> None:
    mine = record(tmp_path, "20250101-120000-one.mcap", 400.0)
    kept = [
        record(tmp_path, "thesis.mcap", 4000.0),
        record(tmp_path, "20250101-120000-one.npz", 4000.0),
        record(tmp_path, "20260101-120000-other.mcap", 0.0001),
    ]
    assert shelf(tmp_path, keep_mb=0.1).rotate(writing=mine, now_s=NOW_S) == []
    assert all(path.exists() for path in [mine, *kept])


def test_a_name_that_is_taken_is_not_taken_again(tmp_path: Path) -> None:
    first = shelf(tmp_path / "new").new_path(NOW_S)
    first.touch()
    second = shelf(tmp_path / "new").new_path(NOW_S)
    assert second.name == first.name.replace("-one", "-one-2")


def test_a_file_that_cannot_be_written_to_takes_everything_and_says_so_once(tmp_path: Path) -> None:
    said: list[str] = []
    with Unbreakable(tmp_path / "a", said.append) as file:
        assert file.write(b"abc") == 3
        read_only = os.open(tmp_path / "a", os.O_RDONLY)
        os.dup2(read_only, file.fileno())
        assert file.write(b"def") == 3
        assert file.write(b"ghi") == 3
        assert said == ["the disk refuses: Bad file descriptor"]
        assert file.broken
    os.close(read_only)
    assert (tmp_path / "a").read_bytes() == b"abc"


def test_a_folder_that_is_not_there_yet_has_its_disks_room(tmp_path: Path) -> None:
    assert shelf(tmp_path / "not" / "yet").free_mb() == pytest.approx(shelf(tmp_path).free_mb(), rel=0.1)
