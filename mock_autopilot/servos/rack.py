"""All servos of the bus in simulated time, with their faults; pure. `step` moves them, `answer` is the wire's end."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mock_autopilot.physics.quaternion import Array
from mock_autopilot.servos.ax import AxServo
from mock_autopilot.servos.config import DynamixelConfig, Fault, FaultKind, ServoConfig
from mock_autopilot.servos.instructions import Answer
from mock_autopilot.servos.packets import Packet
from mock_autopilot.servos.protocol1 import answers1
from mock_autopilot.servos.protocol2 import answers2
from mock_autopilot.servos.servo import Servo
from mock_autopilot.servos.xm import XmServo

TEND_EVERY_S = 0.01
"""Period of temperatures and protection; motion is computed at every step."""

_TWIN_AT_RAD = 0.7
"""The twin's offset from its centre, which is not the servo's own angle."""

Floats = tuple[float, ...]


def _servo(config: ServoConfig, voltage_v: float, ambient_c: float) -> Servo:
    kind = AxServo if config.kind.protocol == 1 else XmServo
    return kind(config, voltage_v, ambient_c)


class ServoRack:
    """The servos in the order of the configuration; angles are theirs, from position 0, counter-clockwise positive."""

    def __init__(self, config: DynamixelConfig) -> None:
        self.config = config
        self.servos = tuple(_servo(servo, config.voltage_v, config.ambient_c) for servo in config.servos)
        self._motors = tuple(servo.motor for servo in self.servos)
        self._still: Floats = (0.0,) * len(self.servos)
        self.time_s = 0.0
        """Simulated seconds since the servos got power."""
        self._tended_s = 0.0
        self._faults = list(config.faults)
        self._next_fault_s = 0.0
        self._answers = 0

    def step(self, dt_s: float, load_nm: Sequence[float] | None = None) -> None:
        """Advance by `dt_s` under these loads, one for each servo (N m, positive towards greater angles)."""
        self.time_s += dt_s
        for motor, load in zip(self._motors, self._still if load_nm is None else load_nm, strict=True):
            motor.step(dt_s, load)
        since_s = self.time_s - self._tended_s
        if since_s >= TEND_EVERY_S - 1e-9:
            self._tended_s = self.time_s
            if self.time_s >= self._next_fault_s:
                self._update_faults()
            for servo in self.servos:
                servo.tend(since_s, self.time_s)

    def motion(self) -> tuple[Floats, Floats, Floats]:
        """Return the true angles (rad), rates (rad/s) and accelerations (rad/s^2)."""
        motors = self._motors
        return (
            tuple([motor.angle_rad for motor in motors]),
            tuple([motor.rate_radps for motor in motors]),
            tuple([motor.accel_radps2 for motor in motors]),
        )

    @property
    def positions_rad(self) -> Array:
        """Return the true angles, (n,)."""
        return np.array([motor.angle_rad for motor in self._motors])

    def servo(self, servo_id: int) -> Servo:
        """Return the servo with that ID; raise KeyError when there is none."""
        for servo in self.servos:
            if servo.id == servo_id:
                return servo
        raise KeyError(servo_id)

    def answer(self, packet: Packet, baud: int | None = None) -> list[Answer]:
        """Let the servos act on a packet that came at `baud` (None: at theirs); return their answers."""
        if self.active(FaultKind.SILENT_BUS):
            return []
        hearing = [s for s in self.servos if s.protocol == packet.protocol and self._hears(s, baud)]
        for servo in hearing:
            servo.heard_s = self.time_s
        said = self._said(packet, hearing)
        twins = {servo.id: self._twin(servo) for servo in hearing if self._fault(FaultKind.TWIN, servo.id) is not None}
        if twins:
            also = self._said(packet, [twins.get(servo.id, servo) for servo in hearing])
            said = [_collided(one, other) for one, other in zip(said, also, strict=True)]
        return [self._spoilt(one) for one in said]

    def _said(self, packet: Packet, hearing: Sequence[Servo]) -> list[Answer]:
        return answers1(packet, hearing) if packet.protocol == 1 else answers2(packet, hearing, self.time_s)

    def _twin(self, servo: Servo) -> Servo:
        """Return another servo with the same settings, which stands elsewhere."""
        start_rad = servo.model.centre_rad + _TWIN_AT_RAD
        twin = _servo(
            servo.config.model_copy(update={"start_position_rad": start_rad}), servo.voltage_v, self.config.ambient_c
        )
        for register in servo.model.registers:
            if register.writable:
                twin.table.put(register.name, servo.table.get(register.name))
        return twin

    def _hears(self, servo: Servo, baud: int | None) -> bool:
        return (
            (baud is None or servo.baud == baud)
            and self.time_s >= servo.restarts_until_s
            and self._fault(FaultKind.MISSING, servo.id) is None
        )

    def _spoilt(self, said: Answer) -> Answer:
        for servo_id in said.ids:
            late = self._fault(FaultKind.LATE, servo_id)
            if late is not None:
                said = replace(said, late_s=said.late_s + late.late_s)
            corrupt = self._fault(FaultKind.CORRUPT, servo_id)
            if corrupt is not None:
                self._answers += 1
                if self._answers % corrupt.every == 0:
                    said = replace(said, data=_flip(said.data, self._answers // corrupt.every))
        return said

    def inject(self, fault: Fault) -> None:
        """Add a fault from now on, its `at_s` counted from now; ValueError when it names a servo that is not there."""
        DynamixelConfig.check_fault(fault, {servo.id for servo in self.servos})
        self._faults.append(fault.model_copy(update={"at_s": self.time_s + fault.at_s}))
        self._update_faults()

    def clear(self, kind: FaultKind | None = None, servo_id: int | None = None) -> None:
        """End faults, all or those of a kind or a servo; what the servos have latched stays latched."""
        self._faults = [
            fault
            for fault in self._faults
            if (kind is not None and fault.kind is not kind) or (servo_id is not None and fault.id != servo_id)
        ]
        self._update_faults()

    def active(self, kind: FaultKind) -> bool:
        """Return whether a fault of the whole bus is active."""
        return any(fault.kind is kind and fault.holds(self.time_s) for fault in self._faults)

    def _fault(self, kind: FaultKind, servo_id: int) -> Fault | None:
        for fault in self._faults:
            if fault.kind is kind and fault.concerns(servo_id) and fault.holds(self.time_s):
                return fault
        return None

    def _update_faults(self) -> None:
        """Begin and end the faults that are due, and note the time of the next change."""
        now_s = self.time_s
        reboots = [fault for fault in self._faults if fault.kind is FaultKind.REBOOT and fault.at_s <= now_s]
        self._faults = [fault for fault in self._faults if fault not in reboots]
        for servo in self.servos:
            if any(fault.concerns(servo.id) for fault in reboots):
                servo.restart(now_s)
            servo.overloaded = self._fault(FaultKind.OVERLOAD, servo.id) is not None
            servo.overheated = self._fault(FaultKind.HOT, servo.id) is not None
            low = self._fault(FaultKind.VOLTAGE, servo.id)
            servo.voltage_v = self.config.voltage_v if low is None else low.volts_v
            servo.motor.supply(servo.voltage_v)
            servo.protect(now_s)
        edges = (edge for fault in self._faults for edge in (fault.at_s, fault.at_s + fault.for_s))
        self._next_fault_s = min((edge for edge in edges if edge > now_s), default=math.inf)


def _collided(one: Answer, other: Answer) -> Answer:
    """Return what is read when two pull one wire at the same moment: a bit is 1 only if it is 1 in both."""
    shared = min(len(one.data), len(other.data))
    both = bytes(a & b for a, b in zip(one.data, other.data, strict=False))
    return replace(one, data=both + (one.data[shared:] or other.data[shared:]))


def _flip(data: bytes, count: int) -> bytes:
    """Invert one byte, a different one each time."""
    spoilt = bytearray(data)
    spoilt[count % len(spoilt)] ^= 0xFF
    return bytes(spoilt)
