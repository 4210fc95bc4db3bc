"""Checks that a servo is the configured one with the required settings; one line for each deviation. Pure.

Meanings and factory values: https://emanual.robotis.com/docs/en/dxl/x/xm430-w350/ and
https://emanual.robotis.com/docs/en/dxl/ax/ax-12a/, "Control Table Description".
"""

from collections.abc import Iterator

from companion.adapters.dynamixel.faults import described
from companion.adapters.dynamixel.found import FACTORY_GAINS, NO_ID, Found
from companion.adapters.dynamixel.joint import Joint
from companion.adapters.dynamixel.registers import (
    MODELS,
    OPERATING_MODES,
    OTHER_MODELS,
    OVERHEATING,
    OVERLOAD,
    POSITION_MODE,
    Xm,
)
from companion.config.arms_config import ArmsConfig

RESTS_WITHIN_RAD = 0.05
"""A limp joint may lie a little outside its limits."""
_BAUD_TOLERANCE = 0.03
"""The manual's: less than 3 % does not disturb."""
MOST_HOMING_OFFSET = 1024
"""Position control ignores a larger one."""
_WATCHDOG_S = 0.02
"""Unit of the Bus Watchdog."""
WIZARD = "with DYNAMIXEL Wizard 2.0"


def complaints(joint: Joint, found: Found, config: ArmsConfig) -> list[str]:
    """List everything that is wrong with one servo, each with its remedy; empty when all is well."""
    if found.model_number != joint.scale.model.number:
        return [f"{joint.label} {_wrong_model(joint, found.model_number)}"]
    lines = (
        *_ids(joint, found, config),
        *_settings(joint, found, config),
        *_condition(found, config, joint.protocol),
        *_range(joint, found),
    )
    return [f"{joint.label} {line}" for line in lines]


def _wrong_model(joint: Joint, number: int) -> str:
    return (
        f"is {model_name(number)}, and should be {joint.scale.model.name}: "
        f"exchange it, or correct arms.servos.{joint.name}.model"
    )


def model_name(number: int) -> str:
    """Return the name of a servo model by its model number, for unknown numbers with the number."""
    known = {model.number: model.name for model in MODELS.values()} | OTHER_MODELS
    return known.get(number, f"an unknown model {number}")


def _ids(joint: Joint, found: Found, config: ArmsConfig) -> Iterator[str]:
    if found.answers > 1:
        yield f"is there {found.answers} times: give all but one another ID than {joint.servo_id} {WIZARD}"
    if found.secondary_id < NO_ID:
        for name, servo in config.servos.items():
            if servo.id == found.secondary_id and name != joint.name:
                yield f"has {name}'s ID {servo.id} as its Secondary ID and moves with it: set that to 255 {WIZARD}"


def _settings(joint: Joint, found: Found, config: ArmsConfig) -> Iterator[str]:
    lowest = joint.scale.model.lowest_firmware
    if found.firmware < lowest:
        yield f"has firmware {found.firmware}, and should have {lowest} or newer: update it {WIZARD}"
    if abs(found.baud - config.baud) > _BAUD_TOLERANCE * config.baud:
        yield f"is set to {found.baud:.0f} bits/s, and should be to {config.baud}: set its Baud Rate {WIZARD}"
    if round(found.return_delay_us) != config.return_delay_us:
        yield (
            f"waits {found.return_delay_us:.0f} us before it answers, and should wait {config.return_delay_us}: "
            f"set its Return Delay Time {WIZARD}, or correct arms.return_delay_us"
        )
    if found.status_return_level != 2:
        level = found.status_return_level
        yield f"has Status Return Level {level}, and should have 2 (answer everything): {answer_all(joint)}"
    if found.bus_watchdog < 0:
        yield "takes no goals (its Bus Watchdog has struck) after another program: restart its power"
    if found.operating_mode != POSITION_MODE:
        mode = OPERATING_MODES.get(found.operating_mode, "an unknown mode")
        yield (
            f"is in {mode} (Operating Mode {found.operating_mode}), and should be in position control (3): "
            f"set it {WIZARD}"
        )
    if found.drive_mode != 0:
        yield (
            f"has Drive Mode {found.drive_mode}, and should have 0 (not reversed, profile by velocity, no torque by "
            f"goal): set it {WIZARD}; its direction belongs into arms.servos.{joint.name}.direction"
        )


def _condition(found: Found, config: ArmsConfig, protocol: int) -> Iterator[str]:
    if found.voltage_v < config.min_voltage_v - 1e-9:
        yield f"has {found.voltage_v:.1f} V, and should have {config.min_voltage_v:g} V or more: charge the battery"
    if found.temperature_c > config.max_temperature_c:
        yield (
            f"has {found.temperature_c:.0f} degrees C, and should have {config.max_temperature_c:g} or less: "
            "let it cool down"
        )
    if found.errors:
        cure = "restart its power" if protocol == 2 else "restart its power, and take the load away"
        yield f"reports {described(found.errors, protocol)}, latched from before: {cure}"


def _range(joint: Joint, found: Found) -> Iterator[str]:
    if found.lowest == found.highest == 0:
        yield f"is in wheel mode, and should be in joint mode: set its CCW Angle Limit to 1023 {WIZARD}"
        return
    accepted = sorted((joint.scale.joint_rad(found.lowest), joint.scale.joint_rad(found.highest)))
    if accepted[0] > joint.limit.min_rad + RESTS_WITHIN_RAD or accepted[1] < joint.limit.max_rad - RESTS_WITHIN_RAD:
        yield (
            f"accepts {accepted[0]:.2f} to {accepted[1]:.2f} rad, and should accept the joint's limits "
            f"{joint.limit.min_rad:g} to {joint.limit.max_rad:g}: widen its position limits {WIZARD}, narrow "
            "arms.limits, or correct zero_rad"
        )
    outside = misplaced(joint, joint.scale.joint_rad(found.counts))
    if outside:
        yield outside


def misplaced(joint: Joint, at_rad: float) -> str | None:
    """Return the sentence on a joint that stands outside its limits, and None for one inside."""
    if joint.limit.min_rad - RESTS_WITHIN_RAD <= at_rad <= joint.limit.max_rad + RESTS_WITHIN_RAD:
        return None
    return (
        f"stands at {at_rad:.2f} rad, and should be within {joint.limit.min_rad:g} to {joint.limit.max_rad:g}: "
        "move it there by hand, or correct zero_rad and direction"
    )


def answer_all(joint: Joint) -> str:
    """Return how a servo is made to answer everything: an XM forgets its Status Return Level, an AX keeps it."""
    return "restart its power" if joint.protocol == 2 else f"set it {WIZARD}"


def remarks(joint: Joint, found: Found, config: ArmsConfig) -> list[str]:
    """Return a warning for every setting that may surprise later; empty when there is none."""
    if found.model_number != joint.scale.model.number:
        return []
    lines = (*_angles(joint, found), *_protection(joint, found, config), *_strength(joint, found))
    return [f"{joint.label} {line}" for line in lines]


def _angles(joint: Joint, found: Found) -> Iterator[str]:
    offset = found.homing_offset
    zero = f"set it to 0 {WIZARD} and measure arms.servos.{joint.name}.zero_rad"
    if abs(offset) > MOST_HOMING_OFFSET:
        yield f"has Homing Offset {offset}, which position control ignores: {zero}"
    elif offset:
        yield (
            f"has Homing Offset {offset} ({offset * Xm.HOMING_OFFSET.unit:+.2f} rad), which is in all its angles and "
            f"lost by a factory reset: {zero} again"
        )


def _protection(joint: Joint, found: Found, config: ArmsConfig) -> Iterator[str]:
    ignored = (OVERLOAD | OVERHEATING) & ~found.shutdown
    if ignored:
        factory = 52 if joint.protocol == 2 else 36
        yield (
            f"keeps its torque on {described(ignored, joint.protocol)} (Shutdown {found.shutdown}) and can burn: "
            f"set it to {factory} {WIZARD}"
        )
    if found.temperature_limit_c < config.max_temperature_c:
        yield (
            f"switches off above {found.temperature_limit_c:.0f} degrees C (Temperature Limit), and may fly at up to "
            f"{config.max_temperature_c:g}: raise it {WIZARD}, or lower arms.max_temperature_c"
        )
    if found.starts_with_torque:
        yield (
            "switches its torque on by itself when it gets power (Startup Configuration), so that a restart goes "
            f"unnoticed: set it to 0 {WIZARD}"
        )
    if found.bus_watchdog > 0:
        yield (
            f"stops when the bus is quiet for {found.bus_watchdog * _WATCHDOG_S:g} s (Bus Watchdog), left by another "
            "program: restart its power"
        )


def _strength(joint: Joint, found: Found) -> Iterator[str]:
    wanted_radps = joint.limit.max_velocity_radps
    if found.velocity_limit_radps is not None and found.velocity_limit_radps < wanted_radps:
        yield (
            f"has Velocity Limit {found.velocity_limit_radps:.2f} rad/s, less than its joint's {wanted_radps:g}: raise "
            f"it {WIZARD}, or lower arms.limits"
        )
    if found.pwm_share < 1.0 - 1e-9:
        yield (
            f"may use {found.pwm_share:.0%} of its voltage (PWM Limit, Goal PWM) and be too weak for its arm: set PWM "
            f"Limit to 885 {WIZARD}, and restart its power"
        )
    if found.gains != FACTORY_GAINS:
        said = ", ".join(map(str, found.gains))
        yield (
            f"has position gains P, I, D and feedforward {said} instead of {', '.join(map(str, FACTORY_GAINS))}, left "
            "by another program: restart its power"
        )
