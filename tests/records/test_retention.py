"""Rotation by size and age, names, and a file that takes all it is given."""

import os
from pathlib import Path

import pytest

from companion.adapters.system.disk import free_mb
from companion.config.records_config import RecordsConfig
from companion.records.retention import KEPT, Retention, Unbreakable

NOW_S = 1.8e9
DAY_S = 86400.0


def retention(folder: Path, **config: float) -> Retention:
    return Retention(RecordsConfig(folder=str(folder), **config), "one")  # type: ignore[arg-type]


def record(folder: Path, name: str, age_days: float, size: int = 1_000_000) -> Path:
    path = folder / name
    path.write_bytes(bytes(size))
    os.utime(path, (NOW_S - age_days * DAY_S,) * 2)
    return path


def test_the_oldest_flights_go_until_the_rest_fits(tmp_path: Path) -> None:
    paths = [record(tmp_path, f"2026010{day}-120000-one.mcap", 10.0 - day) for day in range(1, 6)]
    assert retention(tmp_path, keep_mb=3.0).rotate(now_s=NOW_S) == paths[:2]
    assert sorted(tmp_path.glob("*.mcap")) == paths[2:]


def flown_daily(folder: Path, first_day: int, last_day: int) -> list[Path]:
    """A record a month, named and written so many days before now; oldest first."""
    days = range(first_day, last_day, -30)
    return [record(folder, f"20250101-{day:06d}-one.mcap", float(day), 1) for day in days]


def test_flights_too_old_go_whatever_their_size(tmp_path: Path) -> None:
    paths = flown_daily(tmp_path, 600, 0)
    old = [path for path in paths if NOW_S - path.stat().st_mtime > 365.0 * DAY_S]
    assert len(old) == 8
    assert retention(tmp_path).rotate(now_s=NOW_S) == old
    assert retention(tmp_path).rotate(now_s=NOW_S) == []


def test_a_clock_years_ahead_deletes_nothing_by_age(tmp_path: Path) -> None:
    paths = flown_daily(tmp_path, 330, 0)
    ahead_s = NOW_S + 3650.0 * DAY_S
    assert retention(tmp_path).rotate(now_s=ahead_s) == []
    flown_ahead = record(tmp_path, "20350101-120000-one.mcap", -3650.0, 1)
    assert retention(tmp_path).rotate(now_s=ahead_s + DAY_S) == []
    assert retention(tmp_path).rotate(now_s=NOW_S + DAY_S) == [], "and the clock is right again"
    assert all(path.exists() for path in [*paths, flown_ahead])


def test_the_newest_records_stay_whatever_their_age_and_the_clock(tmp_path: Path) -> None:
    paths = flown_daily(tmp_path, 400, 40)
    assert retention(tmp_path, keep_days=1.0).rotate(now_s=NOW_S) == paths[:-KEPT]
    assert len(list(tmp_path.glob("*.mcap"))) == KEPT


def test_what_was_written_while_the_clock_was_not_set_has_no_age(tmp_path: Path) -> None:
    unset = [record(tmp_path, f"1970010{day}-000200-one.mcap", NOW_S / DAY_S - day, 1) for day in (1, 2)]
    flown_daily(tmp_path, 360, 0)
    assert retention(tmp_path).rotate(now_s=NOW_S) == []
    assert all(path.exists() for path in unset)


def test_which_is_the_oldest_is_told_by_the_order_of_the_flights_and_not_by_the_clock(tmp_path: Path) -> None:
    right = record(tmp_path, "20260101-120000-one.mcap", 5.0)
    assert retention(tmp_path).rotate(writing=right, now_s=NOW_S) == []
    unset = record(tmp_path, "19700101-000200-one.mcap", NOW_S / DAY_S)
    assert retention(tmp_path).rotate(writing=unset, now_s=120.0) == []
    third = record(tmp_path, "20260103-120000-one.mcap", 3.0)
    assert retention(tmp_path, keep_mb=2.0).rotate(writing=third, now_s=NOW_S) == [right]
    assert unset.exists()


def test_the_newest_flight_stays_even_when_it_alone_is_too_much(tmp_path: Path) -> None:
    first, second = record(tmp_path, "20260101-120000-one.mcap", 5.0), record(tmp_path, "20260102-120000-one.mcap", 4.0)
    assert retention(tmp_path, keep_mb=0.5).rotate(now_s=NOW_S) == [first]
    assert second.exists()


def test_a_record_that_cannot_be_deleted_does_not_keep_the_flight_from_being_recorded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    first, second, third = (record(tmp_path, f"2026010{day}-120000-one.mcap", 5.0 - day) for day in range(3))

    delete = Path.unlink

    def refuse(path: Path, missing_ok: bool = False) -> None:
        if path == first:
            raise PermissionError(13, "Permission denied", str(path))
        delete(path)

    monkeypatch.setattr(Path, "unlink", refuse)
    assert retention(tmp_path, keep_mb=1.0).rotate(now_s=NOW_S) == [second]
    assert third.exists()
    assert "cannot be deleted: Permission denied" in caplog.text


def test_what_is_not_a_record_of_ours_or_is_being_written_never_goes(tmp_path: Path) -> None:
    mine = record(tmp_path, "20250101-120000-one.mcap", 400.0)
    kept = [
        record(tmp_path, "thesis.mcap", 4000.0),
        record(tmp_path, "20250101-120000-one.npz", 4000.0),
        record(tmp_path, "20260101-120000-other.mcap", 0.0001),
    ]
    assert retention(tmp_path, keep_mb=0.1).rotate(writing=mine, now_s=NOW_S) == []
    assert all(path.exists() for path in [mine, *kept])


def test_a_name_that_is_taken_is_not_taken_again(tmp_path: Path) -> None:
    first = retention(tmp_path / "new").new_path(NOW_S)
    first.touch()
    second = retention(tmp_path / "new").new_path(NOW_S)
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
    assert free_mb(tmp_path / "not" / "yet") == pytest.approx(free_mb(tmp_path), rel=0.1)
