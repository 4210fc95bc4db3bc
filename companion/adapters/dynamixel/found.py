"""Settings and state of one servo as its registers say them at connect. Pure."""

from dataclasses import dataclass, replace

from companion.adapters.dynamixel.registers import POSITION_MODE, Answer, Ax, Xm, ax_baud
from companion.config.arms_config import XM_BAUDS

FACTORY_GAINS = (800, 0, 0, 0, 0)
"""XM430: Position P, I, D Gain, Feedforward 1st and 2nd Gain."""
NO_ID = 253
"""Lowest Secondary ID that means none."""


@dataclass(frozen=True, kw_only=True)
class Found:
    """Registers of one servo; of one of another model than configured only the model."""

    model_number: int
    answers: int = 1
    """Status packets that one ping brought: with two, two servos have this ID."""
    firmware: int = 0
    baud: float = 0.0
    return_delay_us: float = 0.0
    status_return_level: int = 2
    voltage_v: float = 0.0
    temperature_c: float = 0.0
    temperature_limit_c: float = 0.0
    """The servo's own: it switches off above."""
    errors: int = 0
    shutdown: int = 0
    """Errors that make it switch its torque off."""
    counts: int = 0
    lowest: int = 0
    highest: int = 0
    """Positions that it accepts as goals."""
    operating_mode: int = POSITION_MODE
    """XM only, as is all below."""
    drive_mode: int = 0
    secondary_id: int = NO_ID
    homing_offset: int = 0
    starts_with_torque: bool = False
    velocity_limit_radps: float | None = None
    pwm_share: float = 1.0
    """Share of the full voltage that PWM Limit and Goal PWM leave."""
    gains: tuple[int, ...] = FACTORY_GAINS
    bus_watchdog: int = 0
    """20 ms each; below 0 it has struck, and goals are refused."""


def found_ax(identity: Answer, state: Answer, errors: int) -> Found:
    """Return what the two blocks of an AX say, and the errors that came with them."""
    level = identity.raw(Ax.STATUS_RETURN_LEVEL)
    return _found(Ax, identity, state, ax_baud(identity.raw(Ax.BAUD_CODE)), level, errors)


def found_xm(identity: Answer, tuning: Answer, health: Answer, state: Answer) -> Found:
    """Return what the four blocks of an XM say."""
    code, level = identity.raw(Xm.BAUD_CODE), health.raw(Xm.STATUS_RETURN_LEVEL)
    baud = XM_BAUDS[code] if code < len(XM_BAUDS) else 0.0
    gains = (
        Xm.POSITION_P_GAIN, Xm.POSITION_I_GAIN, Xm.POSITION_D_GAIN, Xm.FEEDFORWARD_1ST_GAIN, Xm.FEEDFORWARD_2ND_GAIN,
    )  # fmt: skip
    return replace(
        _found(Xm, identity, state, baud, level, health.raw(Xm.HARDWARE_ERROR)),
        operating_mode=identity.raw(Xm.OPERATING_MODE),
        drive_mode=identity.raw(Xm.DRIVE_MODE),
        secondary_id=identity.raw(Xm.SECONDARY_ID),
        homing_offset=identity.raw(Xm.HOMING_OFFSET),
        starts_with_torque=bool(identity.raw(Xm.STARTUP_CONFIGURATION) & 1),
        velocity_limit_radps=identity.value(Xm.VELOCITY_LIMIT),
        pwm_share=min(identity.value(Xm.PWM_LIMIT), abs(tuning.value(Xm.GOAL_PWM))),
        gains=tuple(map(tuning.raw, gains)),
        bus_watchdog=tuning.raw(Xm.BUS_WATCHDOG),
    )


def _found(table: type[Ax] | type[Xm], identity: Answer, state: Answer, baud: float, level: int, errors: int) -> Found:
    return Found(
        model_number=identity.raw(table.MODEL_NUMBER),
        firmware=identity.raw(table.FIRMWARE),
        baud=baud,
        return_delay_us=1e6 * identity.value(table.RETURN_DELAY),
        status_return_level=level,
        voltage_v=state.value(table.PRESENT_VOLTAGE),
        temperature_c=state.value(table.PRESENT_TEMPERATURE),
        temperature_limit_c=identity.value(table.TEMPERATURE_LIMIT),
        errors=errors,
        shutdown=identity.raw(table.SHUTDOWN),
        counts=state.raw(table.PRESENT_POSITION),
        lowest=identity.raw(table.MIN_POSITION),
        highest=identity.raw(table.MAX_POSITION),
    )
