"""Notifications to systemd (sd_notify), and log lines in its journal's format (sd-daemon).

Both protocols are a few bytes, so that no library is needed: sd_notify(3), systemd.exec(5), sd-daemon(3).
"""

import contextlib
import logging
import os
import queue
import socket
import sys
import threading
import time
from collections.abc import Iterator, MutableMapping
from typing import TextIO

_BEATS = 4.0
"""Signs of life in one period of systemd's watchdog: a lost or late one does no harm."""
_AGAIN_S = 10.0
"""A repeated message is suppressed for this time."""
_WAITING_LINES = 1000
"""Lines queued for a journal that does not read; further ones are dropped."""
_LAST_WORDS_S = 1.0
_PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))
_DEBUG = 7
"""Level of syslog(3)."""


class Notifier:
    """Notifications to systemd: ready, status, alive. No call waits or fails; without systemd it does nothing."""

    def __init__(self, address: str | None, period_s: float | None) -> None:
        """`address` is a path, or @ and a name of the abstract namespace; `period_s` is the watchdog's, None: none."""
        self._address = None if address is None else ("\0" + address[1:] if address.startswith("@") else address)
        self.period_s = period_s
        self._due_s = 0.0
        self._status: str | None = None
        self._owed = ""

    @classmethod
    def from_environment(cls, environment: MutableMapping[str, str] = os.environ) -> "Notifier":
        """Return the notifier from NOTIFY_SOCKET and WATCHDOG_USEC, and remove them: children must not inherit them."""
        address = environment.pop("NOTIFY_SOCKET", None)
        period_us, process = environment.pop("WATCHDOG_USEC", ""), environment.pop("WATCHDOG_PID", "")
        watched = period_us.isdecimal() and int(period_us) > 0 and process in {"", str(os.getpid())}
        known = address is not None and address[:1] in {"/", "@"} and len(address) > 1
        return cls(address if known else None, 1e-6 * int(period_us) if watched and known else None)

    def ready(self, status: str) -> None:
        """Report that commands are accepted from now on; `systemctl start` returns."""
        self._owed, self._status = "READY=1\n", None
        self.status(status)

    def status(self, status: str) -> None:
        """Report one line for `systemctl status`; a repeated one is not sent."""
        if status != self._status and self._say(f"STATUS={_line(status)}"):
            self._status = status

    def stopping(self, status: str) -> None:
        """Report that the service is stopping, which may take a landing."""
        self._owed, self._status = "STOPPING=1\n", None
        self.status(status)

    def alive(self) -> None:
        """Report that the control loop runs. May be called in every cycle: it sends four times in a period."""
        if self.period_s is None:
            return
        now_s = time.monotonic()
        if now_s >= self._due_s and self._say("WATCHDOG=1"):
            self._due_s = now_s + self.period_s / _BEATS

    def _say(self, message: str) -> bool:
        """Send without blocking, True when it was sent; a message that must not be lost is repeated with the next."""
        if self._address is None:
            return False
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as speaking:
                speaking.setblocking(False)
                speaking.sendto((self._owed + message).encode(), self._address)
        except OSError:
            return False
        self._owed = ""
        return True


def _line(text: str) -> str:
    return " ".join(text.split())


class JournalFormatter(logging.Formatter):
    """`<4>health_step: text`: the priority as sd-daemon(3) has it, and one line an event.

    Of an exception the line names kind and text; its traceback follows with the priority of debugging.
    """

    def format(self, record: logging.LogRecord) -> str:
        """Return the record's lines, each with its priority."""
        priority = next((number for level, number in _PRIORITIES if record.levelno >= level), _DEBUG)
        line = f"<{priority}>{_place(record)}: {_line(record.getMessage())}"
        if not record.exc_info or record.exc_info[1] is None:
            return line
        error = record.exc_info[1]
        details = self.formatException(record.exc_info).splitlines()
        line += _line(f": {type(error).__name__}: {error}")
        return "\n".join((line, *(f"<{_DEBUG}>{detail}" for detail in details)))


class TerminalFormatter(logging.Formatter):
    """`12:03:04 warning health_step: text`, for a person who looks on."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the record's line, and the traceback of its exception."""
        clock = time.strftime("%H:%M:%S", time.localtime(record.created))
        line = f"{clock} {record.levelname.lower()} {_place(record)}: {_line(record.getMessage())}"
        return line if not record.exc_info else f"{line}\n{self.formatException(record.exc_info)}"


def _place(record: logging.LogRecord) -> str:
    return record.name.rpartition(".")[2]


class QuietHandler(logging.Handler):
    """Writes records to `stream` on a thread of its own: a journal that does not read must not stop the control loop.

    A record that says the same as the one before is counted for 10 s and not written; records that find no room are
    dropped and counted.
    """

    def __init__(self, stream: TextIO, formatter: logging.Formatter) -> None:
        super().__init__()
        self.setFormatter(formatter)
        self._stream = stream
        self._lines: queue.Queue[str | None] = queue.Queue(_WAITING_LINES)
        self._last: tuple[str, int, str] | None = None
        self._last_s = 0.0
        self._repeated = self._dropped = 0
        self._writer = threading.Thread(target=self._write, name="log", daemon=True)
        self._writer.start()

    def emit(self, record: logging.LogRecord) -> None:
        """Queue the record for the writer thread without blocking; count repetitions of the last message."""
        try:
            said = (record.name, record.levelno, record.getMessage())
            if said == self._last and record.created - self._last_s < _AGAIN_S:
                self._repeated += 1
                return
            self._tell_repeated()
            self._last, self._last_s = said, record.created
            self._put(self.format(record))
        except Exception as error:  # a mistake in a message is no reason to fall
            self._put(f"a message for the log cannot be written: {error!r}")

    def close(self) -> None:
        """Write what waits, for a second at most."""
        self._tell_repeated()
        with contextlib.suppress(queue.Full):
            self._lines.put(None, timeout=_LAST_WORDS_S)
            self._writer.join(_LAST_WORDS_S)
        super().close()

    def _tell_repeated(self) -> None:
        if self._repeated and self._last is not None:
            name, level, _ = self._last
            text = f"the last line {self._repeated} more times"
            self._put(self.format(logging.LogRecord(name, level, "", lineno=0, msg=text, args=None, exc_info=None)))
        self._repeated = 0

    def _put(self, lines: str) -> None:
        if self._dropped:
            lines = f"{lines} ({self._dropped} lines before this one are lost)"
        try:
            self._lines.put_nowait(lines)
        except queue.Full:
            self._dropped += 1
        else:
            self._dropped = 0

    def _write(self) -> None:
        while (lines := self._lines.get()) is not None:
            with contextlib.suppress(OSError, ValueError):  # the reader is gone, or the stream is closed
                self._stream.write(lines + "\n")
                self._stream.flush()


def to_journal(stream: TextIO) -> bool:
    """Return True when `stream` is connected to systemd's journal: JOURNAL_STREAM names its device and inode."""
    try:
        seen = os.fstat(stream.fileno())
    except (OSError, ValueError):
        return False
    return os.environ.get("JOURNAL_STREAM") == f"{seen.st_dev}:{seen.st_ino}"


@contextlib.contextmanager
def logging_to(stream: TextIO = sys.stderr, level: int = logging.INFO) -> Iterator[QuietHandler]:
    """Log the companion's messages from `level` on, and others' warnings, in the format of the stream."""
    handler = QuietHandler(stream, JournalFormatter() if to_journal(stream) else TerminalFormatter())
    root, ours = logging.getLogger(), logging.getLogger("companion")
    root.addHandler(handler)
    before, ours_before = root.level, ours.level
    root.setLevel(logging.WARNING)
    ours.setLevel(level)
    try:
        yield handler
    finally:
        root.removeHandler(handler)
        root.setLevel(before)
        ours.setLevel(ours_before)
        handler.close()
