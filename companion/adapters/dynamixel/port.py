"""The serial port: opened for us alone, read without burning the processor, and given up with a clear sentence.

The SDK's own PortHandler reads with a time-out of zero in a loop, which would keep the interpreter from the flight
loop; measures time-outs by the wall clock, which can be set; and lets two programs share a port.
"""

import errno
import os
import re
import select
import termios
import time
from pathlib import Path

import dynamixel_sdk.port_handler
import serial

from companion.core.interfaces import ArmError

_NUMBERED = re.compile(r".*/tty(USB|ACM)\d+")
_BY_ID = "; the number changes when an adapter is plugged in again, /dev/serial/by-id/... does not"
SYSFS = Path("/sys/bus/usb-serial/devices")
_AT_ONCE = 4096
"""More than any answer, and all answers to one question; what a tty holds."""

dynamixel_sdk.port_handler.LATENCY_TIMER = 1
"""ms; the SDK adds twice this to every time-out. Its 16 is what FTDI's driver starts with: see `latency_warning`."""


class PortGoneError(Exception):
    """The port failed under us: the adapter was pulled, or the other end of a pty closed."""


class BusPort(dynamixel_sdk.port_handler.PortHandler):  # type: ignore[misc]  # the SDK has no types
    """The SDK's port with reading that sleeps; every failure is a PortGoneError."""

    def __init__(self, path: str, baud: int) -> None:
        super().__init__(path)
        self.baudrate = baud
        self.patience_ms = 0.0
        """Added to every time-out: outside the cycles there is time to wait for a computer that is busy."""
        self._unread = b""
        self._taken = 0
        self._fd = -1

    def open(self) -> None:
        """Open and lock; ArmError with what to do otherwise."""
        try:
            self.ser = serial.Serial(self.port_name, self.baudrate, timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            raise ArmError(_cannot_open(self.port_name, self.baudrate, error)) from error
        self._fd = self.ser.fileno()
        self.is_open, self.is_using = True, False  # a lost port leaves the second one set
        self.change_baud(self.baudrate)

    def change_baud(self, baud: int) -> None:
        """Change the baud rate of the port."""
        try:
            self.ser.baudrate = baud
        except (OSError, ValueError, termios.error) as error:
            raise PortGoneError(str(error)) from error
        self.baudrate = baud
        self.tx_time_per_byte = 1000.0 / baud * 10.0
        self.clearPort()

    def closePort(self) -> None:  # noqa: N802  # the SDK's name
        """Close; also a port that is gone."""
        self.is_open = False
        if self.ser is not None:
            self.ser.close()

    def clearPort(self) -> None:  # noqa: N802
        """Forget what came before, as the SDK does ahead of every instruction."""
        self._unread, self._taken = b"", 0
        try:
            self.ser.reset_input_buffer()
        except (OSError, termios.error) as error:
            raise PortGoneError(str(error)) from error

    @property
    def heard(self) -> int:
        """Bytes that came since the last instruction."""
        return self._taken + len(self._unread)

    def readPort(self, length: int) -> bytes:  # noqa: N802
        """Read up to `length` bytes; sleeps until some have arrived or the packet's time-out.

        The SDK looks at the time only when too few bytes came. So a line with continuous traffic, or that is stuck
        and reads as ones, falls silent here after more bytes than there are answers.
        """
        if length <= 0:
            return b""
        left_s = max(0.0, self.packet_timeout - self.getTimeSinceStart()) * 1e-3
        if self._taken >= _AT_ONCE:
            time.sleep(left_s)
            return b""
        if not self._unread:
            self._unread = self._receive(left_s)
        taken, self._unread = self._unread[:length], self._unread[length:]
        self._taken += len(taken)
        return taken

    def _receive(self, timeout_s: float) -> bytes:
        try:
            ready, _, _ = select.select([self._fd], [], [], timeout_s)
            if not ready:
                return b""
            received = os.read(self._fd, _AT_ONCE)
        except (OSError, ValueError) as error:
            raise PortGoneError(str(error)) from error
        if not received:
            raise PortGoneError("the port is readable but empty: the device is gone")
        return received

    def setPacketTimeout(self, packet_length: int) -> None:  # noqa: N802
        """Start the timeout for an answer of this many bytes."""
        super().setPacketTimeout(packet_length)
        self.packet_timeout += self.patience_ms

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        """Send; returns how many bytes."""
        try:
            return os.write(self._fd, bytes(packet))
        except OSError as error:
            raise PortGoneError(str(error)) from error

    def getCurrentTime(self) -> float:  # noqa: N802
        """Return the monotonic time, ms."""
        return time.monotonic() * 1e3


def _cannot_open(path: str, baud: int, error: BaseException) -> str:
    number = getattr(error, "errno", None)
    if number == errno.ENOENT:
        there = ", ".join(_ports()) or "none"
        return (
            f"no serial port {path} (arms.port): plug in the arms' USB adapter; there are: {there}"
            f"{_BY_ID if there != 'none' and _NUMBERED.fullmatch(path) else ''}"
        )
    if number in {errno.EACCES, errno.EPERM}:
        return (
            f"no permission to open {path} (arms.port): add yourself to its group, "
            "`sudo usermod -aG dialout $USER`, and log in again"
        )
    if number in {errno.EAGAIN, errno.EBUSY}:
        return f"{path} (arms.port) is already in use by another process: end that one first"
    return f"cannot open {path} (arms.port) at {baud} bits/s: {error}; it must be a serial port"


def _ports() -> list[str]:
    return sorted(
        str(path) for pattern in ("serial/by-id/*", "ttyUSB*", "ttyACM*") for path in Path("/dev").glob(pattern)
    )


def name_warning(path: str, dev: Path = Path("/dev")) -> str | None:
    """Return a sentence when the port has a name that changes when it is plugged in again; None for one that stays."""
    stays = next(
        (link for link in sorted(dev.glob("serial/by-id/*")) if link.resolve() == Path(path).resolve()),
        None,
    )
    if stays is None or not _NUMBERED.fullmatch(path):
        return None
    return f"{path} (arms.port) may be called otherwise once it is plugged in again: give {stays}, which stays"


def latency_warning(path: str, sysfs: Path = SYSFS) -> str | None:
    """Return a warning when FTDI's driver would delay every answer; None for other ports and when all is well.

    The driver hands bytes on when 62 have come or its latency timer is over, 16 ms unless changed; FTDI AN232B-04,
    https://ftdichip.com/wp-content/uploads/2020/08/AN232B-04_DataLatencyFlow.pdf.
    """
    timer = sysfs / Path(path).resolve().name / "latency_timer"
    try:
        latency_ms = int(timer.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None
    if latency_ms <= 1:
        return None
    return (
        f"{path} (arms.port): FTDI's latency timer is {latency_ms} ms, so every answer of a servo comes that late; "
        f"set it to 1: `echo 1 | sudo tee {timer}`, or for good with the udev rule "
        "systemd/99-dauam-u2d2.rules"
    )
