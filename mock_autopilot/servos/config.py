"""Settings of the simulated servo bus; strict, so that a misspelt key is an error."""

import math
from enum import StrEnum
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from mock_autopilot.servos.control_tables import MODELS, Model, model_named


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class FaultKind(StrEnum):
    """Kinds of faults on the bus."""

    MISSING = "missing"
    """A servo does not answer."""
    LATE = "late"
    """Its answers come `late_s` late."""
    CORRUPT = "corrupt"
    """One byte of every `every`-th answer of it is wrong."""
    OVERLOAD = "overload"
    """Its load is more than it can carry; latched as the hardware does."""
    VOLTAGE = "voltage"
    """Its supply falls to `volts_v`."""
    HOT = "hot"
    """It is warmer than its limit allows."""
    REBOOT = "reboot"
    """It restarts, once: torque off, RAM as after power-on, silent for half a second."""
    TWIN = "twin"
    """Another servo of its model and ID stands elsewhere and answers at the same moment: their bytes collide."""
    SILENT_BUS = "silent_bus"
    """Nothing on the bus answers: the cable between adapter and servos is out; servos keep their torque."""
    PORT_GONE = "port_gone"
    """The adapter is unplugged: the host's port dies; when it comes back it is a new one under the same link."""


BUS_WIDE = frozenset({FaultKind.SILENT_BUS, FaultKind.PORT_GONE})


class Fault(_Strict):
    """One fault and the time at which it is active, in simulated seconds."""

    kind: FaultKind = Field(description="What goes wrong.")
    id: int | None = Field(None, ge=0, le=252, description="Whose; leave it out for all servos, or the whole bus.")
    at_s: float = Field(0.0, ge=0.0, description="When it begins; in `inject`, from now.")
    for_s: float = Field(math.inf, gt=0.0, description="How long it lasts; without, for ever.")
    late_s: float = Field(0.05, gt=0.0, le=5.0, description="Delay of late answers.")
    every: int = Field(1, ge=1, description="Corrupt every n-th answer.")
    volts_v: float = Field(5.5, ge=0.0, le=20.0, description="Supply during a voltage fault.")

    def holds(self, time_s: float) -> bool:
        """Return whether the fault is active at `time_s`; at its end it is not."""
        return self.at_s <= time_s < self.at_s + self.for_s

    def concerns(self, servo_id: int) -> bool:
        """Return whether the fault applies to this servo."""
        return self.id is None or self.id == servo_id


class ServoConfig(_Strict):
    """One servo as it hangs on the bus, set up beforehand as far as these values go."""

    id: int = Field(ge=0, le=252, description="Its ID on the bus.")
    model: str = Field("XM430-W350", description="XM430-W350, XM430-W210 (Protocol 2.0) or AX-12A (1.0).")
    start_position_rad: float | None = Field(None, description="Where it stands at boot; without, in its centre.")
    baud: int = Field(1_000_000, gt=0, description="Its Baud Rate register.")
    firmware: int = Field(45, ge=0, le=255, description="Its Firmware Version register.")
    return_delay_us: int = Field(0, ge=0, le=508, description="Its Return Delay Time; new servos have 500.")
    operating_mode: int = Field(3, ge=0, le=16, description="Its Operating Mode (XM); 3 is position control.")

    registers: dict[str, int] = Field(
        {}, description="Initial values of other registers by name, such as homing_offset; RAM until a restart."
    )

    @property
    def kind(self) -> Model:
        """Return the control table and units of its model."""
        return model_named(self.model)

    @field_validator("model")
    @classmethod
    def _known(cls, value: str) -> str:
        names = [model.name for model in MODELS]
        if value not in names:
            raise ValueError(f"must be one of {', '.join(names)}")
        return value

    @model_validator(mode="after")
    def _fits(self) -> Self:
        self.kind.baud_code(self.baud)
        unknown = sorted(set(self.registers) - set(self.kind.by_name))
        if unknown:
            raise ValueError(f"{self.model} has no register {unknown[0]}; it has {', '.join(self.kind.by_name)}")
        start = self.start_position_rad
        full = 2 * self.kind.centre_rad
        if start is not None and not 0.0 <= start <= full:
            raise ValueError(f"start_position_rad of servo {self.id} is {start}; {self.model} has 0 to {full:.3f}")
        return self


def _default_servos() -> tuple[ServoConfig, ...]:
    """Two arms of three joints (XM) and a claw (AX)."""
    joint = {"model": "XM430-W350"}
    claw = {"model": "AX-12A", "firmware": 24}
    return tuple(ServoConfig.model_validate({"id": i} | (claw if i in {4, 8} else joint)) for i in range(1, 9))


class DynamixelConfig(_Strict):
    """The simulated servo bus: its port, its servos, its faults."""

    link: str | None = Field(None, description="Path of a symbolic link to the pseudo-terminal; without, none.")
    servos: tuple[ServoConfig, ...] = Field(
        default_factory=_default_servos, min_length=1, description="Right, then left: pitch, pitch, roll, claw."
    )
    voltage_v: float = Field(12.0, ge=0.0, le=20.0, description="Supply of the servos.")
    ambient_c: float = Field(25.0, ge=-20.0, le=60.0, description="Air temperature, degrees C.")
    wire_timing: bool = Field(False, description="Answer as late as baud rate and return delay make it on a real wire.")
    check_baud: bool = Field(True, description="A servo whose baud rate is not the port's stays silent.")
    faults: tuple[Fault, ...] = Field((), description="What goes wrong on the bus, and when.")

    @field_validator("servos")
    @classmethod
    def _ids_differ(cls, value: tuple[ServoConfig, ...]) -> tuple[ServoConfig, ...]:
        ids = [servo.id for servo in value]
        twice = sorted({servo_id for servo_id in ids if ids.count(servo_id) > 1})
        if twice:
            raise ValueError(f"two servos have ID {twice[0]}")
        return value

    @model_validator(mode="after")
    def _faults_have_servos(self) -> Self:
        ids = {servo.id for servo in self.servos}
        for fault in self.faults:
            self.check_fault(fault, ids)
        return self

    @staticmethod
    def check_fault(fault: Fault, ids: set[int]) -> None:
        """Raise ValueError when the fault names a servo that is not there."""
        if fault.id is not None and (fault.kind in BUS_WIDE or fault.id not in ids):
            why = "concerns the whole bus" if fault.kind in BUS_WIDE else f"there are {sorted(ids)}"
            raise ValueError(f"fault {fault.kind} cannot have id {fault.id}: {why}")
