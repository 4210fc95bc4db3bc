"""The log as the journal reads it, and as a person does."""

import contextlib
import io
import logging
import os
import re
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

import pytest

from companion.adapters.system import systemd

LOG = logging.getLogger("companion.tests.journal")


@contextmanager
def to_journal(monkeypatch: pytest.MonkeyPatch, file: Path, level: int = logging.INFO) -> Iterator[None]:
    """Log to a file in place of the journal's socket: both have a device and an inode."""
    with file.open("w") as stream:
        seen = os.fstat(stream.fileno())
        monkeypatch.setenv("JOURNAL_STREAM", f"{seen.st_dev}:{seen.st_ino}")
        with systemd.logging_to(stream, level):
            yield


def test_every_level_has_its_priority_and_every_event_one_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with to_journal(monkeypatch, tmp_path / "log", logging.DEBUG):
        LOG.debug("a detail")
        LOG.info("armed after %.1f s", 1.25)
        LOG.warning("two\n  lines")
        LOG.error("mocap silent")
        LOG.critical("over")
    assert (tmp_path / "log").read_text().splitlines() == [
        "<7>journal: a detail",
        "<6>journal: armed after 1.2 s",
        "<4>journal: two lines",
        "<3>journal: mocap silent",
        "<2>journal: over",
    ]


def raised() -> ValueError:
    """An exception with a traceback."""
    try:
        int("no such\nmotion")
    except ValueError as error:
        return error
    raise AssertionError


def test_an_exception_is_one_line_and_its_traceback_is_for_who_asks(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with to_journal(monkeypatch, tmp_path / "log"):
        LOG.error("the arms stop", exc_info=raised())
    first, *rest = (tmp_path / "log").read_text().splitlines()
    assert first == "<3>journal: the arms stop: ValueError: invalid literal for int() with base 10: 'no such\\nmotion'"
    assert rest[0] == "<7>Traceback (most recent call last):"
    assert len(rest) > 2
    assert all(line.startswith("<7>") for line in rest)


def test_what_repeats_is_counted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with to_journal(monkeypatch, tmp_path / "log"):
        for _ in range(5):
            LOG.warning("frame lost")
        LOG.info("landed")
        LOG.info("landed")
    assert (tmp_path / "log").read_text().splitlines() == [
        "<4>journal: frame lost",
        "<4>journal: the last line 4 more times",
        "<6>journal: landed",
        "<6>journal: the last line 1 more times",
    ]


def test_the_same_event_later_is_an_event() -> None:
    stream = io.StringIO()
    handler = systemd.QuietHandler(stream, systemd.JournalFormatter())
    for after_s in (0.0, 9.0, 11.0):
        event = record("frame lost")
        event.created = 1.8e9 + after_s
        handler.emit(event)
    handler.close()
    assert stream.getvalue() == "<6>x: frame lost\n<6>x: the last line 1 more times\n<6>x: frame lost\n"


def test_others_are_heard_from_warnings_on_and_ourselves_as_asked(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with to_journal(monkeypatch, tmp_path / "log"):
        logging.getLogger("some.library").info("chatter")
        logging.getLogger("some.library").warning("trouble")
        LOG.debug("a detail")
    assert (tmp_path / "log").read_text() == "<4>library: trouble\n"


def test_a_person_reads_time_and_level(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JOURNAL_STREAM", "1:2")  # of a shell's parent, not of this stream
    stream = io.StringIO()
    with systemd.logging_to(stream):
        LOG.warning("mocap silent")
    assert stream.getvalue()[8:] == " warning journal: mocap silent\n"


def test_a_journal_that_does_not_read_holds_nobody_up() -> None:
    reading, writing = os.pipe()
    read: list[str] = []

    def read_all() -> None:
        with os.fdopen(reading) as journal:
            read.extend(journal)

    fill(writing)
    reader = threading.Thread(target=read_all)
    with os.fdopen(writing, "w") as stream:
        handler = systemd.QuietHandler(stream, systemd.JournalFormatter())
        for number in range(3000):  # more than may wait
            handler.emit(record(f"event {number}"))
        reader.start()
        while handler._lines.qsize():
            time.sleep(0.001)
        handler.emit(record("here again"))
        handler.close()
    reader.join()
    said = [line for line in read if line != "\n"]
    assert re.fullmatch(r"<6>x: here again \(\d+ lines before this one are lost\)\n", said[-1])
    lost = sum(int(told[1]) for line in said if (told := re.search(r"\((\d+) lines before this", line)))
    assert lost + len(said) == 3001


def fill(pipe: int) -> None:
    """Fill the socket until writing would block."""
    os.set_blocking(pipe, False)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(pipe, b"\n")
    os.set_blocking(pipe, True)


def record(text: str) -> logging.LogRecord:
    return logging.LogRecord("companion.x", logging.INFO, "", 0, text, None, None)


def test_a_message_that_cannot_be_formatted_is_said_and_nobody_falls() -> None:
    stream = io.StringIO()
    handler = systemd.QuietHandler(stream, systemd.JournalFormatter())
    handler.emit(logging.LogRecord("companion.x", logging.INFO, "", 0, "%d", ("no number",), None))
    handler.emit(record("goes on"))
    handler.close()
    first, second = stream.getvalue().splitlines()
    assert "cannot be written" in first
    assert second == "<6>x: goes on"


@pytest.mark.parametrize("stream", [sys.__stderr__, io.StringIO()])
def test_without_a_journal_nothing_goes_to_it(stream: TextIO, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("JOURNAL_STREAM", raising=False)
    assert not systemd.to_journal(stream)
