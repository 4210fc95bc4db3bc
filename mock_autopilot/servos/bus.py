"""The simulated servo bus on a pseudo-terminal, for any program that would open /dev/ttyUSB0; Linux only.

Bytes that arrive are answered at once, or as late as on a real wire when `wire_timing` is set. The port's speed is what
the host has set on the terminal; a servo with another one does not understand it.
"""

import asyncio
import errno
import fcntl
import hashlib
import os
import socket
import struct
import tty
from collections.abc import Callable
from pathlib import Path

from mock_autopilot.servos.config import DynamixelConfig, Fault, FaultKind
from mock_autopilot.servos.instructions import Answer
from mock_autopilot.servos.packets import Parser
from mock_autopilot.servos.rack import ServoRack

BITS_PER_BYTE = 10
"""Eight bits, start and stop."""
PLUG_EVERY_S = 0.02
"""Period of the check whether a fault unplugs or returns the port."""
LONGEST_GAP_S = 0.1
"""An incomplete packet is dropped after a longer gap."""
MANY_BYTES = 4096

_TCGETS2 = 0x802C542A
_TERMIOS2 = struct.Struct("@4I20B2I")
"""struct termios2 of Linux; its last two fields are the speeds in bits/s, also those without a code, as 4 500 000."""


class BusStartError(OSError):
    """The bus cannot be opened at the configured path."""


class ServoBus:
    """Simulated servos behind a serial port. Call `open` and `close` in a running event loop.

    Give it `catch_up`, which brings the simulation, and with it `servos`, to the present; without it, the caller has to
    step `servos`.
    """

    def __init__(
        self, config: DynamixelConfig, catch_up: Callable[[], None] | None = None, servos: ServoRack | None = None
    ) -> None:
        self.config = config
        self.servos = servos or ServoRack(config)
        self._catch_up = catch_up
        self._port: _Port | None = None
        self._link = _Link(Path(config.link)) if config.link else None
        self._parser = Parser()
        self._heard_s = 0.0
        self._wire_free_s = 0.0
        self._watch: asyncio.TimerHandle | None = None
        self._pending: set[asyncio.TimerHandle] = set()

    @property
    def path(self) -> str:
        """Return the path that the host opens: the link, or the terminal itself."""
        if self._link is not None:
            return str(self._link.path)
        return self._port.path if self._port is not None else ""

    def open(self) -> None:
        """Open the port; raise BusStartError when the link's path is in use."""
        if self._link is not None:
            self._link.claim()
        try:
            self._watch_plug()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the port and remove the link to it."""
        if self._watch is not None:
            self._watch.cancel()
            self._watch = None
        self._unplug()
        if self._link is not None:
            self._link.release()

    def inject(self, fault: Fault) -> None:
        """Add a fault from now on, its `at_s` counted from now; ValueError when it names a servo that is not there."""
        self.servos.inject(fault)
        self._mind_plug()

    def clear(self, kind: FaultKind | None = None, servo_id: int | None = None) -> None:
        """End faults, all or those of a kind or a servo; what the servos have latched stays latched."""
        self.servos.clear(kind, servo_id)
        self._mind_plug()

    def _watch_plug(self) -> None:
        self._watch = asyncio.get_running_loop().call_later(PLUG_EVERY_S, self._watch_plug)
        self._mind_plug()

    def _mind_plug(self) -> None:
        """Unplug the port or plug it in as the faults say, while the bus is open."""
        if self._watch is None:
            return
        gone = self.servos.active(FaultKind.PORT_GONE)
        if gone and self._port is not None:
            self._unplug()
        elif not gone and self._port is None:
            self._plug_in()

    def _plug_in(self) -> None:
        self._port = _Port()
        self._parser.reset()
        if self._link is not None:
            self._link.point_to(self._port.path)
        asyncio.get_running_loop().add_reader(self._port.master, self._on_bytes)

    def _unplug(self) -> None:
        for handle in self._pending:
            handle.cancel()
        self._pending.clear()
        if self._port is not None:
            asyncio.get_running_loop().remove_reader(self._port.master)
            self._port.close()
            self._port = None

    def _on_bytes(self) -> None:
        if self._catch_up is not None:
            self._catch_up()
            self._mind_plug()
        if self._port is None:
            return
        data, now_s = self._port.read(), asyncio.get_running_loop().time()
        if now_s - self._heard_s > LONGEST_GAP_S:
            self._parser.reset()
        self._heard_s = now_s
        baud = self._port.baud()
        byte_s = BITS_PER_BYTE / max(baud, 1) if self.config.wire_timing else 0.0
        for packet in self._parser.feed(data):
            answers = self.servos.answer(packet, baud if self.config.check_baud else None)
            self._send(answers, max(now_s, self._wire_free_s) + packet.wire_bytes * byte_s, byte_s)

    def _send(self, answers: list[Answer], heard_s: float, byte_s: float) -> None:
        """Send the answers one after the other, from the end of the instruction on."""
        at_s = heard_s
        for said in answers:
            at_s += said.late_s + (said.return_delay_s + len(said.data) * byte_s if byte_s else 0.0)
            self._put(said.data, at_s)
        self._wire_free_s = at_s if byte_s else 0.0

    def _put(self, data: bytes, at_s: float) -> None:
        if at_s > asyncio.get_running_loop().time():
            self._later(at_s, data)
        elif self._port is not None:
            self._port.write(data)

    def _later(self, at_s: float, data: bytes) -> None:
        def send() -> None:
            self._pending.discard(handle)
            if self._port is not None:
                self._port.write(data)

        handle = asyncio.get_running_loop().call_at(at_s, send)
        self._pending.add(handle)


class _Port:
    """A pseudo-terminal in raw mode. Its own end of the slave stays open, so that a host may come and go."""

    def __init__(self) -> None:
        self.master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self.path = os.ttyname(self._slave)

    def read(self) -> bytes:
        try:
            return os.read(self.master, MANY_BYTES)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> None:
        try:
            os.write(self.master, data)
        except BlockingIOError:
            return  # nobody reads, and the terminal is full: on a wire the bytes would be lost as well

    def baud(self) -> int:
        """Return the bits/s that the host has set."""
        state = fcntl.ioctl(self.master, _TCGETS2, bytes(_TERMIOS2.size))
        return int(_TERMIOS2.unpack(state)[-1])

    def close(self) -> None:
        os.close(self._slave)
        os.close(self.master)


class _Link:
    """A symbolic link that one bus at a time may own.

    Ownership is an abstract socket named after the path: it dies with its process, so that a stale link is known.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._owned: socket.socket | None = None

    def claim(self) -> None:
        name = hashlib.sha256(os.fsencode(self.path.absolute())).hexdigest()
        owned = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            owned.bind(f"\0mock-servo-bus-{name}")
        except OSError as error:
            owned.close()
            if error.errno != errno.EADDRINUSE:
                raise
            raise BusStartError(
                f"{self.path} is in use by another simulated servo bus: stop that one or choose another link"
            ) from None
        if self.path.exists() and not self.path.is_symlink():
            owned.close()
            raise BusStartError(f"{self.path} is a file and no link: remove it or choose another link")
        self._owned = owned

    def point_to(self, target: str) -> None:
        fresh = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        fresh.unlink(missing_ok=True)
        try:
            fresh.symlink_to(target)
            fresh.replace(self.path)
        except OSError as error:
            raise BusStartError(f"cannot make the link {self.path}: {error.strerror}") from error

    def release(self) -> None:
        if self._owned is not None:
            self.path.unlink(missing_ok=True)
            self._owned.close()
            self._owned = None
