"""Settings and state of one servo as its registers say them at connect. Pure."""

from dataclasses import dataclass

from companion.adapters.dynamixel.registers import POSITION_MODE, Ax, Xm, ax_baud
from companion.config.arms_config import XM_BAUDS

FACTORY_GAINS = (800, 0, 0, 0, 0)
"""XM430: Position P, I, D Gain, Feedforward 1st and 2nd Gain."""
NO_ID = 253
"""From here on a Secondary ID is none."""


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
    """Of the whole voltage, as PWM Limit and Goal PWM leave it."""
    gains: tuple[int, ...] = FACTORY_GAINS
    bus_watchdog: int = 0
    """20 ms each; below 0 it has struck, and goals are refused."""


def found_xm(identity: bytes, tuning: bytes, health: bytes, state: bytes) -> Found:
    """Return what the four blocks of an XM say."""
    code = Xm.BAUD_CODE.raw(identity, 0)
    gains = (
        Xm.POSITION_P_GAIN, Xm.POSITION_I_GAIN, Xm.POSITION_D_GAIN, Xm.FEEDFORWARD_1ST_GAIN, Xm.FEEDFORWARD_2ND_GAIN,
    )  # fmt: skip
    return Found(
        model_number=Xm.MODEL_NUMBER.raw(identity, 0),
        firmware=Xm.FIRMWARE.raw(identity, 0),
        baud=XM_BAUDS[code] if code < len(XM_BAUDS) else 0.0,
        return_delay_us=1e6 * Xm.RETURN_DELAY.value(identity, 0),
        status_return_level=Xm.STATUS_RETURN_LEVEL.raw(health, Xm.HEALTH.start),
        voltage_v=Xm.PRESENT_VOLTAGE.value(state, Xm.STATE.start),
        temperature_c=Xm.PRESENT_TEMPERATURE.value(state, Xm.STATE.start),
        temperature_limit_c=Xm.TEMPERATURE_LIMIT.value(identity, 0),
        errors=Xm.HARDWARE_ERROR.raw(health, Xm.HEALTH.start),
        shutdown=Xm.SHUTDOWN.raw(identity, 0),
        counts=Xm.PRESENT_POSITION.raw(state, Xm.STATE.start),
        lowest=Xm.MIN_POSITION.raw(identity, 0),
        highest=Xm.MAX_POSITION.raw(identity, 0),
        operating_mode=Xm.OPERATING_MODE.raw(identity, 0),
        drive_mode=Xm.DRIVE_MODE.raw(identity, 0),
        secondary_id=Xm.SECONDARY_ID.raw(identity, 0),
        homing_offset=Xm.HOMING_OFFSET.raw(identity, 0),
        starts_with_torque=bool(Xm.STARTUP_CONFIGURATION.raw(identity, 0) & 1),
        velocity_limit_radps=Xm.VELOCITY_LIMIT.value(identity, 0),
        pwm_share=min(Xm.PWM_LIMIT.value(identity, 0), abs(Xm.GOAL_PWM.value(tuning, Xm.TUNING.start))),
        gains=tuple(gain.raw(tuning, Xm.TUNING.start) for gain in gains),
        bus_watchdog=Xm.BUS_WATCHDOG.raw(tuning, Xm.TUNING.start),
    )


def found_ax(identity: bytes, state: bytes, errors: int) -> Found:
    """Return what the two blocks of an AX say, and the errors that came with them."""
    return Found(
        model_number=Ax.MODEL_NUMBER.raw(identity, 0),
        firmware=Ax.FIRMWARE.raw(identity, 0),
        baud=ax_baud(Ax.BAUD_CODE.raw(identity, 0)),
        return_delay_us=1e6 * Ax.RETURN_DELAY.value(identity, 0),
        status_return_level=Ax.STATUS_RETURN_LEVEL.raw(identity, 0),
        voltage_v=Ax.PRESENT_VOLTAGE.value(state, Ax.STATE.start),
        temperature_c=Ax.PRESENT_TEMPERATURE.value(state, Ax.STATE.start),
        temperature_limit_c=Ax.TEMPERATURE_LIMIT.value(identity, 0),
        errors=errors,
        shutdown=Ax.SHUTDOWN.raw(identity, 0),
        counts=Ax.PRESENT_POSITION.raw(state, Ax.STATE.start),
        lowest=Ax.MIN_POSITION.raw(identity, 0),
        highest=Ax.MAX_POSITION.raw(identity, 0),
    )
