"""The embedded broker for tests, in a process of its own: it can be stopped, hung and begun again on its port."""

import asyncio
import logging
import os
import signal
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from companion.adapters.broker.server import EmbeddedBroker
from tests.ports import free_port
from tests.warm import Begun, begin

_PATIENCE_S = 15.0


class BrokerProcess:
    """A broker started by `broker`; always on the same port."""

    def __init__(self) -> None:
        self.port: int = free_port()
        self._process: Begun | None = None

    def start(self) -> None:
        """Returns once it accepts connections."""
        self._process = begin("tests.broker", str(self.port))
        end_s = time.monotonic() + _PATIENCE_S
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port)).close()
            except OSError:
                if not self._process.is_alive() or time.monotonic() > end_s:
                    raise
                time.sleep(0.02)
            else:
                return

    def stop(self) -> None:
        """Kill the broker, as when its computer is switched off, except that the sockets are closed."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._process = None

    def hang(self) -> None:
        """Stop the broker without closing its sockets, so that it does not answer."""
        assert self._process is not None
        _send(self._process, signal.SIGSTOP)

    def go_on(self) -> None:
        """Let the broker continue after `hang`."""
        assert self._process is not None
        _send(self._process, signal.SIGCONT)


def _send(process: Begun, number: signal.Signals) -> None:
    assert process.pid is not None
    os.kill(process.pid, number)


@contextmanager
def broker() -> Iterator[BrokerProcess]:
    """A broker on a free port of this machine."""
    process = BrokerProcess()
    process.start()
    try:
        yield process
    finally:
        process.stop()


async def serve(port: int) -> None:
    """Run the broker until the process is killed."""
    await EmbeddedBroker("127.0.0.1", port).start()
    await asyncio.Event().wait()


if __name__ == "__main__":
    logging.getLogger("amqtt").setLevel(logging.CRITICAL)  # a client that dies is part of the tests, and no news
    asyncio.run(serve(int(sys.argv[1])))
