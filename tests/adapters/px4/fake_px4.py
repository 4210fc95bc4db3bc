"""A PX4 of a few messages that can be killed, fall silent, flood and restart at any instant, on a thread of its own."""

import os
import random
import socket
import threading
import time
from typing import Any

os.environ.setdefault("MAVLINK20", "1")
from pymavlink.dialects.v20 import common as mavlink

_ON_GROUND, _IN_AIR = 1, 2
_OFFBOARD = 6 << 16
_HOLD = 4 << 16 | 3 << 24
_FLOOD = 200
"""Messages at once, between two looks at what came."""


class FakePx4:
    """One autopilot that sends to `port` on loopback from a socket of its own."""

    def __init__(
        self, port: int | None = None, *, system: int = 1, autopilot: int = 12, answers: float = 1.0, seed: int = 0
    ) -> None:
        """`port` is the client's, None: a free one; `autopilot` is HEARTBEAT's, 12 is PX4.

        `answers` is the share of commands that it acknowledges.
        """
        self.port, self.system, self.autopilot = port or _free_port(), system, autopilot
        self.answers, self._random = answers, random.Random(seed)
        self.silent = self.flooding = False
        self.armed, self.mode = False, _HOLD
        self.to_send: list[Any] = []
        """Messages to send once, and soon."""
        self.repeated: list[Any] = [extended_sys_state(in_air=False)]
        """Messages that go out ten times a second."""
        self.commands: list[Any] = []
        """COMMAND_LONGs that came."""
        self.denials: dict[int, bytes] = {}
        """Commands, by number, that it refuses (TEMPORARILY_REJECTED), and what it says of each."""
        self._ends = False
        self._thread: threading.Thread | None = None
        self.start()

    def start(self) -> None:
        """Begin anew: a port of its own that is another one than before, and a clock that begins at zero."""
        self._ends = False
        self._codec = mavlink.MAVLink(None, srcSystem=self.system, srcComponent=1)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._boot_s = time.monotonic()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def kill(self) -> None:
        """End at once, socket and all."""
        self._ends = True
        if self._thread is not None:
            self._thread.join()
            self._socket.close()
            self._thread = None

    def __enter__(self) -> "FakePx4":
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    @property
    def url(self) -> str:
        """Return the URL that MAVSDK listens on."""
        return f"udpin://127.0.0.1:{self.port}"

    @property
    def address(self) -> tuple[str, int]:
        """Return the address that its datagrams come from."""
        host, port = self._socket.getsockname()
        return host, port

    def _run(self) -> None:
        turn = 0
        while not self._ends:
            if not self.silent:
                self._speak(turn)
            self._hear()
            turn += 1
            time.sleep(0.02)

    def _speak(self, turn: int) -> None:
        if turn % 50 == 0:
            flags = 1 | (128 if self.armed else 0)
            self._send(mavlink.MAVLink_heartbeat_message(2, self.autopilot, flags, self.mode, 4, 3))
        if turn % 5 == 0:
            for message in self.repeated:
                self._send(message)
        while self.to_send:
            self._send(self.to_send.pop(0))
        for _ in range(_FLOOD if self.flooding else 1):
            boot_ms = int(1e3 * (time.monotonic() - self._boot_s))
            self._send(mavlink.MAVLink_attitude_quaternion_message(boot_ms, 1, 0, 0, 0, 0, 0, 0))
            self._send(mavlink.MAVLink_local_position_ned_message(boot_ms, 0, 0, 0, 0, 0, 0))

    def _send(self, message: Any) -> None:
        self._codec.seq = (self._codec.seq + 1) % 256
        self._socket.sendto(message.pack(self._codec), ("127.0.0.1", self.port))

    def _hear(self) -> None:
        while True:
            try:
                data = self._socket.recv(2048, socket.MSG_DONTWAIT)
            except BlockingIOError:
                return
            try:
                messages = self._codec.parse_buffer(data) or []
            except mavlink.MAVError:
                continue
            for message in messages:
                if message.get_type() == "COMMAND_LONG":
                    self._obey(message)

    def _obey(self, command: Any) -> None:
        self.commands.append(command)
        if self._random.random() >= self.answers:
            return
        if command.command in self.denials:
            self.to_send.append(mavlink.MAVLink_command_ack_message(command.command, 1, 0, 0, 245, 190))
            self.to_send.append(text(self.denials[command.command]))
            return
        if command.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            self.armed = command.param1 == 1.0
        elif command.command == mavlink.MAV_CMD_DO_SET_MODE:
            self.mode = _OFFBOARD
        elif command.command == mavlink.MAV_CMD_NAV_LAND:
            self.mode = 4 << 16 | 6 << 24
        self.to_send.append(mavlink.MAVLink_command_ack_message(command.command, 0, 0, 0, 245, 190))


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def extended_sys_state(*, in_air: bool) -> Any:
    """Return an EXTENDED_SYS_STATE message with the land detector's state."""
    return mavlink.MAVLink_extended_sys_state_message(0, _IN_AIR if in_air else _ON_GROUND)


def acknowledgement(command: int, target: tuple[int, int]) -> Any:
    """Return a COMMAND_ACK, accepted, to this system and component."""
    return mavlink.MAVLink_command_ack_message(command, 0, 0, 0, *target)


def battery(number: int, percent: int, volts: float | None) -> Any:
    """Return a BATTERY_STATUS; None: no voltage measured."""
    cells = [65535 if volts is None else round(1e3 * volts), *[65535] * 9]
    return mavlink.MAVLink_battery_status_message(number, 0, 0, 32767, cells, -1, -1, -1, percent)


def text(content: bytes, number: int = 0, piece: int = 0) -> Any:
    """Return a STATUSTEXT with these bytes, valid or not."""
    return mavlink.MAVLink_statustext_message(2, content, number, piece)
