"""One servo: control table, motor and protection, as far as both kinds share them. Pure.

The differences of XM430 and AX-12A are in xm.py and ax.py. The manuals do not say how long an overload may
last; here it is a second at nearly all the torque the limits leave.
"""

import math

from mock_autopilot.servos.config import ServoConfig
from mock_autopilot.servos.memory import ControlTable, Refusal
from mock_autopilot.servos.motor import Motor, MotorSpec

OVERLOAD_AFTER_S = 1.0
OVERLOAD_SHARE = 0.95
"""Share of the torque that voltage and limits leave."""
RESTART_S = 0.5
"""Silence of a servo that restarts; not in the manuals."""
SELF_WARMING_C = 5.0
"""A servo with power is a little warmer than the room."""


class Servo:
    """Base of both kinds; the bus talks to it through `read`, `write`, `registered`, `error` and `restart`."""

    def __init__(self, config: ServoConfig, spec: MotorSpec, voltage_v: float, ambient_c: float) -> None:
        self.config, self.model = config, config.kind
        self.id = config.id
        start = config.start_position_rad
        self.motor = Motor(spec, self.model.centre_rad if start is None else start, voltage_v)
        self.table = ControlTable(self.model)
        self.voltage_v, self.ambient_c = voltage_v, ambient_c + SELF_WARMING_C
        self.temperature_c = self.ambient_c
        self.registered: tuple[int, bytes] | None = None
        """The write that a Reg Write stored for the next Action."""
        self.overloaded = self.overheated = False
        """Faults from outside: more load than it can carry, more heat than it may have."""
        self.restarts_until_s = -math.inf
        self.heard_s = 0.0
        """Time of the last instruction for it."""
        self._strain_s = 0.0
        self._set_up()
        self._forget()
        self._set(eeprom=False)

    def _set_up(self) -> None:
        table = self.table
        table.put("id", self.id)
        table.put("firmware_version", self.config.firmware)
        table.put("baud_rate", self.model.baud_code(self.config.baud))
        table.put("return_delay_time", self.config.return_delay_us // self.model.return_delay_unit_us)
        self._set(eeprom=True)

    def _set(self, eeprom: bool) -> None:
        """Set the configured registers that outlast a restart, or those that do not."""
        for name, value in self.config.registers.items():
            if self.model.by_name[name].eeprom is eeprom:
                self.table.put(name, value)

    @property
    def baud(self) -> int | None:
        """Return its baud rate, bits/s; None for an invalid register."""
        return self.model.baud_of(self.table.get("baud_rate"))

    @property
    def protocol(self) -> int:
        """Return its protocol version, 1 or 2."""
        return self.model.protocol

    @property
    def secondary_id(self) -> int | None:
        """Return another ID at which it acts without an answer; None while it has none."""
        return None

    @property
    def return_delay_s(self) -> float:
        """Return the time from the end of an instruction to its answer."""
        return self.table.get("return_delay_time") * self.model.return_delay_unit_us * 1e-6

    @property
    def torque_on(self) -> bool:
        """Return whether its Torque Enable is set."""
        return self.table.get("torque_enable") != 0

    @property
    def error(self) -> int:
        """Return the error byte of an answer to a valid instruction."""
        raise NotImplementedError

    def read(self, address: int, size: int) -> bytes | Refusal:
        """Return bytes from its table with up-to-date present values, or the refusal."""
        self.refresh()
        return self.table.read(address, size)

    def write(self, address: int, data: bytes) -> Refusal | None:
        """Write to its table and act on it; return the refusal, if any."""
        values = self.table.values_of(address, data)
        if isinstance(values, Refusal):
            return values
        wanted = {register.name: value for register, value in values}
        refusal = self.refuses(wanted, any(register.eeprom for register, _ in values))
        if refusal is None:
            for name, value in wanted.items():
                self.table.put(name, value)
            self.id = self.table.get("id")
            self.obey(wanted)
        return refusal

    def refuses(self, wanted: dict[str, int], eeprom: bool) -> Refusal | None:
        """Return the refusal of these values, or None if they may be written now."""
        raise NotImplementedError

    def obey(self, written: dict[str, int]) -> None:
        """Act on what was written."""
        raise NotImplementedError

    def refresh(self) -> None:
        """Bring the present values in the table up to date."""
        raise NotImplementedError

    def restart(self, time_s: float) -> None:
        """Reset to the state after power-on, silent for RESTART_S."""
        self.restarts_until_s = time_s + RESTART_S
        self._forget()

    def _forget(self) -> None:
        self.table.forget_ram()
        self.registered, self._strain_s = None, 0.0
        self.table.put("goal_position", self.raw_position())
        self.motor.power(on=False)

    def raw_position(self) -> int:
        """Return the present angle in the units of the registers."""
        return round(self.motor.angle_rad / self.model.position_unit_rad)

    def tend(self, dt_s: float, time_s: float) -> None:
        """Update temperature, strain and protection, which need not happen at every step."""
        motor, spec = self.motor, self.motor.spec
        share = motor.heat_nm2s / dt_s / spec.stall_nm**2
        motor.heat_nm2s = 0.0
        warmth_c = spec.warming_c_per_w * share * spec.stall_a * 12.0
        self.temperature_c += (self.ambient_c + warmth_c - self.temperature_c) * dt_s / spec.warming_s
        strained = motor.powered and abs(motor.torque_nm) >= OVERLOAD_SHARE * motor.strength_nm > 0.0
        self._strain_s = self._strain_s + dt_s if strained else 0.0
        self.protect(time_s)

    def protect(self, time_s: float) -> None:
        """Set the error bits, and switch the torque off for those that Shutdown contains."""
        raise NotImplementedError

    def _overload_seen(self) -> bool:
        return self._strain_s >= OVERLOAD_AFTER_S or (self.overloaded and self.motor.powered)

    def _heat_seen(self) -> bool:
        return self.measured_temperature_c > self.table.get("temperature_limit")

    def _voltage_seen(self) -> bool:
        low, high = self.table.get("min_voltage_limit"), self.table.get("max_voltage_limit")
        return not low <= round(10.0 * self.voltage_v) <= high

    @property
    def measured_temperature_c(self) -> float:
        """Return the temperature that its sensor measures."""
        hot = self.table.get("temperature_limit") + 5.0
        return max(self.temperature_c, hot) if self.overheated else self.temperature_c

    @property
    def raw_temperature(self) -> int:
        """Return the value of its temperature register, degrees C."""
        return min(max(round(self.measured_temperature_c), 0), 255)
