"""The process that writes: `python -m companion.records.writer JSON`, with a socket as its standard input.

It ends when the other side does, in whatever way, and then the flight's file is whole. Signals that are meant for the
service do not end it. One thread empties the socket, so that a slow disk never lets it run full; the other one writes.
"""

import json
import logging
import queue
import socket
import sys
import threading
from collections.abc import Callable
from typing import Any

import foxglove
from foxglove import Context

from companion.adapters.system.realtime import beside_the_loop
from companion.config.records_config import RecordsConfig
from companion.records.flight_file import FlightFiles
from companion.records.retention import Retention
from companion.records.row_codec import BATCH, BEGIN, EVENT, LAYOUT, ROW, START, unbatched

LOG = logging.getLogger(__name__)

LARGEST = 4_000_000
_MOST_WAITING = 2_000
"""Messages in memory, some 50 MB: minutes of a disk that does not answer."""


def main() -> None:
    """Write until the other side is gone."""
    beside_the_loop()
    task = json.loads(sys.argv[1])
    config = RecordsConfig.model_validate_json(json.dumps(task["records"]))
    link = socket.socket(fileno=sys.stdin.fileno())
    context = Context()
    report = _reporter(link)
    files = FlightFiles(Retention(config, task["vehicle"]), context, report)
    server = _serve(config, context, task["vehicle"], report)
    report({"ready": True})
    waiting: queue.Queue[bytes] = queue.Queue(_MOST_WAITING)
    threading.Thread(target=_read, args=(link, waiting), name="read", daemon=True).start()
    _write(files, waiting, report)
    if server is not None:
        server.stop()


def _reporter(link: socket.socket) -> Callable[[dict[str, Any]], None]:
    def report(said: dict[str, Any]) -> None:
        try:
            link.send(json.dumps(said).encode(), socket.MSG_DONTWAIT)
        except OSError:  # the service is gone, or does not listen
            print(f"records: {said}", file=sys.stderr, flush=True)

    return report


def _serve(config: RecordsConfig, context: Context, name: str, report: Callable[[dict[str, Any]], None]) -> Any:
    if config.live_port == 0:
        return None
    try:
        return foxglove.start_server(name=name, host=config.live_host, port=config.live_port, context=context)
    except (OSError, RuntimeError, ValueError) as error:
        report({"notice": f"nothing to watch on {config.live_host}:{config.live_port}, see [records]: {error}"})
        return None


def _read(link: socket.socket, waiting: queue.Queue[bytes]) -> None:
    while message := _received(link):
        waiting.put(message)  # and when that is full the socket runs full, too, which the service sees
    waiting.put(b"")


def _received(link: socket.socket) -> bytes:
    try:
        return link.recv(LARGEST)
    except OSError:
        return b""


def _write(files: FlightFiles, waiting: queue.Queue[bytes], report: Callable[[dict[str, Any]], None]) -> None:
    do = {BEGIN: files.begin, LAYOUT: files.learn, START: files.start, ROW: files.row, EVENT: files.event}
    failed = False
    while message := waiting.get():
        try:
            for one in unbatched(message) if message[:1] == BATCH else (message,):
                do[one[:1]](one)
        except Exception as error:  # one message that cannot be kept is not the end of the others
            if not failed:
                report({"warning": f"the record lacks something: {type(error).__name__}: {error}"})
                LOG.exception("a message cannot be kept")
            failed = True
    files.close()


if __name__ == "__main__":
    main()
