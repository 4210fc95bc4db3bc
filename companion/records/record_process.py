"""Feeds the process that writes records, companion.records.writer; a TickSink that never waits."""

import contextlib
import errno
import json
import logging
import socket
import subprocess
import sys
import time
from collections import deque
from typing import Any

from companion.config.records_config import RecordsConfig
from companion.flight.tick import Tick
from companion.records.row_codec import BEGIN, EVENT, RowEncoder, batch
from companion.records.tick_columns import Frozen, frozen
from companion.supervisor.flight_state import Phase

LOG = logging.getLogger(__name__)

_BUFFER = 4_000_000
"""Asked of the kernel for the socket; it gives what net.core.wmem_max allows."""
_BATCH_TICKS = 10
"""Encoded together: in a loop that sleeps between its ticks the first one costs as much as the next five."""
_LARGEST_BATCH = 100_000
"""Bytes; of the rows of a law with a network of thousands each goes by itself."""
_LISTEN_FLUSHES = 5
_MOST_BACKLOG = 200
"""Messages: 20 s of a writer that gets no time, some 5 MB."""
_SENT_AT_ONCE = 4
_AGAIN_S = 5.0
"""Between two attempts to start a writer."""
_ON_GROUND = frozenset({Phase.STANDBY, Phase.DISARMED})
"""Phases in which a process may be started from the control loop: it takes milliseconds."""
_CLOSING_S = 10.0
_ENDING_S = 1.0
"""Time for a killed writer to end."""


class RecordSink:
    """A TickSink; `close` it, or let the process end: the file is whole in either case.

    What the writer cannot take is dropped and counted. A writer that died is started again before the next flight.
    """

    def __init__(self, config: RecordsConfig, vehicle: str) -> None:
        self._task = json.dumps({"records": config.model_dump(mode="json"), "vehicle": vehicle})
        self._encoder = RowEncoder()
        self._begin: dict[str, Any] = {"unix_offset_s": time.time() - time.monotonic(), "vehicle": vehicle}
        self._waiting: list[tuple[Tick, Frozen]] = []
        self._backlog: deque[bytes] = deque()
        self._flushes = 0
        self._ready = False
        self._started_s = 0.0
        self._link: socket.socket | None = None
        self._writer: subprocess.Popen[bytes] | None = None
        self._gone: list[subprocess.Popen[bytes]] = []
        """Writers that were given up and may still be ending."""
        self.dropped = 0
        self.failed: str | None = None
        """Reason why the flight is not recorded completely, known within half a second of ticks; None while it is.

        It stays until the next record begins, or another writer is there for it.
        """
        self._behind = False
        self.file = ""
        self._start_writer()

    @property
    def alive(self) -> bool:
        """True while the writer process is connected."""
        return self._link is not None

    @property
    def pid(self) -> int | None:
        """Process ID of the writer; None while there is none."""
        return self._writer.pid if self._writer is not None else None

    @property
    def ready(self) -> bool:
        """True once the writer accepts messages, about a second after its start."""
        self._listen()
        return self._ready

    def begin(self, metadata: dict[str, Any]) -> None:
        """Add metadata of the next flights: `config`, `controller`, `versions`, `seed`."""
        self._begin |= metadata
        self._send(BEGIN + json.dumps(self._begin).encode())

    def __call__(self, tick: Tick) -> None:
        """Queue one tick for the writer, without waiting."""
        if self._link is None:
            self.dropped += 1
            if tick.flight.phase in _ON_GROUND and tick.time_s - self._started_s > _AGAIN_S:
                self._start_writer()
            return
        self._waiting.append((tick, frozen(tick)))
        if len(self._waiting) >= _BATCH_TICKS:
            self._flush()

    def _flush(self) -> None:
        ticks, self._waiting = self._waiting, []
        try:
            messages = [message for tick, kept in ticks for message in self._encoder.messages(tick, kept)]
        except Exception as error:  # a tick that is like no other is not the end of the flight
            self._lose_ticks(len(ticks))
            self._warn(f"a tick cannot be recorded: {type(error).__name__}: {error}")
            return
        if sum(map(len, messages)) <= _LARGEST_BATCH:
            messages = [batch(messages)]
        if not all(self._send(message) for message in messages):
            self._lose_ticks(len(ticks))
        self._flushes += 1
        if self._flushes % _LISTEN_FLUSHES == 0:
            self._listen()

    def _lose_ticks(self, count: int) -> None:
        self.dropped += count
        self._encoder.retell()
        if self._link is not None and len(self._backlog) >= _MOST_BACKLOG and not self._behind:
            self._behind = True
            self._warn("the process that writes records does not keep up: a part of this flight is not recorded")

    def tell(self, kind: str, text: str, time_s: float) -> None:
        """Record an event: a command, a reply or a message of the service."""
        self._send(EVENT + json.dumps({"time_s": time_s, "kind": kind, "text": text}).encode())

    def close(self) -> None:
        """Wait until the flight's file is complete, at most 10 s."""
        self._flush()
        if self._link is not None:
            with contextlib.suppress(OSError):  # the writer is gone already, or hangs
                self._link.settimeout(_CLOSING_S)
                for message in self._backlog:
                    self._link.send(message)
                self._link.setblocking(False)
                self._link.shutdown(socket.SHUT_WR)
        self._backlog.clear()
        if self._writer is not None:
            try:
                self._writer.wait(_CLOSING_S)
            except subprocess.TimeoutExpired:
                self._warn(f"process {self._writer.pid} is still writing the record of the flight")
        self._listen()
        self._reap(_ENDING_S)
        if self._link is not None:
            self._link.close()
            self._link = None

    def _start_writer(self) -> None:
        if self._writer is not None:
            self._gone.append(self._writer)
            self._reap()
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        command = [sys.executable, "-m", "companion.records.writer", self._task]
        with theirs:
            self._writer = subprocess.Popen(command, stdin=theirs.fileno(), start_new_session=True)  # noqa: S603
        self._link, self._started_s, self._ready = ours, time.monotonic(), False
        self._backlog.clear()
        self._encoder.retell()
        self.begin({})

    def _send(self, message: bytes) -> bool:
        """Send a message, or queue it until the writer accepts it; False when the queue is full."""
        if len(self._backlog) >= _MOST_BACKLOG:
            self._send_backlog()  # the writer may have time again
        if self._link is None or len(self._backlog) >= _MOST_BACKLOG:
            return False
        self._backlog.append(message)
        self._send_backlog()
        return self._link is not None

    def _send_backlog(self) -> None:
        """Send some queued messages, as far as the socket has room, so that a delayed writer catches up in steps."""
        for _ in range(min(_SENT_AT_ONCE, len(self._backlog))):
            if self._link is None:
                return
            try:
                self._link.send(self._backlog[0])
            except BlockingIOError:
                return
            except OSError as error:
                if error.errno != errno.EMSGSIZE:
                    self._lose(error)
                    return
                self._warn(f"{len(self._backlog[0])} bytes at once are too large to be recorded: they are missing")
                self._encoder.retell()
            self._backlog.popleft()
        self._behind = self._behind and bool(self._backlog)

    def _lose(self, error: OSError) -> None:
        self._warn(f"the process that writes records has ended ({error.strerror}): this flight is not recorded further")
        if self._link is not None:
            self._link.close()
        self._link = None
        if self._writer is not None:
            self._writer.kill()  # it may only have closed its end
            self._writer.poll()

    def _reap(self, wait_s: float = 0.0) -> None:
        for writer in self._gone:
            with contextlib.suppress(subprocess.TimeoutExpired):
                writer.wait(wait_s)
        self._gone = [writer for writer in self._gone if writer.returncode is None]

    def _listen(self) -> None:
        while self._link is not None:
            try:
                said = json.loads(self._link.recv(65536) or b"null")
            except BlockingIOError:
                return
            except OSError as error:
                self._lose(error)
                return
            if said is None:
                return
            if not self._ready:
                self._ready, self.failed = True, None  # another writer, before a flight: nothing of it is lost
            if "notice" in said:
                LOG.warning("records: %s", said["notice"])
            if "warning" in said:
                self._warn(said["warning"])
            if "file" in said:
                self.file, self.failed = said["file"], None
                LOG.info("recording to %s", self.file)

    def _warn(self, text: str) -> None:
        self.failed = text
        LOG.warning("records: %s", text)
