"""One companion at a time on one autopilot: two streams of setpoints would fight over the vehicle.

The lock is a Unix socket in Linux' abstract namespace, which is no file: the kernel frees it however the process ends,
nothing stale can stay behind, and it is the same for every user of this machine, wherever their temporary files are.
"""

import hashlib
import os
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager

from companion.core.interfaces import AutopilotError, ConfigError

_WAITING = 4096
"""Others that may ask who holds it; they are never answered, their connection alone tells."""
_CREDENTIALS = struct.Struct("iII")
"""struct ucred: process, user, group."""


@contextmanager
def instance_lock(url: str) -> Iterator[None]:
    """Hold the lock of the autopilot's link; AutopilotError naming the process that already does.

    `url` is a MAVSDK URL; two spellings of one UDP port, or of one serial device, are one link.
    """
    with _held(_link(url)) as holder:
        if holder is not None:
            raise AutopilotError(f"another companion{holder} already flies {url}: stop it first")
        yield


@contextmanager
def service_lock(host: str, port: int, vehicle: str) -> Iterator[None]:
    """Hold the place of this computer's service for a vehicle on a broker; ConfigError naming the process that has it.

    `vehicle` is empty where the service runs its own broker, which no other service can use.
    """
    with _held(f"service {host}:{port} {vehicle}") as holder:
        if holder is not None:
            of_whom = f"for vehicle {vehicle!r} at the broker {host}:{port}" if vehicle else f"with port {port}"
            raise ConfigError(
                f"a companion service{holder} runs already on this computer {of_whom}: stop it first (Ctrl-C there, or "
                "`sudo systemctl stop dauam-companion`), or use it: `companion status`"
            )
        yield


@contextmanager
def law_lock(host: str, port: int) -> Iterator[None]:
    """Hold the place of this computer's ground law for a vehicle; ConfigError naming the process that has it."""
    with _held(f"law {host}:{port}") as holder:
        if holder is not None:
            raise ConfigError(
                f"another `companion law`{holder} runs on this computer for the vehicle at {host}:{port}: stop it first"
            )
        yield


@contextmanager
def _held(what: str) -> Iterator[str | None]:
    """Hold it; yield who else does, for a sentence, or None."""
    name = "\0dauam-companion-" + hashlib.sha256(what.encode()).hexdigest()[:16]
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as lock:
        try:
            lock.bind(name)
        except OSError:
            yield _holder(name)
            return
        lock.listen(_WAITING)
        yield None


def _link(url: str) -> str:
    """Return the device or port of a URL, equal for all URLs of one link."""
    scheme, _, rest = url.partition("://")
    if scheme == "serial":
        return "serial " + os.path.realpath(rest.rpartition(":")[0] if ":" in rest else rest)
    if scheme in {"udp", "udpin"}:
        return "udp port " + rest.rpartition(":")[2]
    return f"{scheme} {rest}"


def _holder(name: str) -> str:
    """Return the process that holds the lock as " (process N)"; empty when the kernel does not tell."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as question:
        question.setblocking(False)
        try:
            question.connect(name)
            answer = question.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        except OSError:
            return ""
    process, _, _ = _CREDENTIALS.unpack(answer)
    return f" (process {process})"
