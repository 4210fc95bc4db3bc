"""A process that cannot end in order ends by force, and never while the vehicle flies; native prints go to the log."""

import contextlib
import logging
import os
import sys
import time
from types import SimpleNamespace

import pytest

from companion.adapters.system.last_resort import LastResort
from companion.adapters.system.log_lines import LineLimit
from companion.adapters.system.native_output import standard_output_to_log, unraisable_to_log


class Shortage:
    """A last resort at a time of ours, and what it did."""

    def __init__(self) -> None:
        self.now_s, self.ended = 1000.0, list[int]()
        self.resort = LastResort(self.ended.append, lambda: self.now_s)
        self.resort.close()  # its thread: the tests look themselves

    def lack(self, for_s: float) -> None:
        """Report a lack of memory once a second."""
        for _ in range(round(for_s)):
            self.resort.lacks_memory()
            self.now_s += 1.0
        self.resort.lacks_memory()

    def ended_after(self, wait_s: float = 0.0) -> list[int]:
        self.now_s += wait_s
        self.resort.look()
        return self.ended


@pytest.fixture
def short() -> Shortage:
    return Shortage()


def test_a_shortage_of_memory_that_lasts_ends_the_process(short: Shortage) -> None:
    short.lack(for_s=4.0)
    assert short.ended_after() == []
    short.lack(for_s=2.0)
    assert short.ended_after() == [1]


def test_a_shortage_that_is_over_ends_nothing(short: Shortage) -> None:
    short.lack(for_s=8.0)
    assert short.ended_after(wait_s=2.5) == []
    short.lack(for_s=4.0)
    assert short.ended_after() == []


def test_nothing_ends_a_vehicle_in_the_air(short: Shortage, caplog: pytest.LogCaptureFixture) -> None:
    short.resort.flying = lambda: True
    short.lack(for_s=100.0)
    assert short.ended_after() == []
    assert "land; the process ends when the vehicle is down" in caplog.text
    short.resort.flying = lambda: False
    assert short.ended_after() == [1]


def test_who_is_told_to_end_lands_first_and_then_has_its_time(short: Shortage) -> None:
    short.resort.begin_deadline()
    short.resort.flying = lambda: True
    assert short.ended_after(wait_s=60.0) == []
    short.resort.flying = lambda: False
    short.lack(for_s=10.0)
    assert short.ended_after(wait_s=9.0) == [], "in order, if it can"
    assert short.ended_after(wait_s=2.0) == [1]


def test_what_a_native_library_prints_is_a_line_of_the_log(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    with standard_output_to_log():
        os.write(1, b"\x1b[31mraw \xff\n" + b"x" * 3 + b"\n")
        with contextlib.suppress(BlockingIOError):
            for _ in range(200):
                os.write(1, b"flood\n")
        end_s = time.monotonic() + 10.0
        while "flood" not in caplog.text and time.monotonic() < end_s:
            time.sleep(0.01)
    lines = [record.getMessage() for record in caplog.records]
    assert lines[:3] == ["printed: \ufffd[31mraw \ufffd", "printed: xxx", "printed: flood"]
    assert len(lines) <= 20


def test_standard_output_is_itself_again_afterwards(capfd: pytest.CaptureFixture[str]) -> None:
    with standard_output_to_log():
        pass
    print("for the shell", flush=True)
    assert capfd.readouterr().out == "for the shell\n"


def test_an_exception_in_a_callback_is_logged_a_few_times_and_counted(caplog: pytest.LogCaptureFixture) -> None:
    lacked: list[None] = []
    said = SimpleNamespace(exc_type=MemoryError, exc_value=None, err_msg="Exception ignored on calling ctypes callback")
    with unraisable_to_log(lambda: lacked.append(None)):
        for _ in range(1000):
            sys.unraisablehook(said)
    assert len(lacked) == 1000
    assert len(caplog.records) == 20
    assert caplog.records[0].getMessage() == "MemoryError, Exception ignored on calling ctypes callback"
    assert sys.unraisablehook is not None


def test_lines_beyond_the_limit_are_counted() -> None:
    limit = LineLimit(most=2, window_s=10.0)
    assert [limit.take(now_s) for now_s in (0.0, 1.0, 2.0, 3.0, 11.0)] == [0, 0, None, None, 2]
