"""Checks that a servo is the configured one with the required settings; one line for each deviation. Pure."""

from collections.abc import Iterator

from companion.adapters.dynamixel.faults import described
from companion.adapters.dynamixel.found import NO_ID, Found
from companion.adapters.dynamixel.joint import Joint
from companion.adapters.dynamixel.registers import MODELS, OPERATING_MODES, OTHER_MODELS, POSITION_MODE
from companion.config.arms_config import ArmsConfig

RESTS_WITHIN_RAD = 0.05
"""A limp joint may lie a little outside its limits."""
_BAUD_TOLERANCE = 0.03
"""The manual's: less than 3 % does not disturb."""
_WIZARD = "with DYNAMIXEL Wizard 2.0"


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
        yield f"is there {found.answers} times: give all but one another ID than {joint.servo_id} {_WIZARD}"
    if found.secondary_id < NO_ID:
        for name, servo in config.servos.items():
            if servo.id == found.secondary_id and name != joint.name:
                yield f"has {name}'s ID {servo.id} as its Secondary ID and moves with it: set that to 255 {_WIZARD}"


def _settings(joint: Joint, found: Found, config: ArmsConfig) -> Iterator[str]:
    lowest = joint.scale.model.lowest_firmware
    if found.firmware < lowest:
        yield f"has firmware {found.firmware}, and should have {lowest} or newer: update it {_WIZARD}"
    if abs(found.baud - config.baud) > _BAUD_TOLERANCE * config.baud:
        yield f"is set to {found.baud:.0f} bits/s, and should be to {config.baud}: set its Baud Rate {_WIZARD}"
    if round(found.return_delay_us) != config.return_delay_us:
        yield (
            f"waits {found.return_delay_us:.0f} us before it answers, and should wait {config.return_delay_us}: "
            f"set its Return Delay Time {_WIZARD}, or correct arms.return_delay_us"
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
            f"set it {_WIZARD}"
        )
    if found.drive_mode != 0:
        yield (
            f"has Drive Mode {found.drive_mode}, and should have 0 (not reversed, profile by velocity, no torque by "
            f"goal): set it {_WIZARD}; its direction belongs into arms.servos.{joint.name}.direction"
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
        yield f"is in wheel mode, and should be in joint mode: set its CCW Angle Limit to 1023 {_WIZARD}"
        return
    accepted = sorted((joint.scale.joint_rad(found.lowest), joint.scale.joint_rad(found.highest)))
    if accepted[0] > joint.limit.min_rad + RESTS_WITHIN_RAD or accepted[1] < joint.limit.max_rad - RESTS_WITHIN_RAD:
        yield (
            f"accepts {accepted[0]:.2f} to {accepted[1]:.2f} rad, and should accept the joint's limits "
            f"{joint.limit.min_rad:g} to {joint.limit.max_rad:g}: widen its position limits {_WIZARD}, narrow "
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
    return "restart its power" if joint.protocol == 2 else f"set it {_WIZARD}"
