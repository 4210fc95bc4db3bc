"""Conversion between a servo's counts and the joint's SI values. Pure.

A joint's angle is direction * (the servo's angle - zero_rad); the servo's angle counts from position 0, positive
counter-clockwise as the manuals draw it.
"""

import math
from dataclasses import dataclass

from companion.adapters.dynamixel.registers import MODELS, OVERLOAD, Answer, Ax, Model, Register
from companion.config.arms_config import ServoConfig


@dataclass(frozen=True)
class Reading:
    """Last state of one joint, with the sign of the joint's axis."""

    counts: int
    """Present Position as it came."""
    position_rad: float
    velocity_radps: float
    effort: float
    """Share of the rated current (XM) or of the greatest torque (AX)."""
    temperature_c: float
    voltage_v: float


@dataclass(frozen=True)
class Health:
    """Torque state and errors of a servo."""

    torque_on: bool
    errors: int
    """XM: Hardware Error Status. AX: the error byte's bits that speak of the servo."""
    moving_speed: int | None = None
    """AX only: a reboot sets it back."""
    spent: bool = False
    """AX only: its shutdown has set Torque Limit to 0, which stays after the alarm itself is over."""

    @property
    def trouble(self) -> int:
        """Errors, and overload as the likeliest reason of a shutdown that shows none any more."""
        return self.errors or (OVERLOAD if self.spent else 0)


@dataclass(frozen=True)
class JointScale:
    """One joint's servo: how it is mounted, and its units."""

    model: Model
    direction: int
    zero_rad: float

    @classmethod
    def of(cls, servo: ServoConfig) -> "JointScale":
        """Return the scale for one configured servo."""
        return cls(MODELS[servo.model], servo.direction, servo.zero_rad)

    def joint_rad(self, counts: int) -> float:
        """Return the joint angle, rad, of a position in counts."""
        return self.direction * (counts * self.model.table.PRESENT_POSITION.unit - self.zero_rad)

    def counts(self, joint_rad: float) -> int:
        """Return the nearest position in counts, limited to the servo's range."""
        nearest = round((self.direction * joint_rad + self.zero_rad) / self.model.table.GOAL_POSITION.unit)
        return min(max(nearest, 0), self.model.table.LAST_POSITION)

    def reading(self, state: Answer) -> Reading:
        """Return the joint's state from the table's STATE block; ValueError when it is too short."""
        table, counts = self.model.table, state.raw(self.model.table.PRESENT_POSITION)
        return Reading(
            counts=counts,
            position_rad=self.joint_rad(counts),
            velocity_radps=self.direction * state.value(table.PRESENT_VELOCITY),
            effort=self.direction * state.value(table.PRESENT_EFFORT),
            temperature_c=state.value(table.PRESENT_TEMPERATURE),
            voltage_v=state.value(table.PRESENT_VOLTAGE),
        )


def at_least_one(value: float, register: Register) -> int:
    """Return a limit in counts: never 0, which every servo reads as "no limit", and at most the register's range."""
    most = Ax.LAST_POSITION if register.size == 2 else 32_767
    return min(max(math.ceil(value / register.unit), 1), most)
