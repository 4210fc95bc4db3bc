"""A servo's control table as memory: reading, writing and refusals; pure."""

from collections.abc import Iterator
from enum import Enum
from struct import Struct

from mock_autopilot.servos.control_tables import Model, Register


class Refusal(Enum):
    """Reasons why a table was not read or written."""

    NO_SUCH_ADDRESS = "nothing there that may be read or written"
    READ_ONLY = "read only"
    LOCKED = "EEPROM is locked while torque is on"
    CUT_SHORT = "shorter than the register"
    OUT_OF_RANGE = "outside the register's range"
    OVER_LIMIT = "outside a limit that another register sets"
    SHUT_DOWN = "torque stays off until a reboot"


def _number(register: Register) -> Struct:
    """Return the register's format, prepared once because a driver's cycle reads hundreds."""
    code = {1: "b", 2: "h", 4: "i"}[register.size]
    return Struct("<" + (code if register.signed else code.upper()))


class ControlTable:
    """Bytes of one servo's table; names are those of dynamixel_tables."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.bytes = bytearray(model.size)
        self._at = {register.address: register for register in model.registers}
        self._kept = {register.name: (register.address, _number(register)) for register in model.registers}
        for register in model.registers:
            self.put(register.name, register.default)

    def get(self, name: str) -> int:
        """Return the value of a register."""
        address, number = self._kept[name]
        value: int = number.unpack_from(self.bytes, address)[0]
        return value

    def put(self, name: str, value: int) -> None:
        """Set a register from inside the servo: no range, no lock."""
        register = self.model.by_name[name]
        mask = (1 << 8 * register.size) - 1
        self.bytes[register.address : register.end] = (value & mask).to_bytes(register.size, "little")

    def is_ram(self, address: int) -> bool:
        """Return whether the register that begins there is outside the EEPROM."""
        register = self._at.get(address)
        return register is not None and not register.eeprom

    def forget_ram(self) -> None:
        """Reset everything outside the EEPROM to its value after power-on, as a restart does."""
        for register in self.model.registers:
            if not register.eeprom:
                self.put(register.name, register.default)

    def read(self, address: int, size: int) -> bytes | Refusal:
        """Return bytes from an address, or the refusal; gaps between registers read as zero."""
        if size == 0 or address + size > len(self.bytes):
            return Refusal.NO_SUCH_ADDRESS
        return bytes(self.bytes[address : address + size])

    def values_of(self, address: int, data: bytes) -> list[tuple[Register, int]] | Refusal:
        """Return the registers and values that these bytes would write, or the refusal; writes nothing."""
        values = []
        for register in self._covered(address, len(data)):
            if register is None:
                return Refusal.NO_SUCH_ADDRESS
            if not register.writable:
                return Refusal.READ_ONLY
            if register.end > address + len(data):
                return Refusal.CUT_SHORT
            raw = data[register.address - address : register.end - address]
            value = int.from_bytes(raw, "little", signed=register.signed)
            if not register.minimum <= value <= register.maximum:
                return Refusal.OUT_OF_RANGE
            values.append((register, value))
        return values or Refusal.NO_SUCH_ADDRESS

    def _covered(self, address: int, size: int) -> Iterator[Register | None]:
        place = address
        while place < address + size:
            register = self._at.get(place)
            yield register
            if register is None:
                return
            place = register.end
