"""The real mosquitto on a free port of this machine, with configuration lines of the test's own."""

import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

_PATIENCE_S = 15.0
_PROGRAM = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
needs_mosquitto = pytest.mark.skipif(
    _PROGRAM is None and "CI" not in os.environ, reason="mosquitto is not installed (apt install mosquitto)"
)
"""Nothing is passed over where the whole is to be tested."""


@contextmanager
def mosquitto(folder: Path, *lines: str) -> Iterator[int]:
    """Its port, once it accepts connections; `lines` go below the listener's, in `folder`."""
    assert _PROGRAM is not None
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
    config = folder / "mosquitto.conf"
    config.write_text("\n".join([f"listener {port} 127.0.0.1", "set_tcp_nodelay true", *lines, ""]))
    with subprocess.Popen([_PROGRAM, "-c", str(config)], stderr=subprocess.PIPE) as process:
        try:
            _await(port, process)
            yield port
        finally:
            process.terminate()
            process.communicate()


def _await(port: int, process: "subprocess.Popen[bytes]") -> None:
    end_s = time.monotonic() + _PATIENCE_S
    while True:
        try:
            return socket.create_connection(("127.0.0.1", port)).close()
        except OSError:
            if process.poll() is not None or time.monotonic() > end_s:
                raise
            time.sleep(0.02)
