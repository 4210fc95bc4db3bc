"""The free space where records go, also of a disk that does not answer."""

import math
import os
import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from companion.adapters.system.disk import DiskWatch

PERIOD_S = 0.02
PATIENCE_S = 10.0


def wait_until(holds: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not holds():
        assert time.monotonic() < end_s
        time.sleep(0.002)


def test_nothing_is_recorded_nothing_can_be_full() -> None:
    with DiskWatch(None, PERIOD_S) as disk:
        time.sleep(4.0 * PERIOD_S)
        assert disk.free_mb() == math.inf


def test_the_space_of_the_disk_that_will_hold_the_folder(tmp_path: Path) -> None:
    with DiskWatch(tmp_path / "not" / "yet", PATIENCE_S) as disk:
        wait_until(lambda: disk.free_mb() < math.inf)
        assert disk.free_mb() == pytest.approx(shutil.disk_usage(tmp_path).free * 1e-6, rel=0.1)


def test_it_goes_on_asking_until_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real, asked = os.statvfs(tmp_path), [0]

    def counted(path: Path) -> os.statvfs_result:
        asked[0] += 1
        return real

    monkeypatch.setattr(os, "statvfs", counted)
    with DiskWatch(tmp_path, PERIOD_S):
        wait_until(lambda: asked[0] > 5)
    time.sleep(10.0 * PERIOD_S)
    asked_then = asked[0]
    time.sleep(5.0 * PERIOD_S)
    assert asked[0] == asked_then


def test_the_newest_answer_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    free = [300]  # blocks of 1 MB for everyone; root could use more

    def told(path: Path) -> os.statvfs_result:
        return os.statvfs_result((1, 1_000_000, 1000, 900, free[0], 0, 0, 0, 0, 255))

    monkeypatch.setattr(os, "statvfs", told)
    with DiskWatch(tmp_path, PERIOD_S) as disk:
        wait_until(lambda: disk.free_mb() == 300.0)
        free[0] = 150
        wait_until(lambda: disk.free_mb() == 150.0)


def test_a_disk_that_does_not_answer_has_no_room_and_nobody_waits_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, answers = os.statvfs(tmp_path), threading.Event()
    answers.set()

    def hanging(path: Path) -> os.statvfs_result:
        answers.wait(PATIENCE_S)
        return real

    monkeypatch.setattr(os, "statvfs", hanging)
    with DiskWatch(tmp_path, PERIOD_S) as disk:
        wait_until(lambda: 0.0 < disk.free_mb() < math.inf)
        answers.clear()
        wait_until(lambda: disk.free_mb() == 0.0)
        assert not answers.is_set()  # the read is still out
        answers.set()
        wait_until(lambda: disk.free_mb() > 0.0)


def test_a_disk_that_gives_an_error_has_no_room_and_says_so_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(path: Path) -> os.statvfs_result:
        raise OSError(116, "Stale file handle")

    monkeypatch.setattr(os, "statvfs", broken)
    with DiskWatch(tmp_path, PERIOD_S) as disk:
        wait_until(lambda: disk.free_mb() == 0.0)
        time.sleep(3.0 * PERIOD_S)
    assert [record.message.split(": ")[-1] for record in caplog.records] == ["[Errno 116] Stale file handle"]
