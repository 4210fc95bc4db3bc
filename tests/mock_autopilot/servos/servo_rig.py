"""An XM and an AX without a port, in simulated time, for the tests of the servos."""

from mock_autopilot.servos.config import DynamixelConfig, ServoConfig
from mock_autopilot.servos.memory import Refusal
from mock_autopilot.servos.packets import Instruction, Packet
from mock_autopilot.servos.rack import ServoRack
from mock_autopilot.servos.servo import Servo

STEP_S = 0.002
XM, AX = 1, 2
CONFIG = DynamixelConfig(servos=(ServoConfig(id=XM), ServoConfig(id=AX, model="AX-12A")))


def run(rack: ServoRack, for_s: float, load_nm: tuple[float, float] = (0.0, 0.0)) -> None:
    """Advance the servos' time in steps of STEP_S."""
    for _ in range(round(for_s / STEP_S)):
        rack.step(STEP_S, load_nm)


def write(servo: Servo, name: str, value: int) -> Refusal | None:
    """Write a register by name."""
    register = servo.model.by_name[name]
    return servo.write(register.address, (value & (1 << 8 * register.size) - 1).to_bytes(register.size, "little"))


def read(servo: Servo, name: str) -> int:
    """Read a register by name."""
    register = servo.model.by_name[name]
    data = servo.read(register.address, register.size)
    assert isinstance(data, bytes)
    return int.from_bytes(data, "little", signed=register.signed)


def pings(rack: ServoRack, servo_id: int) -> int:
    """Return the number of answers to a ping."""
    protocol = rack.servo(servo_id).model.protocol
    return len(rack.answer(Packet(protocol, servo_id, Instruction.PING, b"")))
