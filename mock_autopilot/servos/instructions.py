"""Instructions as far as both protocols share them; pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from mock_autopilot.servos.memory import Refusal
from mock_autopilot.servos.servo import Servo

QUIET, READS_ONLY = 0, 1
"""Status Return Level: answers to pings alone; to reads, too."""


@dataclass(frozen=True)
class Answer:
    """Bytes that servos put on the wire after an instruction, in order."""

    ids: tuple[int, ...]
    """IDs of the servos that answer; several for the common answer to a fast read."""
    data: bytes
    return_delay_s: float
    """Return Delay Time, from the end of the bytes before."""
    late_s: float = 0.0
    """A fault's delay."""


def find(servos: Sequence[Servo], servo_id: int) -> Servo | None:
    """Return the servo with that ID, or None."""
    return next((servo for servo in servos if servo.id == servo_id), None)


def write_to(servos: Sequence[Servo], servo_id: int, address: int, data: bytes) -> None:
    """Write to the servo with that ID and to all whose Secondary ID it is; these keep what is in their EEPROM.

    https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/#secondaryshadow-id
    """
    for servo in servos:
        if servo.id == servo_id or (servo.secondary_id == servo_id and servo.table.is_ram(address)):
            servo.write(address, data)


def sync_write(params: bytes, width: int, servos: Sequence[Servo]) -> None:
    """Write to each servo named; `width` is the bytes of address and of size. Nobody answers."""
    if len(params) < 2 * width:
        return
    address, size = (int.from_bytes(params[i : i + width], "little") for i in (0, width))
    for at in range(2 * width, len(params) - size, size + 1):
        write_to(servos, params[at], address, params[at + 1 : at + 1 + size])


def act(servo: Servo) -> Refusal | None:
    """Carry out the write that Reg Write stored, if there is one."""
    address, data = servo.registered or (0, b"")
    servo.registered = None
    return servo.write(address, data)
